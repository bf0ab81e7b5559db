//! The C API without a device: any sequence of calls, many with arguments that the header says are refused. A panic is
//! a finding; so is an error without a message, a result written by a call that failed, or a handle that is returned
//! twice.

use crate::{Memory, Target, bounded};
use arbitrary::{Result, Unstructured};
use deltamorph_c::handles::*;
use deltamorph_c::memory::Versioned;
use deltamorph_c::result::{DM_ERROR_PANIC, DM_OK, DmResult, dm_last_error};
use deltamorph_c::structs::*;
use deltamorph_c::{clip, mesh, queries};
use std::ffi::{CStr, CString, c_char};
use std::ptr::{null, null_mut};

pub const TARGET: Target = Target { name: "capi", run, mutate: |_, _| None, seeds: Vec::new };

// Kinds of handles.
const MESH: u8 = 1;
const CLIP: u8 = 5;
const BOUND_CLIP: u8 = 6;

/// Content of results before a call.
const UNTOUCHED: u64 = 0x5555_5555_5555_5555;

fn run(data: &[u8]) {
    // Forty calls, each of a small mesh or clip.
    bounded("calls", data.len(), Memory { base: 256 << 20, per_byte: 1 << 12 }, || {
        let mut calls = Calls { input: Unstructured::new(data), made: vec![] };
        for _ in 0..40 {
            if calls.input.is_empty() || calls.call().is_err() {
                break;
            }
        }
        calls.made.iter().for_each(|(kind, bits)| _ = destroy(*kind, *bits));
    });
}

fn destroy(kind: u8, bits: u64) -> DmResult {
    match kind {
        MESH => mesh::dm_mesh_destroy(DmMesh { bits }),
        CLIP => clip::dm_clip_destroy(DmClip { bits }),
        _ => clip::dm_bound_clip_destroy(DmBoundClip { bits }),
    }
}

/// Checks the rules that all functions obey.
fn check(code: DmResult) -> bool {
    if code == DM_OK {
        return true;
    }
    // SAFETY: a string of this thread, until its next failure.
    let text = unsafe { CStr::from_ptr(dm_last_error()) }.to_str().expect("UTF-8");
    assert!(code != DM_ERROR_PANIC && text.starts_with("dm_") && text.len() > 12, "{code}: {text:?}");
    false
}

/// A structure whose stated size may be wrong, in memory of that size.
struct Stated<T>(Vec<u64>, std::marker::PhantomData<T>);

impl<T: Versioned> Stated<T> {
    fn at(&mut self) -> *mut T {
        self.0.as_mut_ptr().cast()
    }
}

struct Calls<'a> {
    input: Unstructured<'a>,
    /// Kind and bits of all handles so far, including destroyed ones.
    made: Vec<(u8, u64)>,
}

