//! Every update technique, of the library and of others, under the same tests: a table of paths, and a test per column.

mod faults;
mod poses;
mod recording;
mod refused;
mod streams;
mod table;
