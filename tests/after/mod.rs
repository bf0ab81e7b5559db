//! Post-morph passes, and hosts' draws of their outputs.

mod formulas;
mod layouts;
mod scenes;
mod steps;
