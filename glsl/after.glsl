// Shared by post-morph passes, which write one or two streams of the vertices of an instance: a lane processes a vertex,
// PIECE lanes a piece.
layout(local_size_x = WORKGROUP) in;

// Whether outputs have the order of the mesh, and not that of poses. For each stream: the first of the group's six numbers
// that it has, and its format (src/abi/numbers.rs).
layout(constant_id = 0) const bool REORDERS = false;
layout(constant_id = 1) const uint FIRST_0 = 0u;
layout(constant_id = 2) const uint FORMAT_0 = 3u;
layout(constant_id = 3) const uint FIRST_1 = 0u;
layout(constant_id = 4) const uint FORMAT_1 = 0u;

#define POSES_BINDING 0
#include "pose.glsl"
layout(set = 0, binding = 1) uniform utextureBuffer pieces;
layout(set = 0, binding = 2, std430) buffer Written { uint written[]; };
layout(set = 0, binding = 3) uniform utextureBuffer order; // for each vertex of a pose, the vertex of the mesh

layout(push_constant) uniform Push {
    float units[6];     // input units per number of a vertex
    float offsets[6];   // the values of number 0
    uint written_at[2]; // for each stream: index of the first word to write
    uint strides[2];    // and words from vertex to vertex
    uint pose_at;       // index of the pose's first number
    uint vertices;
    uint count;         // pieces to write
    uint listed;        // 1: those of the list; 0: the first ones
    uint reads_at;      // where what the kernel reads beside poses begins
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

// Loads the first and the last three numbers of a vertex: its position and normal, in the first group.
void load(uint vertex, out vec3 first, out vec3 last) {
    ADDEND loaded_first, loaded_last;
    LOAD_VERTEX(poses, pose_at + 6u * vertex, loaded_first, loaded_last)
    first = vec3(offsets[0], offsets[1], offsets[2]) + vec3(loaded_first) * vec3(units[0], units[1], units[2]);
    last = vec3(offsets[3], offsets[4], offsets[5]) + vec3(loaded_last) * vec3(units[3], units[4], units[5]);
}

// Returns the unit vector; zero stays zero.
vec3 direction(vec3 vector) {
    float length2 = dot(vector, vector);
    return length2 > 0.0 ? vector * inversesqrt(length2) : vector;
}

// Writes a stream from word `at` on. Bits of a fourth component keep their values.
void store(uint format, uint at, vec4 numbers) {
    if (format < UNIT_FLOATS) {
        [[unroll]] for (uint i = 0u; i < 4u; ++i) {
            if (i < format) {
                written[at + i] = floatBitsToUint(numbers[i]);
            }
        }
        return;
    }
    vec3 unit = direction(numbers.xyz);
    if (format == UNIT_FLOATS) {
        written[at] = floatBitsToUint(unit.x);
        written[at + 1u] = floatBitsToUint(unit.y);
        written[at + 2u] = floatBitsToUint(unit.z);
    } else if (format == SNORM16) {
        written[at] = packSnorm2x16(unit.xy);
        written[at + 1u] = bitfieldInsert(written[at + 1u], packSnorm2x16(unit.zz), 0, 16);
    } else if (format == SNORM8) {
        written[at] = bitfieldInsert(written[at], packSnorm4x8(vec4(unit, 0.0)), 0, 24);
    } else {
        ivec3 tens = ivec3(round(clamp(unit, -1.0, 1.0) * 511.0)) & 0x3ff;
        written[at] = bitfieldInsert(written[at], uint(tens.x | tens.y << 10 | tens.z << 20), 0, 30);
    }
}

// Writes the streams of a vertex, of its six numbers.
void store_streams(uint vertex, vec3 first, vec3 last) {
    float numbers[9] = float[](first.x, first.y, first.z, last.x, last.y, last.z, 0.0, 0.0, 0.0);
    uint to = REORDERS ? texelFetch(order, int(vertex)).x : vertex;
#define STREAM(i) store(FORMAT_##i, written_at[i] + strides[i] * to, vec4(numbers[FIRST_##i], numbers[FIRST_##i + 1u], \
        numbers[FIRST_##i + 2u], numbers[FIRST_##i + 3u]));
    STREAM(0)
    if (FORMAT_1 != 0u) {
        STREAM(1)
    }
}
