//! Delta textures as KTX2 files, always of the same mesh.

use crate::{Memory, Random, Target, bounded, check_error, pack_and_update, write};
use deltamorph::{DeltaFormat, MorphMesh, PackDesc, PackedMesh, testing};
use deltamorph_baselines::textures::{TextureFloats, read_ktx2, write_ktx2};
use std::sync::LazyLock;

pub const TARGET: Target = Target { name: "ktx2", run, mutate, seeds };

static MESH: LazyLock<MorphMesh> = LazyLock::new(|| testing::with_streams(testing::mesh(20, 3)));

fn run(data: &[u8]) {
    let path = write("textures.ktx2", data);
    let memory = Memory { base: 1 << 20, per_byte: 100 };
    let mesh = match bounded("read_ktx2", data.len(), memory, || read_ktx2(&path, &MESH)) {
        Ok(mesh) => mesh,
        Err(error) => return check_error(error),
    };
    pack_and_update(&mesh, crc32fast::hash(data));
    // A texture that is written is read back unchanged.
    let pack = |mesh: &MorphMesh| PackedMesh::pack(mesh, &PackDesc::new(DeltaFormat::Float32));
    let Ok(packed) = pack(&mesh) else { return };
    match write_ktx2(&packed, TextureFloats::Single) {
        Ok(file) => {
            let back = read_ktx2(&write("back.ktx2", &file.bytes), &MESH).expect("it was written");
            assert_eq!(back.targets.len(), mesh.targets.len());
            let error = pack(&back).expect("as before").measure_error(&mesh);
            assert!(error.position == 0.0, "{error:?}");
        }
        Err(error) => check_error(error),
    }
}

/// Changes words: as often in the header and the keys, which come first, as in the rest.
fn mutate(data: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let mut data = data.to_vec();
    let end = if random.below(2) == 0 { data.len().min(1200) } else { data.len() };
    random.change_word(&mut data[..end]);
    Some(data)
}

fn seeds() -> Vec<(String, Vec<u8>)> {
    let packed = PackedMesh::pack(&MESH, &PackDesc::new(DeltaFormat::Float32)).expect("a mesh for tests");
    let file = |floats| write_ktx2(&packed, floats).expect("it can be written").bytes;
    vec![("single".into(), file(TextureFloats::Single)), ("half".into(), file(TextureFloats::Half))]
}
