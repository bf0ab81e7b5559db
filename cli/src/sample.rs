//! `sample`: writes the built-in head as a folder that any morph-target tool can read.

use crate::args::SampleArgs;
use crate::output::{Output, Result, claim, create_folder, publish};
use crate::table::thousands;
use deltamorph::Mesh;
use deltamorph::import::csv;
use deltamorph::import::obj::{ObjMesh, write_obj};
use deltamorph::internals::write_replacing;
use deltamorph_head as head;
use glam::Vec3;
use std::path::Path;

pub fn run(args: &SampleArgs, out: &Output) -> Result<()> {
    out.check(&[], &[], Some(&args.dir))?;
    // Files of an earlier run would be read as targets of this one.
    claim(&args.dir, "is not empty; name a new one", || false)?;
    let desc = args.head.desc(args.seed);
    let spinner = out.spinner("building the head");
    let source = head::head(&desc);
    let mut clip = head::head_clip(&desc, args.frames, args.fps);
    drop(spinner);

    let bar = out.bar(source.targets.len() as u64 + 1);
    // Readers take the rate from the name, since the file has no place for it.
    clip.name = format!("{}_{}fps", if clip.name.is_empty() { "clip" } else { &clip.name }, args.fps);
    publish(
        &args.dir,
        |_| false,
        |dir| {
            // Without targets there is no column, and so no clip.
            if !source.targets.is_empty() {
                create_folder(&dir.join("weights"))?;
                csv::write(&dir.join("weights").join(format!("{}.csv", clip.name)), &clip)?;
            }
            write_folder(&source, dir, || bar.inc(1))
        },
    )?;

    let SampleArgs { dir, fps, seed, .. } = args;
    let (vertices, targets, frames) = (source.positions.len(), source.targets.len(), clip.frame_count());
    let (folder, count) = (dir.display(), thousands(vertices));
    out.say(format_args!("{folder}: {count} vertices, {targets} targets, a weight clip of {frames} frames"));
    out.json(&serde_json::json!({
        "schema": 1, "folder": dir, "vertices": vertices, "targets": targets, "frames": frames, "fps": fps, "seed": seed,
    }))
}

/// Writes `targets/*.obj` and `neutral.obj`, calling `step` after each file. Every position and normal is read back
/// exactly.
fn write_folder(source: &Mesh, dir: &Path, mut step: impl FnMut()) -> Result<()> {
    let targets = dir.join("targets");
    create_folder(&targets)?;
    let base_normals = source.normals.as_deref().unwrap_or_default();
    let file = |positions: &[Vec3], normals: &[Vec3], path: &Path| {
        let mesh = ObjMesh { positions, normals, texcoords: &source.texcoords, faces: &source.faces };
        write_replacing(path, |out| write_obj(out, mesh))
    };
    for target in &source.targets {
        let mut positions = source.positions.clone();
        add(&mut positions, &target.positions);
        let mut normals = base_normals.to_vec();
        match &target.normals {
            Some(deltas) if !normals.is_empty() => add(&mut normals, deltas),
            // Normals "computed from the surface": writing the base's would state that they do not change.
            _ => normals.clear(),
        }
        file(&positions, &normals, &targets.join(format!("{}.obj", target.name)))?;
        step();
    }
    file(&source.positions, base_normals, &dir.join("neutral.obj"))?;
    step();
    Ok(())
}

fn add(to: &mut [Vec3], deltas: &[(u32, Vec3)]) {
    for &(i, delta) in deltas {
        to[i as usize] += delta;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::Tolerance;
    use deltamorph::import::obj;
    use deltamorph_head::HeadDesc;

    #[test]
    fn the_folder_reads_back_as_the_head() {
        let desc = HeadDesc { vertices: 500, targets: 9, sparsity: 0.2, seed: 3 };
        let source = head::head(&desc);
        let dir = tempfile::tempdir().expect("a folder");
        write_folder(&source, dir.path(), || ()).expect("written");
        let read = obj::import_folder(dir.path()).expect("read");
        assert_eq!(read.positions, source.positions);
        assert_eq!(read.faces, source.faces);
        let (a, b) = (source.kept(Tolerance::default()), read.kept(Tolerance::default()));
        let (a, b) = (a.expect("the head"), b.expect("the folder"));
        assert_eq!(a.targets.len(), b.targets.len());
        for target in &a.targets {
            // Files are read back sorted by name.
            let other = &b.targets[b.target_index(&target.name).expect("same names")];
            assert_eq!(other.vertices, target.vertices, "{}", target.name);
            // A file holds base + delta as floats: the delta is read back to within their rounding, and normals to
            // within the rotation that this causes.
            let near = |a: &[Vec3], b: &[Vec3], by: f32| a.iter().zip(b).all(|(a, b)| a.distance(*b) <= by);
            assert!(near(&other.positions, &target.positions, a.diagonal * f32::EPSILON), "{}", target.name);
            assert!(near(&other.normals, &target.normals, 1e-4), "{}", target.name);
        }
    }
}
