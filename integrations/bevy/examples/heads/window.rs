//! The heads in a window.

use crate::scene::Scene;
use bevy::mesh::morph::{MeshMorphWeights, MorphWeights};
use bevy::prelude::*;
use deltamorph_bevy::DeltamorphSettings;

/// Share of a new frame time in the mean that the title shows.
const SHARE: f32 = 0.1;

/// The animation, and its frame times.
#[derive(Resource)]
struct Player {
    heads: Vec<Entity>,
    clip: Vec<Vec<f32>>,
    /// Mean seconds of a frame with deltamorph and with Bevy's own morphing; `None`: not measured yet.
    means: [Option<f32>; 2],
}

/// Plays until the window is closed.
pub fn run(scene: Scene) -> Result {
    let Scene { mut app, heads, clip, .. } = scene;
    app.insert_resource(Player { heads, clip, means: [None; 2] }).add_systems(Update, (play, toggle, title).chain());
    match app.run() {
        AppExit::Success => Ok(()),
        AppExit::Error(code) => Err(format!("Bevy ended with {code}").into()),
    }
}

fn play(time: Res<Time>, player: Res<Player>, mut heads: Query<(&mut MeshMorphWeights, Option<&mut MorphWeights>)>) {
    let frame = (30.0 * time.elapsed_secs()) as usize;
    for (i, head) in player.heads.iter().enumerate() {
        let row = &player.clip[(frame + 7 * i) % player.clip.len()];
        match heads.get_mut(*head) {
            Ok((_, Some(mut shared))) => shared.weights_mut().copy_from_slice(row),
            Ok((mut own, None)) => *own = MeshMorphWeights::Value { weights: row.clone() },
            Err(_) => {}
        }
    }
}

fn toggle(keys: Res<ButtonInput<KeyCode>>, mut settings: ResMut<DeltamorphSettings>) {
    if keys.just_pressed(KeyCode::KeyM) {
        settings.enabled = !settings.enabled;
    }
}

fn title(
    time: Res<Time>,
    settings: Res<DeltamorphSettings>,
    mut player: ResMut<Player>,
    mut windows: Query<&mut Window>,
) {
    let (now, seconds) = (usize::from(!settings.enabled), time.delta_secs());
    let mean = &mut player.means[now];
    *mean = Some(mean.map_or(seconds, |mean| mean + SHARE * (seconds - mean)));
    let text = |mean: Option<f32>| mean.map_or("not seen yet".to_owned(), |mean| format!("{:.1} ms", 1e3 * mean));
    let [ours, bevys] = player.means.map(text);
    let who = ["deltamorph", "Bevy"][now];
    for mut window in &mut windows {
        window.title = format!("{who} morphs (key M) - a frame with deltamorph: {ours}, with Bevy: {bevys}");
    }
}
