//! Import of meshes and weight clips from files.
//!
//! To add an importer: a module here, and a branch in [`open`].

#[cfg(feature = "csv")]
pub mod csv;
#[cfg(feature = "gltf")]
pub mod gltf;
mod kinds;
#[cfg(feature = "obj")]
#[doc(hidden)]
pub mod obj;

use crate::asset::Mesh;
use crate::error::{Error, Result, ensure, shortened};
use crate::io::{has_extension, list};
use crate::pack::PackedMesh;
use crate::pack::file;
use crate::weights::WeightClip;
use std::path::{Path, PathBuf};

/// Frames per second of a clip whose source states no frame rate.
pub const DEFAULT_FPS: f32 = 30.0;

/// The result of [`open`]: the mesh, and the paths of its clips, which are not read yet.
#[derive(Debug)]
#[non_exhaustive]
pub struct Imported {
    /// The mesh.
    pub mesh: ImportedMesh,
    /// Weight clips that belong to the mesh: read them with [`open_clip`]. For a glTF file, `FILE#NAME` for each
    /// animation of weights, in the order of the file; for a packed file, `FILE#NAME` for each clip; for a folder,
    /// files sorted by name.
    pub clips: Vec<PathBuf>,
    /// Whether it is an avatar of VRM 0, which looks along −z: pictures of its face are taken from behind.
    pub looks_back: bool,
}

/// A mesh to pack, or one that is packed already: [`open`] shows how to handle both.
#[derive(Debug)]
pub enum ImportedMesh {
    /// A mesh as its files state it, not packed.
    Source(Mesh),
    /// The content of a packed file.
    Packed(PackedMesh),
}

/// Opens a mesh and the files that belong to it: a folder with `neutral.obj`, `targets/*.obj` and `weights/*.csv`, a
/// glTF file (`*.glb`, `*.gltf`, `*.vrm`; feature `gltf`), or a packed file (`*.dmorph`).
///
/// Several meshes of a glTF file become one, as described at `gltf::Gltf::into_mesh`.
///
/// ```no_run
/// use deltamorph::import::{ImportedMesh, open};
/// use deltamorph::PackDesc;
///
/// let imported = open("face.glb".as_ref())?;
/// let mesh = match imported.mesh {
///     ImportedMesh::Source(mesh) => mesh.pack(&PackDesc::default())?,
///     ImportedMesh::Packed(mesh) => mesh,
/// };
/// # let _ = mesh;
/// # Ok::<(), deltamorph::Error>(())
/// ```
///
/// # Errors
/// [`Error::Io`] if `path` does not exist or cannot be read; [`Error::Input`] if the format is not known or not built
/// in, or the content cannot be used. The message names the file, the position in it and the remedy.
pub fn open(path: &Path) -> Result<Imported> {
    if std::fs::metadata(path).map_err(Error::io(path, "read"))?.is_dir() {
        open_folder(path)
    } else if is_packed(path) {
        let bytes = file::bytes(path)?;
        kinds::refuse_others(path, &bytes, "a packed mesh")?;
        let mesh = PackedMesh::from_bytes(path, &bytes)?;
        let clips = mesh.clips.iter().map(|clip| named(path, &clip.name)).collect();
        Ok(Imported { mesh: ImportedMesh::Packed(mesh), clips, looks_back: false })
    } else if is_gltf(path) {
        open_gltf(path)
    } else {
        let remedy = "give a folder with neutral.obj and targets/*.obj, a glTF file (*.glb, *.gltf, *.vrm), or a file \
                      written by `deltamorph pack` (*.dmorph)";
        Err(Error::input(path, "", "a file of a kind that is not read", remedy))
    }
}

impl Mesh {
    /// Opens a mesh to pack: a folder of OBJ files or a glTF file, as [`open`] does.
    ///
    /// # Errors
    /// Those of [`open`]; [`Error::Input`] for a packed file, which [`PackedMesh::read`] reads.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        match open(path.as_ref())?.mesh {
            ImportedMesh::Source(mesh) => Ok(mesh),
            ImportedMesh::Packed(_) => {
                let remedy = "read it with PackedMesh::read, or give the files that it was packed from";
                Err(Error::input(path.as_ref(), "", "a mesh that is packed already", remedy))
            }
        }
    }
}

