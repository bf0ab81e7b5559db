//! Pictures of all pose formats, on every driver, under the validation layers.

use deltamorph::reference::{self, evaluate};
use deltamorph::{BatchSize, DeltaFormat, KeptMesh, Mesh, PackedMesh, PoseFormat, Tolerance, UpdateDesc, UpdatePath};
use deltamorph_head::{HeadDesc, head, head_clip};
use deltamorph_headless::{DeviceChoice, Headless, HeadlessDesc};
use deltamorph_render::wrinkles;
use deltamorph_render::{Camera, Face, HeadsDesc, Light, Material, Part, Picture, Scene, Show, Studio, Surface, parts};
use glam::{DVec3, Mat4, Vec3, Vec4};
use std::sync::Arc;

const SIZE: [u32; 2] = [160, 128];
const BLACK: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// Runs `test` on the drivers of the engine's tests; fails on validation messages.
fn on_every_device(test: impl Fn(&Headless)) {
    let list = std::env::var("DELTAMORPH_TEST_DRIVERS").unwrap_or_else(|_| "llvmpipe".into());
    for driver in list.split(',') {
        let desc = HeadlessDesc { device: DeviceChoice::Name(driver.into()), validation: true, ..Default::default() };
        let headless =
            Headless::new(&desc).unwrap_or_else(|e| panic!("{driver}: {e}; run as ./with-vulkan cargo test"));
        test(&headless);
        assert_eq!(headless.messages(), <[String; 0]>::default(), "{driver}");
    }
}

fn source() -> Mesh {
    head(&HeadDesc { vertices: 3000, targets: 40, ..Default::default() })
}

fn mesh(source: &Mesh) -> KeptMesh {
    source.kept(Tolerance::default()).expect("a mesh")
}

/// Frames of the clip: a weight per target.
fn frames(count: usize) -> Vec<Vec<f32>> {
    let clip = head_clip(&HeadDesc { vertices: 3000, targets: 40, ..Default::default() }, count, 10.0);
    clip.values.chunks_exact(clip.names.len()).map(<[f32]>::to_vec).collect()
}

fn scene(mesh: &KeptMesh, places: &[Mat4], camera: Camera, show: Show) -> Scene {
    let all = places.iter().flat_map(|place| mesh.positions.iter().map(|p| place.transform_point3(*p)));
    Scene { view: camera.fit(all, SIZE[0] as f32 / SIZE[1] as f32, 0.05), light: Light::default(), show, end: 1.0 }
}

fn packed(headless: &Headless, mesh: &KeptMesh, format: DeltaFormat) -> Arc<PackedMesh> {
    Arc::new(PackedMesh::pack(mesh, &headless.engine().pack_desc(format)).expect("a mesh that packs"))
}

/// Draws each frame with one head.
fn pictures(
    headless: &Headless,
    mesh: &KeptMesh,
    packed: &Arc<PackedMesh>,
    update: UpdateDesc,
    frames: &[Vec<f32>],
    (camera, show): (Camera, Show),
) -> Vec<Picture> {
    let desc = HeadsDesc { threads: 1, ..HeadsDesc::new(update) };
    let mut studio = Studio::new(headless, mesh, packed, &parts(mesh, &[]), SIZE, &desc).expect("a studio");
    let places = [Mat4::IDENTITY];
    let scene = scene(mesh, &places, camera, show);
    frames.iter().map(|weights| studio.draw(&[weights], &places, &scene, BLACK).expect("a picture")).collect()
}

/// Every pose format on both paths that have it.
fn updates() -> impl Iterator<Item = UpdateDesc> {
    let paths = [UpdatePath::Blocks, UpdatePath::Cpu].map(|path| UpdateDesc::new(path, BatchSize::All));
    PoseFormat::ALL.into_iter().flat_map(move |pose| paths.map(|desc| UpdateDesc { pose, ..desc }))
}

/// Returns the mean difference of two pictures' bytes, and the number that differ by more than 8.
fn difference(a: &Picture, b: &Picture) -> (f64, usize) {
    let off = || a.rgba.iter().zip(&b.rgba).map(|(a, b)| a.abs_diff(*b));
    (off().map(f64::from).sum::<f64>() / a.rgba.len() as f64, off().filter(|off| *off > 8).count())
}

/// How many times as much as lavapipe's a driver's pictures may differ: SwiftShader's differ more where edges move by
/// the unit of a 16-bit pose.
fn leeway(headless: &Headless) -> usize {
    if headless.caps().name.contains("SwiftShader") { 2 } else { 1 }
}

