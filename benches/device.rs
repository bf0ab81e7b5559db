//! Where the time of the path `blocks` goes on a device: bytes moved over time, against the bandwidth
//! measured in the same run, by tile width, workgroup, block size, formats and number of heads.
//!
//! `./with-vulkan cargo bench -p deltamorph-benches --bench device [-- [DEVICE] [HEADS,…]]`; with `DELTAMORPH_DATA`, of
//! ict_facekit in place of the built-in head. Without a list: 1,10,100,1000,10000 heads, which takes a GPU a minute;
//! 1,4 are for a software driver.

use deltamorph::device::DeviceTuning;
use deltamorph::import::obj;
use deltamorph::reference::{compare, evaluate};
use deltamorph::{
    AnimationDesc, BlockDesc, CrowdDesc, DeltaFormat, MorphMesh, PackedMesh, Playback, PoseFormat, Result, Tolerance,
    UpdateDesc, WeightClip,
};
use deltamorph_benches::{median, noise};
use deltamorph_head::{HeadDesc, head};
use deltamorph_headless::{DeviceChoice, Headless, HeadlessCrowd, HeadlessDesc};

const WARMUP: usize = 3;
/// Heads of crowds whose kernels are compared.
const MANY: usize = 300;
/// Most heads whose weights come from the host, which takes longer to plan more of them than they take to run.
const PLANNED: usize = 1000;

/// Weights of a head in a frame: `changed` of them are others in each frame.
fn weights(frame: usize, head: usize, targets: usize, changed: usize) -> Vec<f32> {
    let is_moving = |t: usize| (t * 7 + head) % targets < changed;
    (0..targets).map(|t| noise(head * 977 + t + if is_moving(t) { (frame + 1) * 7_919_993 } else { 0 })).collect()
}

/// The device, a mesh, and the bandwidth of the device.
struct Bench {
    choice: DeviceChoice,
    mesh: MorphMesh,
    /// GB/s that it reads, or copies.
    rate: f64,
}

/// What is measured.
#[derive(Clone, Copy)]
struct Case {
    update: UpdateDesc,
    heads: usize,
    changed: usize,
    frames: usize,
}

impl Bench {
    fn open(&self, change: impl FnOnce(&mut DeviceTuning)) -> Headless {
        let open = |desc: HeadlessDesc| Headless::new(&desc.device(self.choice.clone())).expect("a Vulkan device");
        let mut tuning = open(HeadlessDesc::default()).caps().tuning;
        change(&mut tuning);
        let headless = open(HeadlessDesc::default().tuning(Some(tuning)));
        headless.keep_clocks_up().expect("a load");
        headless
    }

    fn pack(&self, headless: &Headless, format: DeltaFormat, size: Option<u32>) -> PackedMesh {
        let desc = headless.engine().pack_desc(format);
        PackedMesh::pack(&self.mesh, &desc.blocks(BlockDesc::default().size(size))).expect("a mesh that packs")
    }

    fn row(&self, what: &str, ms: f64, bytes: f64) {
        let rate = bytes / ms / 1e6;
        println!("| {what} | {ms:.4} | {:.1} | {rate:.0} | {:.2} |", bytes / 1e6, rate / self.rate);
    }

    /// Median device time in milliseconds and bytes of an update of all heads, whose last pose is compared.
    fn time(&self, headless: &Headless, packed: &PackedMesh, case: Case) -> Result<(f64, f64)> {
        let Case { update, heads, changed, frames } = case;
        let targets = packed.layout().targets.len();
        let desc = CrowdDesc::new(update).instances(heads as u32).frames_in_flight(1);
        let mut crowd = HeadlessCrowd::new(headless, packed, &desc)?;
        let (mut times, mut bytes, mut last) = (vec![], vec![], vec![]);
        for frame in 0..frames + WARMUP {
            let all: Vec<Vec<f32>> = (0..heads).map(|head| weights(frame, head, targets, changed)).collect();
            let step = crowd.step(&all.iter().map(Vec::as_slice).collect::<Vec<_>>())?;
            if frame >= WARMUP {
                times.push(step.gpu_ms.expect("a device with timestamps"));
                bytes.push(step.update.stats.bytes_moved as f64);
            }
            last = all;
        }
        let head = heads - 1;
        let error = compare(&crowd.read_pose(head as u32)?, &evaluate(packed, &last[head]));
        assert!(error.within(1e-3 * f64::from(packed.layout().diagonal), 10.0), "{error:?}");
        Ok((median(times), median(bytes)))
    }

    fn case(&self, what: &str, headless: &Headless, packed: &PackedMesh, case: Case) {
        match self.time(headless, packed, case) {
            Ok((ms, bytes)) => self.row(what, ms, bytes),
            Err(error) => println!("| {what} | {error} |"),
        }
    }

    /// Median device time in milliseconds of a crowd that plays a clip on the GPU, in each frame of which `changed`
    /// weights are others, and the times of the steps of one update.
    fn animated(&self, headless: &Headless, packed: &PackedMesh, case: Case) -> Result<(f64, String)> {
        let Case { update, heads, changed, frames } = case;
        let names: Vec<String> = packed.layout().targets.iter().map(|t| t.name.clone()).collect();
        let values = (0..60).flat_map(|frame| weights(frame, 0, names.len(), changed)).collect();
        let clips = [WeightClip { names, fps: 30.0, values, ..WeightClip::default() }];
        let desc = CrowdDesc::new(update).instances(heads as u32).frames_in_flight(1);
        let mut crowd = HeadlessCrowd::animated(headless, packed, &desc, &AnimationDesc::new(&clips))?;
        for head in 0..heads as u32 {
            crowd.play(head, &Playback::new(0).start(-f64::from(head) / 7.0))?;
        }
        let mut times = vec![];
        for frame in 0..frames + WARMUP {
            crowd.set_time(frame as f64 / 60.0)?;
            let step = crowd.step(&[])?;
            times.extend(step.gpu_ms.filter(|_| frame >= WARMUP));
        }
        crowd.set_time((frames + WARMUP) as f64 / 60.0)?;
        let steps = crowd.step_times()?.into_iter().map(|(name, ms)| format!("{name} {ms:.3}"));
        Ok((median(times), steps.collect::<Vec<_>>().join(", ")))
    }
}

