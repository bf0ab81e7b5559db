//! The built-in head, played and drawn, with the results.

use crate::scene::{EDGE, Host, Result, Scene, view_of};
use deltamorph::reference::{compare, evaluate};
use deltamorph::{CrowdDesc, DeltaFormat, PackedMesh, PoseError, PoseFormat, PoseView, Tolerance, UpdateDesc};
use deltamorph_head as head;
use deltamorph_wgpu::Morph;

/// Results for poses of one format.
pub struct Played {
    /// Error of the last pose against the reference; positions as fractions of the diagonal.
    pub error: PoseError,
    pub picture: Vec<u8>,
    /// The same head, drawn from the reference's vertices.
    pub reference: Vec<u8>,
}

/// Plays frames of the built-in head's clip with poses of a format, and draws them.
pub fn play(host: &Host, format: PoseFormat, vertices: usize, frames: std::ops::Range<usize>) -> Result<Played> {
    let head_desc = head::HeadDesc::default().vertices(vertices);
    let source = head::head(&head_desc);
    let morph = Morph::new(&host.device, &host.queue)?;
    let mesh = PackedMesh::pack(&source.to_mesh(Tolerance::default())?, &morph.pack_desc(DeltaFormat::Fast))?;
    let names: Vec<&str> = mesh.layout().targets.iter().map(|target| target.name.as_str()).collect();
    let clip: Vec<Vec<f32>> = head::head_clip(&head_desc, frames.end, 30.0).bind(&names)?.frames().collect();
    let triangles = source.faces.triangles(&source.positions).concat();
    let indices = |indices: &[u32]| {
        let bytes: Vec<u8> = indices.iter().flat_map(|index| index.to_ne_bytes()).collect();
        host.filled(&bytes, wgpu::BufferUsages::INDEX)
    };

    let uploaded = morph.upload(&mesh)?;
    let mut crowd = morph.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks().pose(format)))?;
    // Packing reorders the vertices that draws name.
    let (packed, view) = (indices(&mesh.layout().indices), view_of(&source.positions));
    let (mut scene, mut last) = (None, None);
    for weights in &clip[frames] {
        crowd.set_weights(0, weights)?;
        let update = morph.update([&mut crowd])?;
        let pose = crowd.pose(0)?;
        let scene = match &mut scene {
            Some(scene) => scene,
            none => none.insert(Scene::new(host, format, view * pose.view.matrix())?),
        };
        let mut encoder = host.device.create_command_encoder(&Default::default());
        scene.draw(&mut encoder, pose.slice(), &packed);
        let copy = host.readback(pose.view.size);
        encoder.copy_buffer_to_buffer(pose.buffer, pose.view.offset, &copy, 0, pose.view.size);
        last = Some((copy, scene.copy(&mut encoder), pose.view, weights));
        host.queue.submit(update.into_iter().chain([encoder.finish()]));
    }
    let (pose, picture, place, weights) = last.ok_or("no frame was played")?;
    let (pose, picture) = (host.read(&pose)?, host.read(&picture)?);
    let expected = evaluate(&mesh, weights);
    let mut error = compare(&mesh.layout().to_user_order(&decoded(&pose, &place)), &expected);
    error.position /= f64::from(mesh.layout().diagonal);

    // The same picture from the vertices of the reference, in the order of the source.
    let vertices: Vec<u8> = expected.iter().flat_map(|&number| (number as f32).to_ne_bytes()).collect();
    let vertices = host.filled(&vertices, wgpu::BufferUsages::VERTEX);
    let scene = Scene::new(host, PoseFormat::Float32, view)?;
    let mut encoder = host.device.create_command_encoder(&Default::default());
    scene.draw(&mut encoder, vertices.slice(..), &indices(&triangles));
    let reference = scene.copy(&mut encoder);
    host.queue.submit([encoder.finish()]);
    Ok(Played { error, picture, reference: host.read(&reference)? })
}

/// Decodes the numbers of a pose on the CPU.
pub fn decoded(pose: &[u8], view: &PoseView) -> Vec<f32> {
    if !view.format.has_integers() {
        return view.format.decode(pose, None);
    }
    let numbers = view.format.integers(pose).into_iter().enumerate();
    numbers.map(|(i, number)| view.offsets[i % 6] + number as f32 * view.units[i % 6]).collect()
}

/// Returns the fraction of pixels of two pictures that differ by more than 2 of 255 in a channel.
pub fn difference(a: &[u8], b: &[u8]) -> f64 {
    let pixels = a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0);
    let differ = pixels.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2)).count();
    differ as f64 / f64::from(EDGE * EDGE)
}