#[test]
fn every_format_of_poses_draws_the_same_pictures() {
    let mesh = mesh(&source());
    let mut frames = frames(5);
    // An expression unlike those of the clip.
    frames[3].iter_mut().step_by(3).for_each(|weight| *weight = 0.5);
    let camera = Camera { yaw: 20.0, ..Camera::default() };
    on_every_device(|headless| {
        let packed = packed(headless, &mesh, DeltaFormat::Fast);
        let draw = |update, show| pictures(headless, &mesh, &packed, update, &frames, (camera, show));
        let [expected, wire] = [Show::Shaded, Show::Wire].map(|show| draw(UpdateDesc::blocks(), show));
        assert_eq!(expected.len(), frames.len());
        // The pictures are meaningful: much is drawn, in many shades, and frames differ.
        let shades = expected[0].rgba.iter().collect::<std::collections::BTreeSet<_>>().len();
        let behind = expected[0].rgba.chunks_exact(4).filter(|pixel| pixel[..3] == [0; 3]).count();
        let (_, moved) = difference(&expected[1], &expected[3]);
        assert!(shades > 150 && behind < 16_000 && moved > 30, "{shades} shades, {behind} black, {moved} moved");
        for update in updates() {
            let drawn = [draw(update, Show::Shaded), draw(update, Show::Wire)].concat();
            for (i, (drawn, expected)) in drawn.iter().zip(expected.iter().chain(&wire)).enumerate() {
                let (mean, far) = difference(drawn, expected);
                // Rounding decides single comparisons at shadow edges, and where lines end.
                let (least, most) = if i < frames.len() { (0.02, 12) } else { (0.04, 120) };
                let times = leeway(headless);
                assert!(mean < least * times as f64 && far <= most * times, "{update:?}, frame {i}: {mean} {far}");
            }
        }
    });
}

#[test]
fn what_changed_is_lit_and_nothing_else() {
    let mesh = mesh(&source());
    let mut frames = frames(2);
    // One corner of the mouth, then none.
    frames[1] = frames[0].clone();
    let target = mesh.targets.iter().position(|target| target.name == "mouthSmileLeft").expect("a target");
    frames[1][target] += 0.5;
    frames.push(frames[1].clone());
    on_every_device(|headless| {
        let packed = packed(headless, &mesh, DeltaFormat::Fast);
        for show in [Show::Motion, Show::Blocks] {
            let mut expected: Option<Vec<Picture>> = None;
            for update in updates() {
                let drawn = pictures(headless, &mesh, &packed, update, &frames, (Camera::default(), show));
                let lit = |picture: &Picture| difference(picture, &drawn[2]).1;
                let [all, some] = [lit(&drawn[0]), lit(&drawn[1])];
                // The first update writes every block from the base pose; it has no previous pose, and nothing moves.
                let most = if show == Show::Blocks { SIZE[0] * SIZE[1] } else { 0 } as usize;
                assert!(some > 200 && some < 20_000, "{show:?} {update:?}: {some}");
                assert!(if most == 0 { all < 2 * some } else { all > most / 2 }, "{show:?} {update:?}: {all}");
                let expected = expected.get_or_insert_with(|| drawn.clone());
                let (mean, _) = difference(&expected[1], &drawn[1]);
                assert!(mean < 0.05, "{show:?} {update:?}: {mean}");
            }
        }
    });
}

