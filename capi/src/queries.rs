//! Queries of a mesh in memory: sizes, names, indices, the reference.

use crate::handles::{DmMesh, Handle};
use crate::memory::{Place, Versioned, check_place, fill, list, read, slice, text};
use crate::numbers::{delta_number, pose_format};
use crate::result::{DmResult, Failure, Result, ensure, enter};
use crate::structs::{DmMeshInfo, DmRenderVertices, DmRequirement};
use deltamorph::ash::vk;
use deltamorph::reference::evaluate;
use deltamorph::{MorphEngine, PoseFormat, UpdatePath, requirements};
use std::ffi::{CString, c_char};
use std::sync::LazyLock;

/// Major version of the API in this header.
pub const DM_VERSION_MAJOR: u32 = 0;
/// Minor version of the API in this header.
pub const DM_VERSION_MINOR: u32 = 1;
/// Patch version of the API in this header.
pub const DM_VERSION_PATCH: u32 = 0;

/// The version of the linked library: major × 2^22 + minor × 2^12 + patch, as in VK_MAKE_API_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn dm_version() -> u32 {
    vk::make_api_version(0, DM_VERSION_MAJOR, DM_VERSION_MINOR, DM_VERSION_PATCH)
}

/// The requirements of a path, as C strings.
struct Requirements(Vec<[Option<CString>; 3]>);

impl Requirements {
    fn of(path: UpdatePath) -> Self {
        let string = |text: &str| CString::new(text).unwrap_or_default();
        let each = requirements(path).iter();
        Self(each.map(|r| [r.extension.map(Into::into), r.feature.map(string), Some(string(r.reason))]).collect())
    }

    fn items(&self) -> Vec<DmRequirement> {
        let pointer = |text: &Option<CString>| text.as_ref().map_or(std::ptr::null(), |text| text.as_ptr());
        let item = |[extension, feature, reason]: &[Option<CString>; 3]| DmRequirement {
            extension: pointer(extension),
            feature: pointer(feature),
            reason: pointer(reason),
        };
        self.0.iter().map(item).collect()
    }
}

/// List the extensions and features to enable when creating a device for a path (`DM_PATH_…`; 0: blocks). Beyond these,
/// Vulkan 1.1 and one queue with graphics and compute suffice.
///
/// With `items` null, `count` becomes their number. Otherwise `count` is the room in `items`.
///
/// Errors: DM_ERROR_INVALID for an unknown path, or too little room.
///
/// # Safety
/// `count` can be read and written; `items` is null or has room for that many.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_requirements(path: u32, count: *mut u32, items: *mut DmRequirement) -> DmResult {
    static ALL: LazyLock<Vec<(UpdatePath, Requirements)>> =
        LazyLock::new(|| UpdatePath::ALL.map(|path| (path, Requirements::of(path))).into());
    enter("dm_requirements", || {
        let path = crate::numbers::path(path)?;
        let found = ALL.iter().find(|(of, _)| *of == path).map(|(_, requirements)| requirements.items());
        // SAFETY: the caller's obligations.
        unsafe { list(count, items, &found.unwrap_or_default(), "items") }
    })
}

/// Describe how a draw reads poses of a format (`DM_POSE_…`; 0: float32): binding 0 is the pose, with position and
/// normal at locations 0 and 1; with `previous` not 0, binding 1 is the previous pose, at locations 2 and 3.
/// `DmPoseView` says what makes positions of the attributes.
///
/// Errors: DM_ERROR_INVALID for an unknown format.
///
/// # Safety
/// `binding_count` and `attribute_count` can be written; `bindings` has room for 2, `attributes` for 4.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_pose_vertex_input(
    format: u32,
    previous: u32,
    binding_count: *mut u32,
    bindings: *mut vk::VertexInputBindingDescription,
    attribute_count: *mut u32,
    attributes: *mut vk::VertexInputAttributeDescription,
) -> DmResult {
    enter("dm_pose_vertex_input", || {
        check_place(binding_count, "binding_count")?;
        check_place(attribute_count, "attribute_count")?;
        let format = pose_format(format, PoseFormat::Float32)?;
        let (found, places) = if previous != 0 { format.vertex_input_with_previous() } else { format.vertex_input() };
        // SAFETY: the caller's obligations; counts were checked.
        unsafe {
            fill(bindings, 2, &found, "bindings")?;
            fill(attributes, 4, &places, "attributes")?;
            *binding_count = found.len() as u32;
            *attribute_count = places.len() as u32;
        }
        Ok(())
    })
}

