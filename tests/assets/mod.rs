//! File import, and the built-in head.

mod head;
mod import;
mod import_real;
mod memory;
mod names;