#[test]
fn wrinkles_come_where_skin_is_compressed_and_nowhere_else() {
    // The brows are near the end of ARKit's targets.
    let mesh = mesh(&head(&HeadDesc { vertices: 6000, targets: 52, ..Default::default() }));
    let update = UpdateDesc::blocks();
    let mut raised = vec![0.0; mesh.targets.len()];
    for (target, weight) in mesh.targets.iter().zip(&mut raised) {
        *weight = f32::from(u8::from(target.name.starts_with("browOuterUp") || target.name == "browInnerUp"));
    }
    let rest = vec![0.0; raised.len()];
    let mut masked = mesh.clone();
    wrinkles::add(&mut masked);
    let frames = [rest, raised];
    on_every_device(|headless| {
        let draw = |mesh: &KeptMesh, update: UpdateDesc, show| {
            let format = if update.path == UpdatePath::Compute { DeltaFormat::Snorm16 } else { DeltaFormat::Fast };
            let packed = packed(headless, mesh, format);
            let [rest, raised] = &pictures(headless, mesh, &packed, update, &frames, (Camera::default(), show))[..]
            else {
                panic!("two pictures")
            };
            (rest.clone(), raised.clone())
        };
        let ((smooth, folded), (rest, plain)) =
            (draw(&masked, update, Show::Wrinkles), draw(&mesh, update, Show::Shaded));
        // The general shader variant may round differently.
        assert!(difference(&smooth, &rest).0 < 0.004, "at rest there are none");
        let (mean, lines) = difference(&folded, &plain);
        assert!(mean > 0.02 && lines > 50, "{mean}, {lines}: the forehead folds");
        // Nothing is compressed below the eyes.
        let below = (SIZE[0] * SIZE[1] * 4) as usize * 2 / 3;
        let chin = &folded.rgba[below..];
        let plain = &plain.rgba[below..];
        assert!(chin.iter().zip(plain).all(|(a, b)| a.abs_diff(*b) <= 2), "the chin stays smooth");
        for (pose, path) in [
            (PoseFormat::Fixed16, UpdatePath::Blocks),
            (PoseFormat::Fixed32, UpdatePath::Blocks),
            (PoseFormat::Float32, UpdatePath::Compute),
            (PoseFormat::Fixed16, UpdatePath::Cpu),
            (PoseFormat::Float32, UpdatePath::Cpu),
        ] {
            let other = draw(&masked, UpdateDesc { pose, ..UpdateDesc::new(path, BatchSize::All) }, Show::Wrinkles).1;
            let (mean, far) = difference(&other, &folded);
            assert!(mean < 0.02 && far <= 12, "{pose:?} {path:?}: {mean} {far}");
        }
        let studio = |mesh: &KeptMesh| {
            let packed = packed(headless, mesh, DeltaFormat::Fast);
            let desc = HeadsDesc::new(update);
            Studio::new(headless, mesh, &packed, &parts(mesh, &[]), SIZE, &desc).expect("a studio")
        };
        let places = [Mat4::IDENTITY];
        let scene = scene(&mesh, &places, Camera::default(), Show::Wrinkles);
        let refused = studio(&mesh).draw(&[&frames[1]], &places, &scene, BLACK).expect_err("no masks");
        assert!(refused.to_string().contains("wrinkles::add"), "{refused}");
    });
}

/// Bounds come from the weights: a pose that reaches into the picture is drawn even if the base pose does not. Culling
/// changes no pixel.
#[test]
fn a_jaw_that_alone_reaches_into_the_picture_is_drawn() {
    let mesh = mesh(&source());
    let jaw = mesh.targets.iter().position(|target| target.name == "jawOpen").expect("a jaw");
    let shut = vec![0.0; mesh.targets.len()];
    let mut open = vec![0.0; mesh.targets.len()];
    // Far enough that the chin is lower than the neck.
    open[jaw] = 4.0;
    // From far away, to avoid perspective.
    let scene = scene(&mesh, &[Mat4::IDENTITY], Camera { angle: 2.0, ..Camera::default() }, Show::Shaded);
    // High enough that the base pose is just above the picture.
    let is_above = |lift: &f32| {
        let above = |p: Vec4| p.y < -1.02 * p.w;
        mesh.positions.iter().all(|p| above(scene.view.clip * (*p + Vec3::Y * *lift).extend(1.0)))
    };
    let lift = (0..1000).map(|i| i as f32 * 0.1).find(is_above).expect("a lift");
    let places = [Mat4::IDENTITY, Mat4::from_translation(Vec3::Y * lift)];
    on_every_device(|headless| {
        let packed = packed(headless, &mesh, DeltaFormat::Fast);
        let draw = |other: &[f32], cull| {
            let desc = HeadsDesc { count: 2, cull, ..HeadsDesc::new(UpdateDesc::blocks()) };
            let mut studio = Studio::new(headless, &mesh, &packed, &parts(&mesh, &[]), SIZE, &desc).expect("a studio");
            (studio.draw(&[&shut, other], &places, &scene, BLACK).expect("a frame"), studio.draws())
        };
        let [without, with] = [&shut, &open].map(|other| {
            let [all, culled] = [false, true].map(|cull| draw(other, cull));
            assert!(all.0 == culled.0, "pixels differ");
            assert_eq!(all.1, [culled.1[0] + culled.1[1], 0]);
            culled
        });
        assert!(
            without.1[1] > 0 && with.1[1] == 0,
            "left out without the jaw, {:?}; and with it, {:?}",
            without.1,
            with.1
        );
        assert!(difference(&with.0, &without.0).1 > 20, "the jaw is in the picture");
    });
}

