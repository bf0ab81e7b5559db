//! Area-weighted vertex normals.
