//! Post-morph passes, and hosts' draws of their outputs.

mod formulas;
mod host_vertices;
mod scenes;
mod steps;