/// Recomputed normals are drawn as the float64 reference computes them.
#[test]
fn recomputed_normals_are_drawn_as_their_reference_says() {
    let mesh = mesh(&source());
    let mut weights = frames(1).remove(0);
    // Several targets at once, whose normals do not add up.
    weights.iter_mut().step_by(2).for_each(|weight| *weight = 0.7);
    let places = [Mat4::IDENTITY];
    // All is skin: irises go with the base pose, which the reference has not.
    let skin = parts(&mesh, &vec![Face::Named("skin"); mesh.faces.sizes.len()]);
    let skin: Vec<_> = skin.into_iter().map(|part| Part { material: Material::Skin, ball: None, ..part }).collect();
    on_every_device(|headless| {
        let picture = |of: &KeptMesh, packed: &Arc<PackedMesh>, desc: &HeadsDesc<'_>, weights: &[f32], show| {
            let scene = scene(&mesh, &places, Camera { yaw: 20.0, ..Camera::default() }, show);
            Studio::new(headless, of, packed, &skin, SIZE, desc)?.draw(&[weights], &places, &scene, BLACK)
        };
        let fixed = UpdateDesc { pose: PoseFormat::Fixed16, ..UpdateDesc::blocks() };
        let float = UpdateDesc::new(UpdatePath::Compute, BatchSize::All);
        for (format, update) in [(DeltaFormat::Fast, fixed), (DeltaFormat::Float32, float)] {
            let packed = packed(headless, &mesh, format);
            let grid = update.grid(packed.layout()).expect("a grid");
            let rounded: Vec<f32> = weights.iter().map(|&w| grid.map_or(w, |grid| grid.round(w))).collect();
            let pose = evaluate(&packed, &rounded);
            let vectors =
                |pose: &[f64]| pose.chunks_exact(3).map(|v| DVec3::from_slice(v).as_vec3()).collect::<Vec<_>>();
            // A mesh that is there, without targets.
            let given = KeptMesh {
                positions: vectors(&pose).into_iter().step_by(2).collect(),
                normals: vectors(&reference::normals(&pose, &mesh.faces, &mesh.welds).expect("normals")),
                targets: vec![],
                ..mesh.clone()
            };
            let base = self::packed(headless, &given, DeltaFormat::Fast);
            let recomputed = HeadsDesc { recompute_normals: true, ..HeadsDesc::new(update) };
            for show in [Show::Shaded, Show::Normals] {
                let found = picture(&mesh, &packed, &recomputed, &weights, show).expect("a picture");
                let as_given = HeadsDesc::new(UpdateDesc::blocks());
                let expected = picture(&given, &base, &as_given, &[], show).expect("a picture");
                let (mean, far) = difference(&found, &expected);
                assert!(mean < 0.05 && far <= 20 * leeway(headless), "{update:?}, {show:?}: {mean} {far}");
            }
        }
        let packed = packed(headless, &mesh, DeltaFormat::Fast);
        for (update, show, words) in [
            (UpdateDesc::new(UpdatePath::Cpu, BatchSize::All), Show::Shaded, "on the path 'cpu'"),
            (UpdateDesc::blocks(), Show::Motion, "recomputed normals"),
        ] {
            let desc = HeadsDesc { recompute_normals: true, ..HeadsDesc::new(update) };
            let refused = picture(&mesh, &packed, &desc, &weights, show).map(|_| ()).expect_err("no picture");
            assert!(refused.to_string().contains(words), "{refused}");
        }
    });
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let mesh = mesh(&source());
    on_every_device(|headless| {
        let packed = packed(headless, &mesh, DeltaFormat::Fast);
        let desc = HeadsDesc::new(UpdateDesc::blocks());
        let of = |size| Studio::new(headless, &mesh, &packed, &parts(&mesh, &[]), size, &desc);
        for (size, words) in [([0, 8], "0 × 8"), ([8, 1 << 20], "1048576")] {
            let refused = of(size).err().expect("a bad size").to_string();
            assert!(refused.contains(words), "{refused}");
        }
        let mut studio = of(SIZE).expect("a studio");
        let places = [Mat4::IDENTITY];
        let scene = scene(&mesh, &places, Camera::default(), Show::Shaded);
        let weights: &[f32] = &frames(1)[0];
        let mut refuse = |weights: &[&[f32]], places: &[Mat4]| {
            studio.draw(weights, places, &scene, BLACK).expect_err("refused").to_string()
        };
        assert!(refuse(&[], &[]).contains("0 poses"));
        assert!(refuse(&[weights], &[]).contains("0 places"));
        assert!(refuse(&[&weights[..3]], &places).contains('3'));
        // A frame can be drawn after all these errors.
        studio.draw(&[weights], &places, &scene, BLACK).expect("a frame");
    });
}