/// Reads a weight clip: a CSV file (feature `csv`), the only animation of weights of a glTF file (feature `gltf`), or
/// of joints where weights stay at rest, the only clip of a packed file, or one of several as `FILE#NAME`. `fps` is the
/// frame rate; `None` takes the one stated by the file or by its name, or else [`DEFAULT_FPS`]. A clip of a packed file
/// keeps its frames, and plays them at `fps`.
///
/// # Errors
/// The file cannot be used, has no such animation, or has several and none is named; `fps` is not a positive number; or
/// the library was built without the feature that reads the file.
pub fn open_clip(path: &Path, fps: Option<f32>) -> Result<WeightClip> {
    let (file, name) = animation_of(path).map_or((path.to_path_buf(), None), |(file, name)| (file, Some(name)));
    if is_gltf(&file) {
        return gltf_clip(&file, name.as_deref(), fps);
    }
    if is_packed(&file) {
        return packed_clip(&file, name.as_deref(), fps);
    }
    #[cfg(feature = "csv")]
    return csv::read(path, fps);
    #[cfg(not(feature = "csv"))]
    Err(Error::input(path, "", format!("no weight clips are read (fps {fps:?})"), "build with the feature 'csv'"))
}

/// `FILE#NAME`.
fn named(path: &Path, name: &str) -> PathBuf {
    let mut clip = path.as_os_str().to_owned();
    clip.push("#");
    clip.push(name);
    clip.into()
}

/// Whether the name is that of a glTF file, or of a VRM avatar, which is a GLB file. Texture coordinates of glTF begin
/// at the top left, those of OBJ at the bottom left.
#[doc(hidden)]
pub fn is_gltf(path: &Path) -> bool {
    ["glb", "gltf", "vrm"].iter().any(|end| has_extension(path, end))
}

fn is_packed(path: &Path) -> bool {
    has_extension(path, "dmorph")
}

/// Splits `FILE#NAME` into the path of the glTF file or packed file, and the name of the animation. A `#` may be part
/// of either: the path ends at the first one that follows the name of such a file. `None` if there is no such `#`.
#[doc(hidden)]
pub fn animation_of(path: &Path) -> Option<(PathBuf, String)> {
    let text = path.to_str()?;
    let mut parts = text.match_indices('#').map(|(at, _)| (Path::new(&text[..at]), &text[at + 1..]));
    parts.find(|(file, _)| is_gltf(file) || is_packed(file)).map(|(file, name)| (file.to_path_buf(), name.to_owned()))
}

#[cfg(feature = "gltf")]
fn open_gltf(path: &Path) -> Result<Imported> {
    let gltf = gltf::read(path)?;
    let clips = gltf.weight_animations().map(|animation| named(path, &animation.name)).collect();
    let looks_back = gltf.looks_back;
    Ok(Imported { mesh: ImportedMesh::Source(gltf.into_mesh()?), clips, looks_back })
}

#[cfg(feature = "gltf")]
fn gltf_clip(path: &Path, name: Option<&str>, fps: Option<f32>) -> Result<WeightClip> {
    let gltf = gltf::read(path)?;
    let mut all: Vec<_> = gltf.weight_animations().collect();
    if name.is_some() || all.is_empty() {
        all = gltf.animations.iter().filter(|animation| !animation.channels.is_empty()).collect();
    }
    let names: Vec<&str> = all.iter().map(|animation| animation.name.as_str()).collect();
    let left_out = gltf.notes.iter().filter(|note| note.starts_with("animations["));
    let more: String = left_out.map(|note| format!(" ({note})")).collect();
    let chosen = choose(path, ["glTF file", "animation of weights", "animations of weights"], &names, name, &more)?;
    gltf.clip(all[chosen], fps)
}

