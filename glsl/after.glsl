// Shared by post-morph passes, which write vertices of an instance: a lane processes a vertex, PIECE lanes a piece.
// The including file defines OFFSETS_ID, the number of specialization constants before the component offsets.
layout(local_size_x = WORKGROUP) in;

#include "vertex_offsets.glsl"
#define POSES_BINDING 0
#include "pose.glsl"
layout(set = 0, binding = 1) uniform utextureBuffer pieces;
layout(set = 0, binding = 2, std430) writeonly buffer Written { float written[]; };

layout(push_constant) uniform Push {
    vec4 units;       // input units per number of a position; in w, of a normal
    vec4 offset;      // the position of number 0
    uint pose_at;     // index of the pose's first number
    uint written_at;  // index of the first number to write
    uint stride;      // words from vertex to vertex
    uint normal_at;   // words from a position to its normal; 0: there is none
    uint vertices;
    uint count;       // pieces to write
    uint listed;      // 1: those of the list; 0: the first ones
    uint reads_at;    // where what the kernel reads beside poses begins
};

// Returns `vertices` or more if the lane has no vertex.
uint vertex_of_lane() {
    uint at = gl_GlobalInvocationID.x / PIECE;
    if (at >= count) {
        return vertices;
    }
    uint piece = listed != 0u ? texelFetch(pieces, int(at)).x : at;
    return piece * PIECE + gl_GlobalInvocationID.x % PIECE;
}

void load(uint vertex, out vec3 position, out vec3 normal) {
    ADDEND loaded_position, loaded_normal;
    LOAD_VERTEX(poses, pose_at + VERTEX_NUMBERS * vertex, loaded_position, loaded_normal)
    position = offset.xyz + vec3(loaded_position) * units.xyz;
    normal = vec3(loaded_normal) * units.w;
}

void store(uint at, vec3 value) {
    written[at] = value.x;
    written[at + 1u] = value.y;
    written[at + 2u] = value.z;
}
