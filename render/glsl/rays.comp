#version 460
// A pose in the colours of its normals, by rays: what face.frag draws for SHOW_NORMALS. For examples/rays.rs.
#extension GL_EXT_ray_query : require
#extension GL_EXT_buffer_reference : require

layout(local_size_x = 8, local_size_y = 8) in;

layout(buffer_reference, std430) readonly buffer Vertices { float numbers[]; }; // six for each: position and normal
layout(buffer_reference, std430) readonly buffer Corners { uint vertices[]; };
layout(buffer_reference, std430) writeonly buffer Pixels { uvec2 pixels[]; };   // sRGB, and whether triangles meet there

layout(push_constant) uniform Push { // `Push` in examples/rays.rs
    mat4 from_clip;
    vec4 eye;
    uvec2 world;
    Vertices pose;
    Corners corners;
    Pixels picture;
};

vec3 normal_of(uint vertex) {
    uint at = 6u * vertex + 3u;
    return normalize(vec3(pose.numbers[at], pose.numbers[at + 1u], pose.numbers[at + 2u]));
}

// The colour that is seen at a place of the picture, and the triangle; black if there is none.
vec3 trace(vec2 place, out uint triangle) {
    vec4 far = from_clip * vec4(2.0 * place - 1.0, 1.0, 1.0);
    rayQueryEXT ray;
    rayQueryInitializeEXT(ray, accelerationStructureEXT(world), gl_RayFlagsOpaqueEXT, 0xffu, eye.xyz, 0.0,
                          far.xyz / far.w - eye.xyz, 1.0);
    while (rayQueryProceedEXT(ray)) {}
    triangle = ~0u;
    if (rayQueryGetIntersectionTypeEXT(ray, true) == gl_RayQueryCommittedIntersectionNoneEXT) return vec3(0.0);
    triangle = uint(rayQueryGetIntersectionPrimitiveIndexEXT(ray, true));
    vec2 b = rayQueryGetIntersectionBarycentricsEXT(ray, true);
    vec3 n = vec3(0.0), part = vec3(1.0 - b.x - b.y, b);
    for (uint i = 0u; i < 3u; i++) n += part[i] * normal_of(corners.vertices[3u * triangle + i]);
    n = normalize(n);
    return rayQueryGetIntersectionFrontFaceEXT(ray, true) ? 0.5 + 0.5 * n : 0.35 * (0.5 - 0.5 * n);
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy, size = gl_NumWorkGroups.xy * gl_WorkGroupSize.xy;
    // As rasterisers with four samples do: a triangle is shaded in the middle, and mixed with others by samples.
    const vec2 SAMPLES[4] = vec2[](vec2(0.375, 0.125), vec2(0.875, 0.375), vec2(0.125, 0.625), vec2(0.625, 0.875));
    uint middle, sampled, meet = 0u;
    vec3 colour = trace((vec2(pixel) + 0.5) / vec2(size), middle), sum = vec3(0.0);
    for (int i = 0; i < 4; i++) {
        sum += trace((vec2(pixel) + SAMPLES[i]) / vec2(size), sampled);
        meet |= sampled ^ middle;
    }
    if (meet != 0u) colour = sum / 4.0;
    vec3 srgb = mix(1.055 * pow(colour, vec3(1.0 / 2.4)) - 0.055, 12.92 * colour, lessThan(colour, vec3(0.0031308)));
    picture.pixels[pixel.y * size.x + pixel.x] = uvec2(packUnorm4x8(vec4(srgb, 1.0)), min(meet, 1u));
}
