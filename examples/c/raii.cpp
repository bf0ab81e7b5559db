// The built-in head plays its clip on the CPU, without Vulkan; every pose is compared with the float64 reference.
//
//     cargo build --release -p deltamorph-c --features cpu   # crowds on the CPU; `sample`, the head, is there by default
//     capi/install PREFIX target/release
//     c++ -std=c++17 -I PREFIX/include examples/c/raii.cpp -L PREFIX/lib -ldeltamorph_c -Wl,-rpath,PREFIX/lib -o raii
#include <deltamorph.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <vector>

namespace dm = deltamorph;

int main() try {
    auto head = dm::sized<DmSampleDesc>();
    head.vertices = 2000;
    const auto mesh = dm::Mesh::make(dm_mesh_sample_head, &head, nullptr);
    const auto frames = dm::Clip::make(dm_clip_sample_head, &head, 30, 30.0f);
    const auto clip = dm::BoundClip::make(dm_clip_bind, frames, mesh);
    const auto crowd = dm::CpuCrowd::make(dm_cpu_crowd_create, mesh, nullptr, 1u);
    auto info = dm::sized<DmMeshInfo>();
    dm::check(dm_mesh_info(mesh, &info));

    std::vector<uint32_t> packed(info.vertex_count);
    std::iota(packed.begin(), packed.end(), 0u);
    dm::check(dm_mesh_remap_indices(mesh, packed.data(), packed.size())); // packing reorders vertices
    std::vector<float> weights(info.target_count), pose(info.vertex_count * 6);
    std::vector<double> reference(pose.size());
    double worst = 0;
    for (double frame = 0; frame <= 29; frame += 0.5) {
        dm::check(dm_bound_clip_sample(clip, frame, weights.data(), info.target_count));
        dm::check(dm_cpu_crowd_set_weights(crowd, 0, weights.data(), info.target_count));
        dm::check(dm_cpu_crowd_update(crowd));
        dm::check(dm_cpu_crowd_pose(crowd, 0, pose.data(), pose.size()));
        dm::check(dm_mesh_evaluate(mesh, weights.data(), info.target_count, reference.data(), reference.size()));
        for (size_t v = 0; v < packed.size(); v++)
            for (size_t c = 0; c < 3; c++) {
                const double off = std::abs(pose[packed[v] * 6 + c] - reference[v * 6 + c]);
                worst = std::isnan(off) ? INFINITY : std::max(worst, off);
            }
    }
    std::printf("59 poses within %.1e of the diagonal\n", worst / info.diagonal);
    return worst <= 1e-5 * info.diagonal ? 0 : 1;
} catch (const dm::Error &error) {
    std::fprintf(stderr, "%s (code %u)\n", error.what(), static_cast<unsigned>(error.code));
    return 1;
}