impl Calls<'_> {
    /// True once in `times` calls.
    fn rarely(&mut self, times: u8) -> Result<bool> {
        Ok(self.input.int_in_range(1..=times)? == times)
    }

    /// Chooses a handle: mostly one of the kind.
    fn handle(&mut self, kind: u8) -> Result<u64> {
        if self.rarely(16)? {
            return if self.made.is_empty() || self.rarely(2)? {
                self.input.arbitrary()
            } else {
                Ok(self.input.choose(&self.made)?.1)
            };
        }
        let of: Vec<u64> = self.made.iter().rev().filter(|made| made.0 == kind).take(4).map(|made| made.1).collect();
        if of.is_empty() { Ok(0) } else { Ok(*self.input.choose(&of)?) }
    }

    fn made(&mut self, kind: u8, code: DmResult, bits: u64) {
        if check(code) {
            assert!(bits >> 56 == u64::from(kind) && !self.made.contains(&(kind, bits)), "the handle {bits:#x}");
            self.made.push((kind, bits));
        } else {
            assert_eq!(bits, UNTOUCHED, "a result is written in spite of error {code}");
        }
    }

    /// Chooses a number: mostly small, sometimes any.
    fn count(&mut self, most: u32) -> Result<u32> {
        if self.rarely(16)? { self.input.arbitrary() } else { self.input.int_in_range(0..=most) }
    }

    fn float(&mut self) -> Result<f32> {
        Ok(match self.input.int_in_range(0..=15u8)? {
            0 => f32::NAN,
            1 => f32::INFINITY,
            2 | 3 => f32::from_bits(self.input.arbitrary()?),
            4..=7 => 0.0,
            _ => f32::from(self.input.arbitrary::<i8>()?) / 64.0,
        })
    }

    fn floats(&mut self, count: usize) -> Result<Vec<f32>> {
        let some: Vec<f32> = (0..self.input.int_in_range(1..=6u8)?).map(|_| self.float()).collect::<Result<_>>()?;
        Ok((0..count).map(|i| some[i % some.len()] + (i % 7) as f32 * 0.125).collect())
    }

    /// Returns the pointer, or sometimes null.
    fn or_null<T>(&mut self, pointer: *mut T) -> Result<*mut T> {
        Ok(if self.rarely(12)? { null_mut() } else { pointer })
    }

    fn text(&mut self) -> Result<CString> {
        let known = ["t0", "t1", "t2", "jawOpen", "", "eyeBlinkLeft", "\u{e4}"];
        let bytes = if self.rarely(8)? {
            self.input.arbitrary::<[u8; 4]>()?.to_vec()
        } else {
            self.input.choose(&known)?.as_bytes().to_vec()
        };
        Ok(CString::new(bytes).unwrap_or_default())
    }

    fn stated<T: Versioned>(&mut self, mut value: T) -> Result<Stated<T>> {
        let right = size_of::<T>();
        let size = if self.rarely(8)? { self.input.int_in_range(0..=right + 24)? } else { right };
        let mut room = vec![0u64; right.max(size) / 8 + 1];
        // SAFETY: structures begin with their size, and there is room for what it states.
        unsafe {
            (&raw mut value).cast::<u32>().write_unaligned(size as u32);
            room.as_mut_ptr().cast::<u8>().copy_from_nonoverlapping((&raw const value).cast(), right);
        }
        if size > right && self.input.arbitrary()? {
            room[right / 8] |= 1 << (right % 8 * 8);
        }
        Ok(Stated(room, std::marker::PhantomData))
    }

    fn mesh_desc(&mut self) -> Result<Stated<DmMeshDesc>> {
        let mut desc = DmMeshDesc::zeroed();
        desc.delta_format = self.input.int_in_range(0..=7)?;
        desc.block_size = *self.input.choose(&[0, 0, 32, 64, 128, 7])?;
        desc.flags = *self.input.choose(&[4, 4, 4, 0, 1, 2, 8])?;
        if self.rarely(4)? {
            (desc.position_tolerance, desc.normal_tolerance) = (self.float()?, self.float()?);
            (desc.position_error, desc.normal_error_degrees) = (self.float()?, self.float()?);
            (desc.absolute_error, desc.weight_max) = (self.float()?, self.float()?);
            desc.engine.bits = self.handle(2)?;
        }
        self.stated(desc)
    }

    fn call(&mut self) -> Result<()> {
        match self.input.int_in_range(0..=14u8)? {
            0..=3 => self.mesh_from_arrays(),
            4 | 5 | 12 | 13 => self.queries(),
            6 | 7 | 11 => self.poses(),
            8..=10 => self.clip(),
            _ => {
                let kind = *self.input.choose(&[MESH, CLIP, BOUND_CLIP])?;
                check(destroy(kind, self.handle(kind)?));
                Ok(())
            }
        }
    }

    fn mesh_from_arrays(&mut self) -> Result<()> {
        let (vertices, targets) = (self.input.int_in_range(0..=70usize)?, self.input.int_in_range(0..=5usize)?);
        let (mut positions, mut texcoords) = (self.floats(vertices * 3)?, self.floats(vertices * 2)?);
        let (mut normals, mut tangents) =
            ([0.0f32, 0.0, 1.0].repeat(vertices), [1.0f32, 0.0, 0.0, 1.0].repeat(vertices));
        let mut moved: Vec<Vec<f32>> = (0..targets).map(|_| self.floats(vertices * 3)).collect::<Result<_>>()?;
        let beyond = usize::from(self.rarely(16)?);
        let mut indices: Vec<u32> =
            (0..self.input.int_in_range(0..=60usize)?).map(|i| (i % (vertices + beyond).max(1)) as u32).collect();
        let names: Vec<CString> = (0..targets)
            .map(|t| if self.rarely(8)? { self.text() } else { Ok(CString::new(format!("t{t}")).expect("no zero")) })
            .collect::<Result<_>>()?;
        let mut list = vec![];
        for (name, moved) in names.iter().zip(&mut moved) {
            let mut target = DmTargetArrays::zeroed();
            target.name = self.or_null(name.as_ptr().cast_mut())?;
            target.positions = self.or_null(moved.as_mut_ptr())?;
            target.normals = if self.input.arbitrary()? { null() } else { moved.as_ptr() };
            target.tangents = if self.rarely(3)? { moved.as_ptr() } else { null() };
            target.reserved = self.rarely(40)?.into();
            list.push(target);
        }
        let mut arrays = DmMeshArrays::zeroed();
        (arrays.vertex_count, arrays.index_count, arrays.target_count) =
            (vertices as u32, indices.len() as u32, targets as u32);
        arrays.positions = self.or_null(positions.as_mut_ptr())?;
        arrays.normals = self.or_null(normals.as_mut_ptr())?;
        arrays.tangents = self.or_null(tangents.as_mut_ptr())?;
        arrays.texcoords = self.or_null(texcoords.as_mut_ptr())?;
        arrays.indices = self.or_null(indices.as_mut_ptr())?;
        arrays.targets = self.or_null(list.as_mut_ptr())?;
        (arrays.absolute, arrays.reserved) = (self.input.int_in_range(0..=1)?, self.rarely(40)?.into());
        let (mut arrays, mut desc) = (self.stated(arrays)?, self.mesh_desc()?);
        let mut out = DmMesh { bits: UNTOUCHED };
        let place = self.or_null(&raw mut out)?;
        // SAFETY: arrays have the elements that are stated, or are null; structures have the room that they state.
        let code = unsafe { mesh::dm_mesh_from_arrays(arrays.at(), desc.at(), place) };
        self.made(MESH, code, out.bits);
        Ok(())
    }

    fn info(&self, mesh: DmMesh) -> Option<DmMeshInfo> {
        let mut info = DmMeshInfo::zeroed();
        // SAFETY: a structure.
        check(unsafe { queries::dm_mesh_info(mesh, &raw mut info) }).then_some(info)
    }

    fn queries(&mut self) -> Result<()> {
        let mesh = DmMesh { bits: self.handle(MESH)? };
        let (number, name) = (self.count(5)?, self.text()?);
        let mut info = self.stated(DmMeshInfo::zeroed())?;
        let (mut target, mut found): (u32, *const c_char) = (77, null());
        // SAFETY: structures have the room that they state, places can be written.
        unsafe {
            check(queries::dm_mesh_info(mesh, info.at()));
            check(queries::dm_mesh_find_target(mesh, name.as_ptr(), &raw mut target));
            if check(queries::dm_mesh_target_name(mesh, number, &raw mut found)) {
                CStr::from_ptr(found).to_str().expect("UTF-8");
            }
        }
        let mut indices: Vec<u32> =
            (0..self.input.int_in_range(0..=9u8)?).map(|_| self.count(70)).collect::<Result<_>>()?;
        let before = indices.clone();
        // SAFETY: there are as many.
        if !check(unsafe { queries::dm_mesh_remap_indices(mesh, indices.as_mut_ptr(), indices.len()) }) {
            assert_eq!(indices, before, "changed by a call that failed");
        }
        let mut room = 0;
        // SAFETY: null asks for their number.
        if check(unsafe { queries::dm_mesh_indices(mesh, &raw mut room, null_mut()) }) {
            let mut indices = vec![0; room as usize];
            let mut given = if self.input.arbitrary()? { room } else { room / 2 };
            // SAFETY: there is as much room.
            check(unsafe { queries::dm_mesh_indices(mesh, &raw mut given, indices.as_mut_ptr()) });
            let most = self.info(mesh).map_or(0, |info| info.padded_vertex_count);
            assert!(indices.iter().all(|index| *index < most.max(1)), "an index beyond the vertices");
        }
        let mut vertices = DmRenderVertices::zeroed();
        // SAFETY: null asks for their number.
        if check(unsafe { queries::dm_mesh_render_vertices(mesh, &raw mut vertices) }) {
            let count = vertices.vertex_count as usize;
            let (mut pose, mut uv, mut indices) =
                (vec![0; count], vec![0.0; 2 * count], vec![0; vertices.index_count as usize]);
            (vertices.pose_vertices, vertices.texcoords, vertices.indices) =
                (pose.as_mut_ptr(), uv.as_mut_ptr(), indices.as_mut_ptr());
            let short = count > 0 && self.rarely(4)?;
            vertices.vertex_count -= u32::from(short);
            // SAFETY: there is as much room.
            assert_eq!(check(unsafe { queries::dm_mesh_render_vertices(mesh, &raw mut vertices) }), !short);
        }
        Ok(())
    }

    fn poses(&mut self) -> Result<()> {
        let mesh = DmMesh { bits: self.handle(MESH)? };
        let (vertices, targets) =
            self.info(mesh).map_or((3, 1), |info| (info.vertex_count as usize, info.target_count as usize));
        let count = if self.rarely(5)? { self.input.int_in_range(0..=8)? } else { targets };
        let weights = self.floats(count)?;
        let mut pose = vec![0.0; if self.rarely(5)? { vertices } else { 6 * vertices }];
        // SAFETY: there are as many weights, and as much room.
        check(unsafe {
            queries::dm_mesh_evaluate(mesh, weights.as_ptr(), count as u32, pose.as_mut_ptr(), pose.len())
        });
        Ok(())
    }

    fn clip(&mut self) -> Result<()> {
        let (frames, columns) = (self.input.int_in_range(0..=5usize)?, self.input.int_in_range(0..=4usize)?);
        let names = (0..columns).map(|_| self.text()).collect::<Result<Vec<_>>>()?;
        let mut pointers = names
            .iter()
            .map(|name| Ok(self.or_null(name.as_ptr().cast_mut())?.cast_const()))
            .collect::<Result<Vec<_>>>()?;
        let values = self.floats(frames * columns)?;
        let mut arrays = DmClipArrays::zeroed();
        (arrays.frame_count, arrays.column_count) = (frames as u32, columns as u32);
        (arrays.names, arrays.values) = (self.or_null(pointers.as_mut_ptr())?, values.as_ptr());
        arrays.fps = if self.rarely(4)? { self.float()? } else { 30.0 };
        let mut arrays = self.stated(arrays)?;
        let (mut out, mut bound) = (DmClip { bits: UNTOUCHED }, DmBoundClip { bits: UNTOUCHED });
        // SAFETY: arrays have the elements that are stated, or are null.
        let code = unsafe { clip::dm_clip_from_arrays(arrays.at(), &raw mut out) };
        self.made(CLIP, code, out.bits);
        let (of, mesh) = (DmClip { bits: self.handle(CLIP)? }, DmMesh { bits: self.handle(MESH)? });
        let mut info = self.stated(DmClipInfo::zeroed())?;
        // SAFETY: as above.
        let code = unsafe {
            check(clip::dm_clip_info(of, info.at()));
            clip::dm_clip_bind(of, mesh, &raw mut bound)
        };
        self.made(BOUND_CLIP, code, bound.bits);
        let mut room = vec![0.0; self.input.int_in_range(0..=60usize)?];
        let frame = *self.input.choose(&[0.0, 0.5, 3.25, f64::NAN, f64::INFINITY, -1e300])?;
        let bound = DmBoundClip { bits: self.handle(BOUND_CLIP)? };
        // SAFETY: there is as much room.
        check(unsafe { clip::dm_bound_clip_sample(bound, frame, room.as_mut_ptr(), room.len() as u32) });
        Ok(())
    }
}
