//! Meshes in memory: imported, and packed for the device.

use crate::arguments::or;
use crate::handles::{DmMesh, Handle, handle};
use crate::memory::{array, check_place, read, read_or_default, slice, text, text_or_empty};
use crate::numbers::{DM_MESH_KEEP_ALL, DM_MESH_SPLIT, DM_MESH_WELD, DM_MESSAGE_NOTE, delta_format};
use crate::result::{DmResult, Result, c_string, ensure, enter};
use crate::structs::{DmMeshArrays, DmMeshDesc, DmTargetArrays};
use deltamorph::import::{Imported, ImportedMesh, open};
use deltamorph::{BlockDesc, MeshArrays, PackDesc, PackedLayout, PackedMesh, TargetArrays, Tolerance};
use std::borrow::Cow;
use std::ffi::{CString, c_char, c_void};
use std::path::Path;

/// The object of a `DmMesh`.
pub struct Mesh {
    pub(crate) packed: PackedMesh,
    /// Names of its targets, for as long as it lives.
    pub(crate) names: Vec<CString>,
}

handle!(DmMesh for Mesh);

impl DmMeshDesc {
    const FLAGS: u32 = DM_MESH_SPLIT | DM_MESH_WELD | DM_MESH_KEEP_ALL;

    fn has(&self, flag: u32) -> Result<bool> {
        let unknown = self.flags & !Self::FLAGS;
        ensure!(unknown == 0, "flag {unknown:#x} is unknown; combine DM_MESH_ constants");
        Ok(self.flags & flag != 0)
    }

    fn tolerance(&self) -> Result<Tolerance> {
        let default = if self.has(DM_MESH_KEEP_ALL)? { Tolerance::ZERO } else { Tolerance::default() };
        let position = or(self.position_tolerance, default.position);
        Ok(Tolerance { position, normal: or(self.normal_tolerance, default.normal) })
    }

    /// Whether the description says nothing about packing, so that a packed mesh may stay as it is.
    fn packs_by_default(&self) -> bool {
        let errors = [self.position_error, self.normal_error_degrees, self.absolute_error, self.weight_max];
        self.delta_format == 0 && self.block_size == 0 && errors == [0.0; 4]
    }

    fn pack_desc(&self) -> Result<PackDesc> {
        let format = delta_format(self.delta_format)?;
        let mut desc = match self.engine.bits() {
            0 => PackDesc::new(format),
            _ => self.engine.get()?.morph.pack_desc(format),
        };
        desc.tolerance = self.tolerance()?;
        let default = BlockDesc::default();
        let blocks = BlockDesc {
            size: (self.block_size != 0).then_some(self.block_size),
            position_error: or(self.position_error, default.position_error),
            normal_error_degrees: or(self.normal_error_degrees, default.normal_error_degrees),
            absolute_error: or(self.absolute_error, default.absolute_error),
            weight_max: or(self.weight_max, default.weight_max),
        };
        Ok(PackDesc { blocks, ..desc })
    }

    /// Tells the host what an importer noted.
    fn tell(&self, notes: &[String]) {
        let Some(message) = self.message else { return };
        for note in notes {
            let text = c_string(note);
            // SAFETY: the host promised that this pointer is a function of this signature, callable with these
            // arguments.
            unsafe { message(self.message_user, DM_MESSAGE_NOTE, text.as_ptr()) };
        }
    }
}

impl Mesh {
    pub(crate) fn of_source(mut source: deltamorph::Mesh, desc: &DmMeshDesc) -> Result<Self> {
        desc.tell(&source.notes);
        if desc.has(DM_MESH_SPLIT)? {
            source = source.split()?;
        }
        if desc.has(DM_MESH_WELD)? {
            source.weld()?;
        }
        Ok(Self::new(source.pack(&desc.pack_desc()?)?))
    }

    /// The mesh of a packed file, packed again if `desc` says how.
    fn of_packed(packed: PackedMesh, desc: &DmMeshDesc) -> Result<Self> {
        desc.tell(&packed.notes);
        if desc.packs_by_default() {
            Ok(Self::new(packed))
        } else {
            Ok(Self::new(PackedMesh::pack(&packed.unpack()?, &desc.pack_desc()?)?))
        }
    }

    fn new(packed: PackedMesh) -> Self {
        let names = packed.layout().targets.iter().map(|target| c_string(&target.name)).collect();
        Self { packed, names }
    }