/// Write the sizes of a mesh.
///
/// Errors: DM_ERROR_INVALID for more triangles than 32-bit index counts allow: 1,431,655,765.
///
/// # Safety
/// `info` is a structure that can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_info(mesh: DmMesh, info: *mut DmMeshInfo) -> DmResult {
    enter("dm_mesh_info", || {
        // SAFETY: the caller's obligation.
        let place = unsafe { Place::new(info) }?;
        let mesh = mesh.get()?;
        let layout = mesh.layout();
        place.write(DmMeshInfo {
            vertex_count: layout.vertex_count as u32,
            padded_vertex_count: layout.padded_vertices() as u32,
            target_count: layout.targets.len() as u32,
            index_count: index_count(layout.indices.len() / 3)?,
            delta_format: delta_number(layout.format),
            diagonal: layout.diagonal,
            pose_bytes: layout.base_bytes(),
            device_bytes: MorphEngine::mesh_bytes(&mesh.packed),
            ..DmMeshInfo::zeroed()
        });
        Ok(())
    })
}

fn index_count(triangles: usize) -> Result<u32> {
    let count = triangles.checked_mul(3).and_then(|indices| u32::try_from(indices).ok());
    let most = u32::MAX / 3;
    count.ok_or_else(|| Failure::invalid(format!("{triangles} triangles, more than {most}; split the mesh")))
}

/// The name of a target, UTF-8. It is valid until the mesh is destroyed.
///
/// Errors: DM_ERROR_INVALID for a target out of range.
///
/// # Safety
/// `name` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_target_name(mesh: DmMesh, target: u32, name: *mut *const c_char) -> DmResult {
    enter("dm_mesh_target_name", || {
        check_place(name, "name")?;
        let mesh = mesh.get()?;
        let found = mesh.names.get(target as usize).ok_or_else(|| {
            Failure::invalid(format!("target {target} of a mesh with {}; count targets from 0", mesh.names.len()))
        })?;
        // SAFETY: the caller's obligation; it was checked.
        unsafe { name.write(found.as_ptr()) };
        Ok(())
    })
}

/// Find the target called `name`.
///
/// Errors: DM_ERROR_INVALID if there is none.
///
/// # Safety
/// `name` is a UTF-8 string; `target` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_find_target(mesh: DmMesh, name: *const c_char, target: *mut u32) -> DmResult {
    enter("dm_mesh_find_target", || {
        check_place(target, "target")?;
        // SAFETY: the caller's obligation.
        let name = unsafe { text(name, "name") }?;
        let mesh = mesh.get()?;
        let found = mesh.layout().targets.iter().position(|target| target.name == name).ok_or_else(|| {
            let mesh = &mesh.layout().name;
            Failure::invalid(format!("mesh '{mesh}' has no target '{name}'; dm_mesh_target_name tells the names"))
        })?;
        // SAFETY: the caller's obligation; it was checked.
        unsafe { target.write(found as u32) };
        Ok(())
    })
}

/// Convert vertex numbers of the mesh as it was imported (an index buffer) to those of pose buffers, in place.
///
/// Errors: DM_ERROR_INVALID for an index out of range; nothing is changed then.
///
/// # Safety
/// There are `count` numbers at `indices` that can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_remap_indices(mesh: DmMesh, indices: *mut u32, count: usize) -> DmResult {
    enter("dm_mesh_remap_indices", || {
        let mesh = mesh.get()?;
        // SAFETY: the caller's obligations.
        let mut numbers = unsafe { slice(indices, count, "indices") }?.to_vec();
        mesh.layout().remap_indices(&mut numbers)?;
        // SAFETY: as above.
        unsafe { fill(indices, count, &numbers, "indices") }
    })
}