/// Still parts beside a head, with surfaces of their own: colours, and one side or two.
#[test]
fn still_parts_are_drawn_with_their_surfaces() {
    let mesh = mesh(&source());
    // Squares of a fifth of the diagonal beside the head; a pose of the head does not reach there.
    let edge = mesh.diagonal / 5.0;
    let at = |i: usize| Vec3::new(6.0 + (i % 2) as f32 * 1.5, (i / 2) as f32 * 1.5, 0.0) * edge;
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let front = [0, 1, 2, 0, 2, 3];
    let back = [0, 2, 1, 0, 3, 2];
    let red = [0.8, 0.0, 0.0];
    let squares = [(red, false, front), ([0.0, 0.8, 0.0], false, front), (red, false, back), (red, true, back)];
    let mut source = Mesh::default();
    let mut said = vec![];
    for (i, (colour, double_sided, order)) in squares.into_iter().enumerate() {
        let first = source.positions.len() as u32;
        source.positions.extend(corners.map(|[x, y]| at(i) + Vec3::new(x, y, 0.0) * edge));
        source.faces.sizes.extend([3, 3]);
        source.faces.corners.extend(order.map(|v| deltamorph::mesh::Corner { position: first + v, texcoord: None }));
        said.extend([Face::Painted(Surface { colour, double_sided }); 2]);
    }
    let still = source.kept(Tolerance::ZERO).expect("squares");
    let parts_of_still = parts(&still, &said);
    on_every_device(|headless| {
        for update in [UpdateDesc::blocks(), UpdateDesc { pose: PoseFormat::Fixed32, ..UpdateDesc::blocks() }] {
            let packed = packed(headless, &mesh, DeltaFormat::Fast);
            let alone = HeadsDesc { cull: true, ..HeadsDesc::new(update) };
            let desc = HeadsDesc { still: Some((&still, &parts_of_still)), ..alone };
            let studio =
                |desc| Studio::new(headless, &mesh, &packed, &parts(&mesh, &[]), SIZE, desc).expect("a studio");
            let [mut without, mut studio] = [&alone, &desc].map(studio);
            let shown = [at(0), at(squares.len() - 1) + Vec3::new(1.0, 1.0, 0.0) * edge];
            let view = Camera::default().fit(shown.into_iter(), SIZE[0] as f32 / SIZE[1] as f32, 0.0);
            let draw = |studio: &mut Studio<'_>, show| {
                let scene = Scene { view, light: Light::default(), show, end: 1.0 };
                let weights = vec![0.0; mesh.targets.len()];
                studio.draw(&[&weights], &[Mat4::IDENTITY], &scene, BLACK).expect("a picture")
            };
            let pixel = |picture: &Picture, i: usize| {
                let clip = view.clip.project_point3(at(i) + Vec3::new(0.5, 0.5, 0.0) * edge);
                let [x, y] =
                    [(clip.x, SIZE[0]), (clip.y, SIZE[1])].map(|(at, size)| ((at + 1.0) / 2.0 * size as f32) as usize);
                <[u8; 4]>::try_from(&picture.rgba[4 * (y * SIZE[0] as usize + x)..][..4]).expect("a pixel")
            };
            assert!(draw(&mut without, Show::Shaded).rgba.chunks_exact(4).all(|p| p[0] == 0), "the head is beside it");
            let picture = draw(&mut studio, Show::Shaded);
            let [red, green, none, two_sides] = [0, 1, 2, 3].map(|i| pixel(&picture, i));
            assert!(red[0] > 100 && red[1] < 60 && green[1] > 100 && green[0] < 60, "{red:?} {green:?}");
            assert!(none[..3] == [0; 3] && two_sides[0] > 60, "a back has its side or none: {none:?} {two_sides:?}");
            for show in [Show::Heat, Show::Blocks, Show::Motion] {
                let picture = draw(&mut studio, show);
                assert!(pixel(&picture, 3)[..3] != [0; 3], "{show:?}");
            }
        }
    });
}
