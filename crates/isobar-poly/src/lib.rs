//! Univariate polynomials on a ray: forms, conversions, robust root finders, scalar and SIMD.
