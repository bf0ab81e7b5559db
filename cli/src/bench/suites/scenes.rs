//! What suites measure: meshes, and their workloads.

use crate::args::{HeadArgs, InputArgs, distinct_or};
use crate::bench::record::Skipped;
use crate::bench::session::Session;
use crate::bench::workload::Workload;
use crate::input::{self, Input};
use crate::output::Result;
use deltamorph::KeptMesh;
use deltamorph_head::{HeadDesc, head_clip};
use std::path::PathBuf;

/// The meshes of a scene; and workloads, one for each mesh, with a description.
pub type Scene = (Vec<Input>, Vec<(Vec<Workload>, String)>);

/// The built-in head of this size, as `args` have it otherwise.
fn head_of(args: &InputArgs, head: HeadArgs, session: &Session<'_>) -> Result<Input> {
    let input = input::load(&InputArgs { head, ..args.clone() }, false, session.out)?;
    let name = format!("{} vertices × {} targets", input.kept.vertex_count(), input.kept.targets.len());
    Ok(Input { name, ..input })
}

/// Default mean fraction of the vertices that a target of the sparse head moves.
const SPARSE: f32 = 0.08;

/// The built-in head, dense and sparse; or only INPUT, if given.
fn dense_and_sparse(session: &Session<'_>) -> Result<Vec<Input>> {
    let args = &session.args.input;
    if args.input.is_some() {
        return Ok(vec![input::load(args, false, session.out)?]);
    }
    let sparse = args.head.sparsity.unwrap_or(SPARSE);
    let heads = [("dense".to_owned(), 1.0), (format!("{}% sparse", sparse * 100.0), sparse)];
    let load = |(name, sparsity)| -> Result<Input> {
        let head = HeadArgs { sparsity: Some(sparsity), ..args.head.clone() };
        Ok(Input { name, ..head_of(args, head, session)? })
    };
    heads.into_iter().map(load).collect()
}

/// Changed targets in two workloads: the others keep their weights in one, and are 0 or constant in the other.
const FEW: usize = 8;
const ACTIVE: usize = 4;

/// All targets changed, few, and few beside constant ones, each on a dense and a sparse mesh.
pub fn made_up(session: &Session<'_>) -> Result<Vec<Scene>> {
    let seed = session.args.input.seed;
    let workloads = |input: Input| {
        let n = input.kept.targets.len();
        let (few, active) = (FEW.min(n), ACTIVE.min(n));
        let mut works = vec![
            (vec![Workload::random(n, n, seed)], format!("all {n} changed")),
            (vec![Workload::random(n, few, seed)], format!("{few} of {n} changed")),
        ];
        works.extend(distinct_or(&session.args.constant, &[0]).into_iter().map(|constant| {
            let constant = constant.min(n - active);
            let change = match constant {
                0 => format!("{active} non-zero of {n}"),
                _ => format!("{active} of {n} changed, {constant} constant"),
            };
            (vec![Workload::few(n, active, constant, seed)], change)
        }));
        (vec![input], works)
    };
    Ok(dense_and_sparse(session)?.into_iter().map(workloads).collect())
}

/// Points along the axis of targets.
const POINTS: usize = 6;

/// The sparse mesh with more and more of its targets, all of which change, after Costigan et al. (MIG 2016), figures 5
/// and 6.
pub fn kept(session: &Session<'_>) -> Result<Vec<Scene>> {
    let Some(all) = dense_and_sparse(session)?.pop() else { return Ok(vec![]) };
    let total = all.kept.targets.len();
    let mut counts: Vec<usize> = (1..=POINTS).map(|i| (total * i / POINTS).max(1.min(total))).collect();
    counts.dedup();
    let scene = |count| {
        let mut kept = KeptMesh::clone(&all.kept);
        kept.targets.truncate(count);
        let (name, origin) = (format!("{}, {count} targets", all.name), all.origin.clone());
        let input = Input { name, kept: kept.into(), origin, ..Input::default() };
        (vec![input], vec![(vec![Workload::random(count, count, session.args.input.seed)], "all changed".into())])
    };
    Ok(counts.into_iter().map(scene).collect())
}

/// A face for crowds of thousands, of whose targets a third change in each frame.
pub fn many(session: &Session<'_>) -> Result<Vec<Scene>> {
    let (args, head) = (&session.args.input, &session.args.input.head);
    let size = HeadArgs {
        vertices: head.vertices.or(Some(2_700)),
        targets: head.targets.or(Some(52)),
        sparsity: head.sparsity.or(Some(0.17)),
    };
    let input = match args.input {
        Some(_) => input::load(args, false, session.out)?,
        None => head_of(args, size, session)?,
    };
    let n = input.kept.targets.len();
    let third = n.div_ceil(3);
    let workload = Workload::random(n, third, session.args.input.seed);
    Ok(vec![(vec![input], vec![(vec![workload], format!("{third} of {n} changed"))])])
}

/// Vertices and targets of Aura, Jupiter, Proteus and Bowen, which are not public; the built-in head takes their place.
const RIGS: [(usize, usize); 4] = [(5_944, 267), (5_944, 319), (23_735, 287), (23_735, 253)];
/// The targets that the clip animates; the others, correctives in the paper's rigs, stay at 0.
const ANIMATED: usize = 72;
const FRAMES: usize = 300;

/// Faces of four rigs, each at its own frame of a clip, after table 6 of Kavan et al., "Compressed Skinning for Facial
/// Blendshapes" (SIGGRAPH 2024): ten faces each of four rigs.
pub fn faces(session: &mut Session<'_>) -> Result<Vec<Scene>> {
    let args = &session.args.input;
    if args.input.is_some() {
        let reason = "measures the built-in head in four sizes; leave out INPUT".into();
        session.skip(Skipped { what: "suite faces".into(), reason });
        return Ok(vec![]);
    }
    let (mut inputs, mut workloads) = (vec![], vec![]);
    for (vertices, targets) in RIGS {
        let head = &args.head;
        // As many as options state in the largest rig, and in proportion in the others.
        let size = HeadArgs {
            vertices: Some(head.vertices.map_or(vertices, |most| (most * vertices / 23_735).max(1))),
            targets: Some(head.targets.map_or(targets, |most| most * targets / 319)),
            sparsity: head.sparsity.or(Some(SPARSE)),
        };
        let input = head_of(args, size, session)?;
        let names = input.targets();
        let clip = head_clip(
            &HeadDesc { targets: names.len().min(ANIMATED), seed: args.seed, ..Default::default() },
            FRAMES,
            30.0,
        );
        workloads.push(Workload::clip(&clip.bind(&names)?));
        inputs.push(input);
    }
    Ok(vec![(inputs, vec![(workloads, format!("a clip of {ANIMATED} columns"))])])
}

/// The clips of INPUT.
pub fn captured(session: &mut Session<'_>, input: Input) -> Result<Vec<Scene>> {
    let read = |path: &PathBuf| input.clip(path, &[]).map(|clip| (vec![Workload::clip(&clip)], clip.name.clone()));
    let works: Vec<_> = input.clips.iter().map(read).collect::<Result<_, _>>()?;
    if works.is_empty() {
        let reason = format!("{} has no clip; give INPUT with weights/*.csv or animations of weights", input.origin);
        session.skip(Skipped { what: "suite clips".into(), reason });
        return Ok(vec![]);
    }
    Ok(vec![(vec![input], works)])
}
