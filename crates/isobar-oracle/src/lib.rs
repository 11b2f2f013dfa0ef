//! Certified ground truth: first hit, all hits, misses and multiplicities along a ray.
