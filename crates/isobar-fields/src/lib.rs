//! Continuous functions: analytic fields and grid reconstructions.
