//! The rulers: fixed-step marching with bisection, and marching cubes with ray casting.
