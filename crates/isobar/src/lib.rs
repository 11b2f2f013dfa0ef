//! The program isobar and the one list of methods.
