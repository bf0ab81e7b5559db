//! Sources made from arrays with one element per vertex, as engines and exchange formats hold meshes.

use super::{Corner, Faces, Mesh, MorphTarget, Semantic, StreamData, StreamDeltas};
use crate::error::{Error, Result, ensure};
use bytemuck::cast_slice;
use glam::Vec3;

/// A base pose and its targets as arrays with one element per vertex; an array is empty if the mesh has no such stream.
#[derive(Clone, Copy, Debug, Default)]
pub struct MeshArrays<'a> {
    /// Name for messages and reports; empty: "unnamed".
    pub name: &'a str,
    /// Positions.
    pub positions: &'a [[f32; 3]],
    /// Normals of unit length; if empty, [`Mesh::pack`] computes them.
    pub normals: &'a [[f32; 3]],
    /// Tangents of unit length with the handedness (1 or -1) in w.
    pub tangents: &'a [[f32; 4]],
    /// Texture coordinates.
    pub texcoords: &'a [[f32; 2]],
    /// Triangles, three vertices each.
    pub indices: &'a [u32],
    /// The targets.
    pub targets: &'a [TargetArrays<'a>],
    /// `true`: targets state positions, normals and tangents themselves; `false`: their differences from the base pose.
    pub absolute: bool,
}

/// A target of [`MeshArrays`]; an empty array changes nothing, except for normals.
#[derive(Clone, Copy, Debug, Default)]
pub struct TargetArrays<'a> {
    /// Name; if empty, "target" and its number, counted from 0.
    pub name: &'a str,
    /// Positions, or their deltas.
    pub positions: &'a [[f32; 3]],
    /// Normals, or their deltas; if empty, they are computed from the deformed surface.
    pub normals: &'a [[f32; 3]],
    /// The x y z of tangents, or their deltas.
    pub tangents: &'a [[f32; 3]],
}

impl Mesh {
    /// Makes a source from arrays with one element per vertex. Deltas of zero take no memory.
    ///
    /// If vertices are doubled at seams, call [`weld`](Self::weld): computed normals are then smooth across the seam,
    /// and no crack opens in any pose.
    ///
    /// ```
    /// use deltamorph::{MeshArrays, Mesh, PackDesc, TargetArrays};
    ///
    /// let smile = [[0.0, 0.0, 0.0], [0.0, 0.25, 0.0], [0.0, 0.0, 0.0]];
    /// let mesh = Mesh::from_arrays(&MeshArrays {
    ///     name: "mouth",
    ///     positions: &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    ///     normals: &[[0.0, 0.0, 1.0]; 3],
    ///     tangents: &[[1.0, 0.0, 0.0, 1.0]; 3],
    ///     indices: &[0, 1, 2],
    ///     targets: &[TargetArrays { name: "smile", positions: &smile, ..Default::default() }],
    ///     ..Default::default()
    /// })?;
    /// assert_eq!(mesh.targets[0].positions.len(), 1);
    /// let packed = mesh.pack(&PackDesc::default())?;
    /// # let _ = packed;
    /// # Ok::<(), deltamorph::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Invalid`] if the length of an array is not the number of vertices, or that of `indices` not a multiple
    /// of three. [`pack`](Self::pack) checks the values.
    pub fn from_arrays(arrays: &MeshArrays<'_>) -> Result<Self> {
        let MeshArrays { positions, normals, tangents, texcoords, indices, .. } = *arrays;
        let count = positions.len();
        let mesh_name = if arrays.name.is_empty() { "unnamed" } else { arrays.name };
        let refuse = |what: String, remedy: &str| Error::invalid(format!("{mesh_name}: {what}"), remedy);
        let corners = indices.len();
        ensure!(corners.is_multiple_of(3), refuse(format!("{corners} indices"), "give three per triangle"));
        let lengths =
            [("normals", normals.len()), ("tangents", tangents.len()), ("texture coordinates", texcoords.len())];
        for (what, n) in lengths {
            let remedy = "give one per vertex, or none";
            ensure!(n == 0 || n == count, refuse(format!("{n} {what} for {count} vertices"), remedy));
        }
        let directions: Vec<[f32; 3]> = tangents.iter().map(|&[x, y, z, _]| [x, y, z]).collect();
        let differences = |base: &[[f32; 3]], target: &[[f32; 3]]| -> Vec<(u32, Vec3)> {
            let base = |v: usize| if arrays.absolute { Vec3::from(base[v]) } else { Vec3::ZERO };
            let deltas = target.iter().enumerate().map(|(v, t)| (v as u32, Vec3::from(*t) - base(v)));
            deltas.filter(|(_, d)| *d != Vec3::ZERO).collect()
        };
        let mut targets = Vec::with_capacity(arrays.targets.len());
        for (i, target) in arrays.targets.iter().enumerate() {
            let name = if target.name.is_empty() { format!("target {i}") } else { target.name.to_owned() };
            let lengths = [
                ("positions", target.positions.len(), count),
                ("normals", target.normals.len(), normals.len()),
                ("tangents", target.tangents.len(), tangents.len()),
            ];
            for (what, n, base) in lengths {
                let what = || format!("target '{name}' has {n} {what}, but the base pose has {base}");
                ensure!(n == 0 || n == base, refuse(what(), "give as many as the base pose has, or none"));
            }
            let (vertices, deltas): (_, Vec<Vec3>) = differences(&directions, target.tangents).into_iter().unzip();
            let tangents = StreamDeltas { vertices, deltas: deltas.iter().flat_map(Vec3::to_array).collect() };
            targets.push(MorphTarget {
                name,
                positions: differences(positions, target.positions),
                normals: (!target.normals.is_empty()).then(|| differences(normals, target.normals)),
                streams: if tangents.vertices.is_empty() { vec![] } else { vec![tangents] },
            });
        }
        let corner = |&position: &u32| Corner { position, texcoord: (!texcoords.is_empty()).then_some(position) };
        let corners = indices.iter().map(corner).collect();
        let tangents = StreamData { semantic: Semantic::Tangent, values: tangents.concat() };
        Ok(Self {
            name: mesh_name.to_owned(),
            positions: cast_slice(positions).to_vec(),
            normals: (!normals.is_empty()).then(|| cast_slice(normals).to_vec()),
            texcoords: cast_slice(texcoords).to_vec(),
            faces: Faces { sizes: vec![3; indices.len() / 3], corners },
            streams: if tangents.values.is_empty() { vec![] } else { vec![tangents] },
            targets,
            ..Self::default()
        })
    }
}
