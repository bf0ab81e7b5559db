// deltamorph.h with owners and exceptions, for C++17: handles are destroyed with their owners, results are checked.
// Owners declared later go first, as they have to: crowds and meshes before the engine.
#pragma once
#include <deltamorph.h>

#include <stdexcept>
#include <utility>

namespace deltamorph {

struct Error : std::runtime_error {
    DmResult code;
    explicit Error(DmResult code) : std::runtime_error(dm_last_error()), code(code) {}
};

inline void check(DmResult result) {
    if (result != DM_OK) throw Error(result);
}

// A structure with its size, and zeros for defaults.
template <class T> T sized() {
    T value{};
    value.struct_size = sizeof(T);
    return value;
}

template <class Handle, DmResult (*destroy)(Handle)> class Owned {
public:
    // Owned::make(dm_mesh_sample_head, nullptr, nullptr): the last argument, where the handle goes, is added.
    template <class... Takes, class... Args> static Owned make(DmResult (*create)(Takes...), const Args &...args) {
        Owned owned;
        check(create(args..., &owned.handle));
        return owned;
    }
    Owned() = default;
    Owned(Owned &&other) noexcept : handle(std::exchange(other.handle, Handle{})) {}
    Owned &operator=(Owned &&other) noexcept {
        std::swap(handle, other.handle);
        return *this;
    }
    ~Owned() {
        if (handle.bits) destroy(handle);
    }
    operator Handle() const { return handle; }

private:
    Handle handle{};
};

using Mesh = Owned<DmMesh, dm_mesh_destroy>;
using Engine = Owned<DmEngine, dm_engine_destroy>;
using GpuMesh = Owned<DmGpuMesh, dm_gpu_mesh_destroy>;
using Crowd = Owned<DmCrowd, dm_crowd_destroy>;
using Readback = Owned<DmReadback, dm_readback_destroy>;
using Skin = Owned<DmSkin, dm_skin_destroy>;
using Surface = Owned<DmSurface, dm_surface_destroy>;
using Clip = Owned<DmClip, dm_clip_destroy>;
using BoundClip = Owned<DmBoundClip, dm_bound_clip_destroy>;

} // namespace deltamorph
