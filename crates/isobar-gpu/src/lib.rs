//! The wgpu context: adapter choice and report, timestamps, uploads, shader imports.
