//! Figures of a run as a table and as a file to compare with.
