//! `march/gpu`.
/// Placeholder while the module is written.
pub static MARCH_GPU: () = ();
