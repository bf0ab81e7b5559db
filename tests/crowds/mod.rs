//! Crowds: instances, sets, and poses of several meshes.

mod lifetimes;
mod places;
mod pose_buffers;
mod seams;
mod sets;
