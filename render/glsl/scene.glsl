// What the host says of a head and of the light on it, all in the mesh's own space: `HeadScene` in src/scene.rs, where a test
// compares offsets.
layout(set = 0, binding = 0, std140) uniform Scene {
    mat4 clip;       // to the picture
    mat4 shadow;     // to the shadow map: x and y from 0 to 1, and depth
    vec4 eye;        // where the camera is; w: size of a texel of the shadow map, 0 where nothing casts shadows
    vec4 key;        // towards the key light; w: how bright
    vec4 fill;       // towards the fill light
    vec4 rim;        // towards the rim light
    vec4 middle;     // of what is drawn of the base pose; w: how far it reaches from there
    vec4 show;       // x: what is shown (SHOW_…), y: which value is the end of the scale
};

const float SHOW_SHADED = 0.0;
const float SHOW_DISTANCE = 1.0; // from the base pose
const float SHOW_NORMALS = 2.0;
const float SHOW_WIRE = 3.0;
const float SHOW_MOTION = 4.0;   // from the previous pose
const float SHOW_BLOCKS = 5.0;   // pieces that updates have changed, by `told`
const float SHOW_WRINKLES = 6.0; // where the pose compresses the skin, by its masks

// What the host tells of each head: how bright each piece of vertices is, from 1 (changed now) down to 0 (`Glow` in
// src/glow.rs).
layout(set = 0, binding = 2, std430) readonly buffer Told {
    float told[];
};
const uint PIECE = 32u; // vertices

// What is drawn with one material: `PartPush` in src/scene.rs.
layout(push_constant) uniform Part {
    vec4 ball;    // an eyeball in the base pose: middle and radius; radius 0: none
    vec4 colour;  // of what is painted, linear
    vec4 scale;   // of attributes: the values of a position's numbers; w: of a normal's
    vec4 offset;  // the position of number 0
    vec4 mask_scale; // of the two wrinkle masks, and their values of number 0
    uint material;
    uint first_told;  // of the head, in `told`; NONE_TOLD: nothing is told of what stands still
    uint block;       // vertices of a block, or of the mesh where there are none
};

const uint SKIN = 0u;
const uint EYE = 1u;
const uint TEETH = 2u;
const uint MOUTH = 3u;
const uint WIRE = 4u; // edges of faces: lines
const uint PAINTED = 5u; // a surface that the file states
const uint SHEET = 6u; // the same, with two sides
const uint NONE_TOLD = 0xffffffffu;
