//! Steps after the pose, and hosts' draws of their outputs.

mod formulas;
mod host_vertices;
mod pictures;
mod scenes;
mod steps;
