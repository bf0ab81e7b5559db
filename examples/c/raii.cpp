// The built-in head plays its clip, evaluated in double precision without Vulkan: owners and exceptions for C++17.
//
//     cargo build --release -p deltamorph-c
//     capi/install PREFIX target/release
//     c++ -std=c++17 -I PREFIX/include examples/c/raii.cpp -L PREFIX/lib -ldeltamorph_c -Wl,-rpath,PREFIX/lib -o raii
#include <deltamorph.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

namespace dm = deltamorph;

int main() try {
    auto head = dm::sized<DmSampleDesc>();
    head.vertices = 2000;
    const auto mesh = dm::Mesh::make(dm_mesh_sample_head, &head, nullptr);
    const auto frames = dm::Clip::make(dm_clip_sample_head, &head, 30, 30.0f);
    const auto clip = dm::BoundClip::make(dm_clip_bind, frames, mesh);
    auto info = dm::sized<DmMeshInfo>();
    dm::check(dm_mesh_info(mesh, &info));

    std::vector<float> weights(info.target_count);
    std::vector<double> base(info.vertex_count * 6), pose(base.size());
    dm::check(dm_mesh_evaluate(mesh, nullptr, 0, base.data(), base.size()));
    double furthest = 0;
    for (double frame = 0; frame <= 29; frame += 0.5) {
        dm::check(dm_bound_clip_sample(clip, frame, weights.data(), info.target_count));
        dm::check(dm_mesh_evaluate(mesh, weights.data(), info.target_count, pose.data(), pose.size()));
        for (size_t v = 0; v < info.vertex_count; v++) { // six numbers a vertex: position, then normal
            const double *from = &base[v * 6], *to = &pose[v * 6];
            furthest = std::max(furthest, std::hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]));
        }
    }
    std::printf("59 poses move vertices by up to %.3f of the diagonal\n", furthest / info.diagonal);
    return furthest > 0 ? 0 : 1;
} catch (const dm::Error &error) {
    std::fprintf(stderr, "%s (code %u)\n", error.what(), static_cast<unsigned>(error.code));
    return 1;
}