    pub(crate) fn layout(&self) -> &PackedLayout {
        self.packed.layout()
    }
}

/// The common part of entries that make a mesh.
///
/// # Safety
/// The conditions of [`read_or_default`]; `out` is null or can be written.
pub(crate) unsafe fn create(
    function: &str,
    desc: *const DmMeshDesc,
    out: *mut DmMesh,
    make: impl FnOnce(&DmMeshDesc) -> Result<Mesh>,
) -> DmResult {
    enter(function, || {
        check_place(out, "mesh")?;
        // SAFETY: the caller's obligations; `out` was checked.
        unsafe {
            let desc = read_or_default(desc)?;
            out.write(DmMesh::insert(make(&desc)?));
        }
        Ok(())
    })
}

/// Read a mesh: a folder with neutral.obj and a folder `targets` of OBJ files, a glTF file (.glb, .gltf, .vrm; feature
/// `gltf`), or a packed file (.dmorph), which is packed again only if `desc` says how.
///
/// Targets of a folder are in the order of their files' names, those of a glTF file in the order of the file. Vertices
/// of OBJ files are their `v` lines, in order.
///
/// Normals that a file does not state are computed: each is the normalised sum of the area vectors of the faces around
/// the vertex. A polygon counts with its whole area vector at each of its corners, so the result differs from that of
/// the triangles that it is drawn as. If the sum is zero (no face, or faces without area), the normal is (0, 0, 1). The
/// normal delta of a target is the difference of two such normals; 0 if the deformed surface has none.
///
/// DmMeshDesc::message receives what of the file was left out, merged, averaged or computed.
///
/// Errors: DM_ERROR_IO if nothing is at `path`, or it cannot be read; DM_ERROR_INPUT with the file, the position in it
/// and a remedy; DM_ERROR_INVALID for invalid fields of `desc`.
///
/// # Safety
/// `path` is a UTF-8 string; `desc` is null (the defaults) or a structure; `mesh` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_open(path: *const c_char, desc: *const DmMeshDesc, mesh: *mut DmMesh) -> DmResult {
    let make = |desc: &DmMeshDesc| {
        // SAFETY: the caller's obligation.
        let path = Path::new(unsafe { text(path, "path") }?);
        let Imported { mesh, .. } = open(path)?;
        match mesh {
            ImportedMesh::Source(source) => Mesh::of_source(source, desc),
            ImportedMesh::Packed(packed) => Mesh::of_packed(packed, desc),
        }
    };
    // SAFETY: the caller's obligations.
    unsafe { create("dm_mesh_open", desc, mesh, make) }
}

/// Read a mesh from the bytes of a packed file (.dmorph) in memory. `name` is for messages, and may be null.
///
/// Errors: DM_ERROR_INPUT with the position in the file; those of `dm_mesh_open`.
///
/// # Safety
/// There are `size` bytes at `bytes`; `name` is null or a UTF-8 string; `desc` is null (the defaults) or a structure;
/// `mesh` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_from_bytes(
    bytes: *const c_void,
    size: usize,
    name: *const c_char,
    desc: *const DmMeshDesc,
    mesh: *mut DmMesh,
) -> DmResult {
    let make = |desc: &DmMeshDesc| {
        // SAFETY: the caller's obligation.
        let bytes = unsafe { slice(bytes.cast::<u8>(), size, "bytes") }?;
        // SAFETY: as above.
        let name = unsafe { text_or_empty(name, "name") }?;
        let name = if name.is_empty() { "bytes in memory" } else { name };
        Mesh::of_packed(PackedMesh::from_bytes(name, bytes)?, desc)
    };
    // SAFETY: the caller's obligations.
    unsafe { create("dm_mesh_from_bytes", desc, mesh, make) }
}

/// Make a mesh from arrays with one element per vertex. If vertices are doubled at seams, set `DM_MESH_WELD` in `desc`:
/// then no crack opens in any pose, and computed normals are smooth across the seam.
///
/// Errors: DM_ERROR_INVALID for numbers that are not finite, indices out of range, two targets of the same name.
///
/// # Safety
/// `arrays` is a structure whose arrays have the elements that it says; `desc` is null (the defaults) or a structure;
/// `mesh` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_from_arrays(
    arrays: *const DmMeshArrays,
    desc: *const DmMeshDesc,
    mesh: *mut DmMesh,
) -> DmResult {
    // SAFETY: the caller's obligations.
    let make = |desc: &DmMeshDesc| Mesh::of_source(unsafe { source_of_arrays(arrays) }?, desc);
    // SAFETY: the caller's obligations.
    unsafe { create("dm_mesh_from_arrays", desc, mesh, make) }
}

