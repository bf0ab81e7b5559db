//! Characters of a creator: 200 sliders, set once, and 12 targets of expressions, for 40 characters that share their
//! deltas. Prints what frames read and write, with the sliders' poses as bases of the characters and without.
//!
//!     cargo run --release --example creator [PART OF A DEVICE'S NAME]
//!
//! Constant weights cost nothing in an update that adds what changed. They cost all their targets where a block starts
//! anew, unless the character has a base (`Crowd::set_base`): a second instance, with the sliders alone, which stays
//! hidden until a slider moves.

use deltamorph::reference::{compare, evaluate};
use deltamorph::{CrowdDesc, DeltaFormat, PackedMesh, PoseFormat, Result, Tolerance, UpdateDesc, UpdateMode};
use deltamorph_head::{HeadDesc, Rng, head};
use deltamorph_headless::{DeviceChoice, Headless, HeadlessCrowd, HeadlessDesc};

const CHARACTERS: u32 = 40;
const EXPRESSIONS: usize = 12;
const SLIDERS: usize = 200;

/// The characters, and from number `CHARACTERS` on their bases.
struct Creator<'a> {
    crowd: HeadlessCrowd<'a>,
    /// By character: expression, then sliders.
    weights: Vec<Vec<f32>>,
    bases: bool,
    rng: Rng,
}

impl<'a> Creator<'a> {
    fn new(headless: &'a Headless, mesh: &PackedMesh, mode: UpdateMode, bases: bool) -> Result<Self> {
        let instances = if bases { 2 * CHARACTERS } else { CHARACTERS };
        let update = UpdateDesc::blocks().pose(PoseFormat::Fixed16).mode(mode);
        let crowd = HeadlessCrowd::new(headless, mesh, &CrowdDesc::new(update).instances(instances))?;
        let mut rng = Rng::new(1, 0);
        let weights = (0..CHARACTERS).map(|_| {
            let sliders = (0..SLIDERS).map(|_| rng.range(-0.4, 0.4));
            [0.0; EXPRESSIONS].into_iter().chain(sliders).collect()
        });
        let mut creator = Self { crowd, weights: weights.collect(), bases, rng };
        for character in (0..CHARACTERS).filter(|_| bases) {
            creator.crowd.crowd_mut().set_base(character, Some(CHARACTERS + character))?;
            creator.crowd.set_weights(CHARACTERS + character, &creator.weights[character as usize])?;
        }
        creator.frame(0)?;
        creator.frame(1)?; // both slots have been written
        for base in (CHARACTERS..2 * CHARACTERS).filter(|_| bases) {
            creator.crowd.set_hidden(base, true)?;
        }
        Ok(creator)
    }

    /// Plays expression `number`: four of the twelve targets, others than in the one before. Returns kilobytes moved.
    fn frame(&mut self, number: usize) -> Result<u64> {
        for (character, weights) in (0..).zip(&mut self.weights) {
            for (t, weight) in weights[..EXPRESSIONS].iter_mut().enumerate() {
                let is_active = t % 3 == number % 3;
                *weight = if is_active { self.rng.unit() } else { 0.0 };
            }
            self.crowd.set_weights(character, weights)?;
        }
        Ok(self.crowd.step(&[])?.update.stats.bytes_moved / 1000)
    }

    /// Moves a slider of character 0. Its base follows in the same update.
    fn slide(&mut self, slider: usize, weight: f32) -> Result<u64> {
        self.weights[0][EXPRESSIONS + slider] = weight;
        self.crowd.set_weights(0, &self.weights[0])?;
        if self.bases {
            let mut weights = self.weights[0].clone();
            weights[..EXPRESSIONS].fill(0.0);
            self.crowd.set_hidden(CHARACTERS, false)?;
            self.crowd.set_weights(CHARACTERS, &weights)?;
        }
        let moved = self.crowd.step(&[])?.update.stats.bytes_moved / 1000;
        if self.bases {
            self.crowd.set_hidden(CHARACTERS, true)?;
        }
        Ok(moved)
    }
}

fn main() -> Result<()> {
    let device = std::env::args().nth(1).map(DeviceChoice::Name);
    let headless = Headless::new(&HeadlessDesc::default().device(device.unwrap_or_default()))?;
    let source =
        head(&HeadDesc::default().vertices(8_000).targets(EXPRESSIONS + SLIDERS)).to_mesh(Tolerance::default())?;
    let mesh = PackedMesh::pack(&source, &headless.engine().pack_desc(DeltaFormat::Fast))?;
    let pose = mesh.layout().pose_bytes(PoseFormat::Fixed16);
    println!("{CHARACTERS} characters, {SLIDERS} sliders; a base takes 2 × {} KB", pose / 1000);
    println!("{:32} {:>14} {:>14}", "kilobytes moved", "without bases", "with bases");
    let mut stored = vec![];
    for mode in [UpdateMode::Incremental, UpdateMode::Rebuild] {
        let without = Creator::new(&headless, &mesh, mode, false)?;
        let mut creators = [without, Creator::new(&headless, &mesh, mode, true)?];
        for (number, what) in (2..).zip(["another expression", "a slider moves", "another expression"]) {
            let mut moved = vec![];
            for creator in &mut creators {
                moved.push(if number == 3 { creator.slide(7, 0.9) } else { creator.frame(number) }?);
            }
            println!("{:32} {:>14} {:>14}", format!("{}: {what}", mode.name()), moved[0], moved[1]);
        }
        for creator in &mut creators {
            let (pose, _) = creator.crowd.read_group(0, 0)?;
            let error = compare(&pose, &evaluate(&mesh, &creator.weights[0]));
            assert!(error.position < 2e-3 * f64::from(mesh.layout().diagonal), "{error:?}");
            stored.push(creator.crowd.read_stored(0, 0)?);
        }
    }
    assert!(stored.windows(2).all(|pair| pair[0] == pair[1]), "the bits of a full evaluation, whatever is read");
    println!("all poses are equal, bit for bit");
    Ok(())
}
