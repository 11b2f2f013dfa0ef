//! Tiles, threads, run-time SIMD dispatch and frame assembly for CPU methods.