/// # Safety
/// The conditions of [`dm_mesh_from_arrays`].
unsafe fn source_of_arrays(arrays: *const DmMeshArrays) -> Result<deltamorph::Mesh> {
    // SAFETY: the caller's obligations, of this array and of each of its targets below.
    let arrays = unsafe { read(arrays) }?;
    let count = arrays.vertex_count as usize;
    // SAFETY: as above.
    let structures = unsafe { array(arrays.targets, arrays.target_count) }?;
    let of_target = |target: &DmTargetArrays| {
        let array = |pointer, what| {
            // SAFETY: as above.
            unsafe { vertices(pointer, (count, target.stride), what) }
        };
        Ok([
            array(target.positions, "positions of a target")?,
            array(target.normals, "normals of a target")?,
            array(target.tangents, "tangents of a target")?,
        ])
    };
    let vectors = structures.iter().map(of_target).collect::<Result<Vec<[Cow<'_, [[f32; 3]]>; 3]>>>()?;
    let mut targets = Vec::new();
    for (target, [positions, normals, tangents]) in structures.iter().zip(&vectors) {
        // SAFETY: as above.
        let name = unsafe { text_or_empty(target.name, "name of a target") }?;
        targets.push(TargetArrays { name, positions, normals, tangents });
    }
    let vertex = (count, arrays.stride);
    ensure!(count == 0 || !arrays.positions.is_null(), "'positions' is a null pointer; hand in an array");
    // SAFETY: as above.
    let arrays = unsafe {
        MeshArrays {
            name: text_or_empty(arrays.name, "name")?,
            positions: &vertices(arrays.positions, vertex, "positions")?,
            normals: &vertices(arrays.normals, vertex, "normals")?,
            tangents: &vertices(arrays.tangents, vertex, "tangents")?,
            texcoords: &vertices(arrays.texcoords, vertex, "texcoords")?,
            indices: slice(arrays.indices, arrays.index_count as usize, "indices")?,
            targets: &targets,
            absolute: arrays.absolute != 0,
        }
    };
    Ok(deltamorph::Mesh::from_arrays(&arrays)?)
}

/// An array of vectors for each vertex, `stride` bytes apart, or contiguous for 0; empty for a null pointer.
///
/// # Safety
/// The conditions of [`slice()`], for as many bytes.
unsafe fn vertices<'a, const N: usize>(
    first: *const f32,
    (count, stride): (usize, u32),
    what: &str,
) -> Result<Cow<'a, [[f32; N]]>> {
    let size = size_of::<[f32; N]>();
    if first.is_null() {
        return Ok(Cow::Borrowed(&[]));
    }
    if stride == 0 || stride as usize == size {
        // SAFETY: the caller's obligation.
        return Ok(Cow::Borrowed(unsafe { slice(first.cast(), count, what) }?));
    }
    let fits = stride.is_multiple_of(4) && stride as usize >= size;
    ensure!(fits, "'stride' is {stride}; use a multiple of 4, and at least the {size} bytes of {what}");
    // SAFETY: as above; `read_unaligned` takes any address.
    let vector = |v: usize| unsafe { first.byte_add(v * stride as usize).cast::<[f32; N]>().read_unaligned() };
    Ok(Cow::Owned((0..count).map(vector).collect()))
}

/// Write a mesh as a packed file (.dmorph), which `dm_mesh_open` and `dm_mesh_from_bytes` read without packing again.
/// An old file stays until the new one is complete.
///
/// Errors: DM_ERROR_IO if it cannot be written.
///
/// # Safety
/// `path` is a UTF-8 string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_mesh_write(mesh: DmMesh, path: *const c_char) -> DmResult {
    enter("dm_mesh_write", || {
        // SAFETY: the caller's obligation.
        let path = Path::new(unsafe { text(path, "path") }?);
        Ok(mesh.get()?.packed.write(path)?)
    })
}

/// Destroy a mesh, with the names of its targets. Objects made from it stay.
#[unsafe(no_mangle)]
pub extern "C" fn dm_mesh_destroy(mesh: DmMesh) -> DmResult {
    enter("dm_mesh_destroy", || mesh.destroy(|_| Ok(())))
}