fn title(text: &str) {
    println!("\n{text}\n\n| | ms | MB | GB/s | of the bandwidth |\n|---|---|---|---|---|");
}

fn main() {
    let (lists, names): (Vec<_>, Vec<_>) = std::env::args()
        .skip(1)
        .filter(|argument| !argument.starts_with('-'))
        .partition(|argument| argument.chars().all(|c| c.is_ascii_digit() || c == ','));
    let heads = lists.first().map_or("1,10,100,1000,10000", String::as_str);
    let heads: Vec<usize> = heads.split(',').map(|n| n.parse().expect("numbers")).collect();
    let name = names.into_iter().next();
    let choice = name.map_or(DeviceChoice::Best, DeviceChoice::Name);
    let data = std::env::var_os("DELTAMORPH_DATA").map(|data| std::path::Path::new(&data).join("ict_facekit"));
    let source = data.and_then(|folder| obj::import_folder(&folder).ok());
    let source = source.unwrap_or_else(|| head(&HeadDesc::default()));
    let mesh = source.to_mesh(Tolerance::default()).expect("a mesh");
    let many = heads.iter().copied().max().unwrap_or(1).min(MANY);

    let mut bench = Bench { choice, mesh, rate: 1.0 };
    let headless = bench.open(|_| ());
    let caps = headless.caps();
    let targets = bench.mesh.targets.len();
    println!("{} ({} {}): {:?}", caps.name, caps.driver, caps.driver_info, caps.tuning);
    for bytes in [1 << 22, 1 << 30] {
        let measured = headless.bandwidth(bytes).expect("a bandwidth").expect("a device with timestamps");
        println!("{} MiB: copy {:.0} GB/s (read and written), read {:.0}", bytes >> 20, measured.copy, measured.read);
        bench.rate = measured.copy.max(measured.read);
    }

    let blocks = |pose| UpdateDesc::blocks().pose(pose);
    let fixed16 = Case { update: blocks(PoseFormat::Fixed16), heads: many, changed: targets, frames: 5 };
    let fast = bench.pack(&headless, DeltaFormat::Fast, None);

    title(&format!("Tiles: {many} heads, all of {targets} targets change, fast, fixed16, two slots"));
    for widest_tile in [1, 2, 4, 8] {
        let headless = bench.open(|tuning| (tuning.widest_tile, tuning.texels) = (widest_tile, false));
        bench.case(&format!("width {widest_tile}"), &headless, &fast, fixed16);
    }

    title("Few common entries: 8 targets of each head change; by the cost of loading an entry");
    for load_cost in [1, 4, 16] {
        let headless = bench.open(|tuning| tuning.load_cost = load_cost);
        bench.case(&format!("load cost {load_cost}"), &headless, &fast, Case { changed: 8, ..fixed16 });
    }

    title("Block sizes");
    for size in [32, 64, 128] {
        let packed = bench.pack(&headless, DeltaFormat::Fast, Some(size));
        for lanes in [1, 128] {
            let headless = bench.open(|tuning| (tuning.lanes, tuning.texels) = (lanes, false));
            bench.case(&format!("{size} vertices, lanes {lanes}"), &headless, &packed, fixed16);
        }
    }

    title("Formats");
    for format in [DeltaFormat::Fast, DeltaFormat::Small] {
        let packed = bench.pack(&headless, format, None);
        for pose in [PoseFormat::Float32, PoseFormat::Fixed32, PoseFormat::Fixed16, PoseFormat::Rebuilt16] {
            let what = format!("{format:?}, {pose:?}");
            if pose.takes(format) {
                bench.case(&what, &headless, &packed, Case { update: blocks(pose), ..fixed16 });
            }
        }
    }

    for (pose, slots) in [(PoseFormat::Fixed16, 1), (PoseFormat::Rebuilt16, 1), (PoseFormat::Fixed16, 2)] {
        title(&format!("Scale: fast, {}, {slots} slots; weights from the host, and planned on the GPU", pose.name()));
        for changed in [0, 8, targets] {
            let mut bytes_each = 0.0;
            for &heads in &heads {
                let case = Case { update: blocks(pose).slots(slots), heads, changed, ..fixed16 };
                let what = format!("{heads} heads, {changed} change");
                if changed > 0 && heads <= PLANNED {
                    match bench.time(&headless, &fast, case) {
                        Ok((ms, bytes)) => {
                            bench.row(&what, ms, bytes);
                            bytes_each = bytes / heads as f64;
                        }
                        Err(error) => println!("| {what} | {error} |"),
                    }
                }
                match bench.animated(&headless, &fast, case) {
                    Ok((ms, steps)) => {
                        bench.row(&format!("{what}, planned on the GPU ({steps})"), ms, bytes_each * heads as f64);
                    }
                    Err(error) => println!("| {what}, planned on the GPU | {error} |"),
                }
            }
        }
    }
    title("The first row again");
    bench.case("width of the device", &headless, &fast, fixed16);
}
