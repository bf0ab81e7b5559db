// Shared by the passes of texture: a rectangle of texels that a target moves.

layout(push_constant) uniform Push {
    vec2 scale;          // from texels to clip space: 2 / size of the displacement textures
    vec2 coefficients;   // of positions and of normals, in steps of the target's deltas
    uint row;            // texels of a row of the delta textures
};
