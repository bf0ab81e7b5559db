//! A scene of faces of several rigs, after table 6 of Kavan et al., "Compressed Skinning for Facial Blendshapes"
//! (SIGGRAPH 2024): ten faces each of four rigs.

use super::techniques::{self, SPARSE, Technique};
use crate::bench::configs::Config;
use crate::bench::record::Skipped;
use crate::bench::session::Session;
use crate::bench::workload::Workload;
use crate::input;
use crate::output::Failure;
use deltamorph::{DeltaFormat, PoseFormat, UpdateMode, UpdatePath};
use deltamorph_head::{HeadDesc, head_clip};

/// Vertices and targets of Aura, Jupiter, Proteus and Bowen, which are not public; the built-in head takes their place.
const RIGS: [(usize, usize); 4] = [(5_944, 267), (5_944, 319), (23_735, 287), (23_735, 253)];
const FACES: u32 = 40;
/// The targets that the clip animates; the others, correctives in the paper's rigs, stay at 0.
const ANIMATED: usize = 72;
const FRAMES: usize = 300;
/// Ours, a rebuild in compute passes, and every active target evaluated in each draw.
const PATHS: [UpdatePath; 3] = [UpdatePath::Blocks, UpdatePath::Compute, UpdatePath::Direct];
/// Formats of `blocks`, each a technique of its own. Poses are fixed point: of so many targets, the bound on float32
/// ones is wide.
const FORMATS: [DeltaFormat; 2] = [DeltaFormat::Fast, DeltaFormat::Small];

/// All faces in one submission, each at its own frame of the clip.
pub fn run(session: &mut Session<'_>) -> Result<(), Failure> {
    let args = &session.args.input;
    if args.input.is_some() {
        let reason = "is of the built-in head in four sizes; leave INPUT out".into();
        session.skip(Skipped { what: "suite faces".into(), reason });
        return Ok(());
    }
    let (mut inputs, mut workloads) = (vec![], vec![]);
    for (vertices, targets) in RIGS {
        let mut args = args.clone();
        // As many as asked for in the largest rig, and in proportion in the others.
        args.head.vertices = Some(args.head.vertices.map_or(vertices, |most| (most * vertices / 23_735).max(1)));
        args.head.targets = Some(args.head.targets.map_or(targets, |most| most * targets / 319));
        args.head.sparsity.get_or_insert(SPARSE);
        let mut input = input::load(&args, true, session.out)?;
        let mesh = &input.kept;
        let names: Vec<&str> = mesh.targets.iter().map(|target| target.name.as_str()).collect();
        let clip = head_clip(&HeadDesc::default().targets(names.len().min(ANIMATED)).seed(args.seed), FRAMES, 30.0);
        workloads.push(Workload::clip(&clip.bind(&names)?));
        input.name = format!("{} vertices × {} targets", mesh.vertex_count(), mesh.targets.len());
        inputs.push(input);
    }
    let named = !session.args.update.formats.is_empty();
    let keep = |config: &Config| match config.desc.path {
        UpdatePath::Blocks => config.desc.pose.has_integers() && (named || FORMATS.contains(&config.format)),
        UpdatePath::Compute => config.desc.mode == UpdateMode::Rebuild,
        _ => true,
    };
    let mut all: Vec<Technique> = vec![];
    for (name, configs) in techniques::all(session, &PATHS, &[PoseFormat::Float32, PoseFormat::Fixed16]) {
        let configs: Vec<Config> = configs.into_iter().filter(keep).collect();
        match configs.first().map(|config| config.desc.path) {
            Some(UpdatePath::Blocks) => {
                let animated = configs.iter().take(1).map(|c| Config { animated: true, ..c.clone() });
                all.extend(animated.map(|config| (format!("{name} animated"), vec![config])));
                all.extend(configs.into_iter().map(|c| (format!("{name} {}", c.format.name()), vec![c])));
            }
            Some(_) => all.push((name, configs)),
            None => {}
        }
    }
    let scene = (inputs, vec![(workloads, format!("a clip of {ANIMATED} columns"))]);
    techniques::run(session, vec![scene], &[FACES], &all)
}