fn packed_clip(path: &Path, name: Option<&str>, fps: Option<f32>) -> Result<WeightClip> {
    let bytes = file::bytes(path)?;
    kinds::refuse_others(path, &bytes, "a packed mesh")?;
    let mut clips = file::clips(path, &bytes)?;
    let all: Vec<&str> = clips.iter().map(|clip| clip.name.as_str()).collect();
    let mut clip = clips.swap_remove(choose(path, ["packed file", "clip", "clips"], &all, name, "")?);
    clip.fps = frame_rate(fps.unwrap_or(clip.fps))?;
    Ok(clip)
}

fn is_rate(fps: f32) -> bool {
    fps > 0.0 && fps.is_finite()
}

/// Checks a number of frames per second.
fn frame_rate(fps: f32) -> Result<f32> {
    let what = format!("the frame rate is {fps}");
    ensure!(is_rate(fps), what, "give a positive number of frames per second");
    Ok(fps)
}

/// Names in quotes, with commas between them.
fn quoted<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    names.into_iter().map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ")
}

/// The name of a file without its extension. Bytes of a name that is not UTF-8 are written as `\x82`.
fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_str().map_or_else(|| stem.as_encoded_bytes().escape_ascii().to_string(), str::to_owned)
}

/// The index of the clip called `name`, or of the only one.
fn choose(path: &Path, of: [&str; 3], all: &[&str], name: Option<&str>, more: &str) -> Result<usize> {
    let is_it = |other: &&str| name.map_or(all.len() == 1, |name| *other == name);
    let found = all.iter().position(is_it);
    let [file, one, several] = of;
    let what = match name {
        Some(name) => format!("no {one} is called '{name}'"),
        None => format!("a {file} with {} {several} where one clip is wanted", all.len()),
    };
    let names = quoted(all.iter().copied());
    let remedy = match (all.len(), name) {
        (0, _) => format!("it has none: give a CSV file{more}"),
        (_, Some(_)) => format!("name one of: {names}{more}"),
        (_, None) => format!("name one as FILE#NAME: {names}{more}"),
    };
    found.ok_or_else(|| Error::input(path, "", what, &remedy))
}

#[cfg(not(feature = "gltf"))]
fn open_gltf(path: &Path) -> Result<Imported> {
    Err(Error::input(path, "", "glTF files are not read", "build with the feature 'gltf'"))
}

#[cfg(not(feature = "gltf"))]
fn gltf_clip(path: &Path, _: Option<&str>, _: Option<f32>) -> Result<WeightClip> {
    Err(Error::input(path, "", "animations of glTF files are not read", "build with the feature 'gltf'"))
}

#[cfg(not(feature = "obj"))]
fn open_folder(path: &Path) -> Result<Imported> {
    Err(Error::input(path, "", "folders of OBJ files are not read", "build with the feature 'obj'"))
}

#[cfg(feature = "obj")]
fn open_folder(path: &Path) -> Result<Imported> {
    let mesh = ImportedMesh::Source(obj::import_folder(path)?);
    let weights = path.join("weights");
    let mut clips = if weights.is_dir() { list(&weights)? } else { vec![] };
    clips.retain(|path| has_extension(path, "csv") && path.is_file());
    Ok(Imported { mesh, clips, looks_back: false })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_comes_with_its_clips_in_order() {
        let dir = tempfile::tempdir().unwrap();
        let weights = dir.path().join("weights");
        let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 2/2 1/1 3/1\n";
        std::fs::create_dir(dir.path().join("targets")).unwrap();
        std::fs::write(dir.path().join("neutral.obj"), triangle).unwrap();
        assert_eq!(Mesh::open(&dir).unwrap().split().unwrap().positions.len(), 4);
        assert_eq!(open(dir.path()).unwrap().clips, Vec::<PathBuf>::new());
        std::fs::create_dir(&weights).unwrap();
        for name in ["b.csv", "a.CSV", "notes.txt"] {
            std::fs::write(weights.join(name), "").unwrap();
        }
        let clips = vec![weights.join("a.CSV"), weights.join("b.csv")];
        assert_eq!(open(dir.path()).unwrap().clips, clips);
    }
}
