#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| isobar_io::fuzz::mfem(bytes));
