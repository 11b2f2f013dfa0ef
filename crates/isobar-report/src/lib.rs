//! Definitions, measurements and the generated report.