/// Copy the triangles of the mesh, as an index buffer for pose buffers: DmMeshInfo::index_count numbers.
///
/// With `indices` null, `count` becomes their number. Otherwise `count` is the room in `indices`.
///
/// Errors: DM_ERROR_INVALID for too little room.
///
/// # Safety
/// `count` can be read and written; `indices` is null or has room for that many.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_indices(mesh: DmMesh, count: *mut u32, indices: *mut u32) -> DmResult {
    enter("dm_mesh_indices", || {
        let mesh = mesh.get()?;
        // SAFETY: the caller's obligations.
        unsafe { list(count, indices, &mesh.layout().indices, "indices") }
    })
}

/// Copy the render vertices, for hosts that look up the pose in the vertex shader: they are doubled where texture
/// coordinates have seams, unlike poses. Call it with null arrays for the counts first. A mesh imported with
/// `DM_MESH_SPLIT` needs this only for its texture coordinates: its pose buffers are drawn as they are.
///
/// Errors: DM_ERROR_INVALID for too little room.
///
/// # Safety
/// `vertices` is a structure that can be written; its arrays are null or have the room that it states.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_render_vertices(mesh: DmMesh, vertices: *mut DmRenderVertices) -> DmResult {
    enter("dm_mesh_render_vertices", || {
        // SAFETY: the caller's obligation.
        let mut asked = unsafe { read(vertices) }?;
        // SAFETY: as above.
        let place = unsafe { Place::new(vertices) }?;
        let mesh = mesh.get()?;
        let found = mesh.packed.render_vertices()?;
        let texcoords: Vec<f32> = found.texcoords.iter().flat_map(|t| t.to_array()).collect();
        let vertex_room = asked.vertex_count as usize;
        let index_room = asked.index_count as usize;
        // SAFETY: as above.
        unsafe {
            fill_unless_null(asked.pose_vertices, vertex_room, &found.pose_vertices, "pose_vertices")?;
            fill_unless_null(asked.texcoords, vertex_room.saturating_mul(2), &texcoords, "texcoords")?;
            fill_unless_null(asked.indices, index_room, &found.indices, "indices")?;
        }
        asked.vertex_count = found.pose_vertices.len() as u32;
        asked.index_count = found.indices.len() as u32;
        place.write(asked);
        Ok(())
    })
}

/// # Safety
/// The conditions of [`fill`].
unsafe fn fill_unless_null<T: Copy>(pointer: *mut T, room: usize, values: &[T], what: &str) -> Result<()> {
    // SAFETY: the caller's obligation.
    if pointer.is_null() { Ok(()) } else { unsafe { fill(pointer, room, values, what) } }
}

/// Compute the reference: the pose of these weights, evaluated in full and in double precision from the packed deltas.
/// Six numbers for each vertex, position and normal (a sum, not normalised), in the order of vertices as the mesh was
/// imported, without padding. `dm_mesh_remap_indices` tells the index of a vertex in pose buffers.
///
/// Errors: DM_ERROR_INVALID for more weights than targets (fewer: the rest is 0), or too little room.
///
/// # Safety
/// There are `weight_count` weights, and room for `count` numbers at `pose`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_evaluate(
    mesh: DmMesh,
    weights: *const f32,
    weight_count: u32,
    pose: *mut f64,
    count: usize,
) -> DmResult {
    enter("dm_mesh_evaluate", || {
        let mesh = mesh.get()?;
        // SAFETY: the caller's obligations.
        let weights = unsafe { slice(weights, weight_count as usize, "weights") }?;
        let targets = mesh.layout().targets.len();
        ensure!(weights.len() <= targets, "{weight_count} weights for {targets} targets; give one per target");
        // SAFETY: as above.
        unsafe { fill(pose, count, &evaluate(&mesh.packed, weights), "pose") }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_is_that_of_the_package() {
        let text = format!("{DM_VERSION_MAJOR}.{DM_VERSION_MINOR}.{DM_VERSION_PATCH}");
        assert_eq!(text, env!("CARGO_PKG_VERSION"));
    }

    #[test]
    fn indices_are_counted_or_refused() {
        assert_eq!(index_count(1_431_655_765).unwrap(), u32::MAX);
        for triangles in [1_431_655_766, usize::MAX] {
            let text = index_count(triangles).unwrap_err().message;
            assert!(text.contains("more than 1431655765; split the mesh"), "{text}");
        }
    }
}
