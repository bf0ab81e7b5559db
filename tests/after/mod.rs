//! Steps after the pose, and hosts' draws of their outputs.

mod formulas;
mod gltf_skin;
mod host_vertices;
mod normals;
mod pictures;
mod scenes;
mod steps;
