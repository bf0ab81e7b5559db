use super::texels::DeltaTexels;
use crate::pack::{DeltaFormat, PackDesc, PackedMesh};
use crate::testing;

#[test]
fn what_does_not_fit_is_refused() {
    let mesh = PackedMesh::pack(&testing::mesh(1000, 37), &PackDesc::new(DeltaFormat::Float32)).expect("a mesh");
    testing::says(DeltaTexels::bake(&mesh.groups()[0], 16), &["16 × 16", "split the mesh"]);
}
