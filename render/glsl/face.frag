#version 450
// Skin, eyes, teeth and the rest under three lights. Colours are linear: the image's format makes sRGB of them.
#extension GL_GOOGLE_include_directive : require
#include "scene.glsl"
#include "heat.glsl"

// Where it is not set, SHOW_SHADED is all there is, and no EYE: software drivers carry out all branches for all pixels.
layout(constant_id = 0) const bool GENERAL = true;

layout(set = 0, binding = 1) uniform sampler2DShadow depths;

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 rest;
layout(location = 3) in vec3 shown;

layout(location = 0) out vec4 pixel;

// What a surface is made of.
struct Surface {
    vec3 albedo;
    vec3 wrap;       // how far light of each colour reaches behind the edge of the shade (skin lets red through)
    float roughness;
    float specular;  // reflected towards the eye, head-on
    float reach;     // the share of the light without shadows that gets there: less inside a mouth
};

// The share of the key light that arrives: comparisons at places that spiral outwards, as seeds of a sunflower lie, so that
// no direction has fewer steps than another.
float lit(vec3 n) {
    if (eye.w == 0.0) return 1.0;
    // Off the surface by a few texels of the map, so that it does not lie in its own shadow; by more where light grazes.
    float texel = eye.w / length(vec3(shadow[0][0], shadow[1][0], shadow[2][0]));
    float slope = min(1.0 - dot(n, key.xyz), 1.3);
    vec4 place = shadow * vec4(position + n * texel * (2.0 + 9.0 * slope), 1.0);
    const vec2 seeds[16] = vec2[](
        vec2(0.177, 0.000), vec2(-0.226, 0.207), vec2(0.035, -0.394), vec2(0.285, 0.371),
        vec2(-0.522, -0.092), vec2(0.495, -0.315), vec2(-0.165, 0.616), vec2(-0.316, -0.608),
        vec2(0.685, 0.250), vec2(-0.712, 0.294), vec2(0.343, -0.734), vec2(0.254, 0.809),
        vec2(-0.765, -0.443), vec2(0.897, -0.197), vec2(-0.548, 0.779), vec2(-0.126, -0.976));
    const float REACH = 6.0; // texels
    float sum = 0.0;
    for (int i = 0; i < 16; i++)
        sum += texture(depths, vec3(place.xy + seeds[i] * (REACH * eye.w), place.z - 0.0015));
    return sum / 16.0;
}

// Diffuse light that wraps around the edge, energy kept.
vec3 wrapped(float cosine, vec3 wrap) {
    vec3 reach = clamp((vec3(cosine) + wrap) / (1.0 + wrap), 0.0, 1.0);
    return reach * reach / (1.0 + wrap);
}

// Blinn and Phong's highlight, normalised, with Schlick's approximation of Fresnel's term.
float highlight(vec3 n, vec3 l, vec3 v, float roughness, float specular) {
    vec3 h = normalize(l + v);
    float shininess = 2.0 / (roughness * roughness * roughness * roughness) - 2.0;
    float fresnel = specular + (1.0 - specular) * pow(1.0 - clamp(dot(h, v), 0.0, 1.0), 5.0);
    float lobe = (shininess + 2.0) / 8.0 * pow(clamp(dot(n, h), 0.0, 1.0), shininess);
    return fresnel * lobe * clamp(dot(n, l), 0.0, 1.0);
}

// An eyeball: iris and pupil around the pole that looks forwards (+z) in the base pose; they go with the vertices.
Surface eyeball() {
    Surface s = Surface(vec3(0.72, 0.68, 0.65), vec3(0.25), 0.16, 0.04, 1.0);
    if (ball.w == 0.0) return s;
    vec3 out_of = (rest - ball.xyz) / ball.w;
    float off = out_of.z > 0.0 ? length(out_of.xy) : 2.0; // sine of the angle from the pole
    const float IRIS = 0.47, PUPIL = 0.19;
    float edge = fwidth(off);
    float ray = atan(out_of.y, out_of.x);
    float fibres = 0.82 + 0.18 * sin(ray * 23.0) * sin(ray * 7.0 + off * 19.0);
    vec3 iris = mix(vec3(0.09, 0.16, 0.20), vec3(0.16, 0.12, 0.06), smoothstep(IRIS, PUPIL, off)) * fibres;
    iris *= 1.0 - 0.85 * smoothstep(IRIS * 0.82, IRIS, off); // the dark ring around it
    vec3 inner = mix(vec3(0.004), iris, smoothstep(PUPIL - edge, PUPIL + edge, off));
    s.albedo = mix(inner, s.albedo * mix(vec3(1.0, 0.80, 0.76), vec3(1.0), smoothstep(1.0, 0.6, off)),
                   smoothstep(IRIS - edge, IRIS + edge + 0.02, off));
    return s;
}

// What glows: yellow, then orange and red, until it is out.
vec3 embers(float t) {
    return t * vec3(0.90, 0.40 * t, 0.05 * t * t);
}

// A number from 0 to 1 for each place of a lattice, the same on every device.
float random(ivec3 place) {
    uvec3 p = uvec3(place);
    uint h = p.x * 0x9e3779b1u ^ p.y * 0x85ebca77u ^ p.z * 0xc2b2ae3du;
    h = (h ^ (h >> 15)) * 0x2c1b3c6du;
    h = (h ^ (h >> 12)) * 0x297a2d39u;
    return float((h ^ (h >> 15)) >> 8) / 16777216.0;
}

// Noise from 0 to 1 that varies over a length of 1, from random numbers at the corners of a lattice.
float noise(vec3 p) {
    vec3 cell = floor(p), t = fract(p);
    t = t * t * (3.0 - 2.0 * t);
    float sum = 0.0;
    for (int i = 0; i < 8; i++) {
        ivec3 corner = ivec3(i & 1, (i >> 1) & 1, i >> 2);
        vec3 near = mix(1.0 - t, t, vec3(corner));
        sum += random(ivec3(cell) + corner) * near.x * near.y * near.z;
    }
    return sum;
}

// A groove for each turn of the angle, flat between them: how deep it is (0 to 1), and its slope by the angle.
vec2 groove(float angle) {
    const float WIDTH = 0.42;
    float q = sin(0.5 * angle) / WIDTH, deep = exp(-q * q);
    return vec2(deep, -deep * q * cos(0.5 * angle) / WIDTH);
}

// The normal with wrinkles: the two maps, of lines across the face and of lines upwards, are blended in by the masks, which say
// how far the skin is compressed the other way. They are made of the place in the base pose: no mesh brings them.
vec3 wrinkled(vec3 n, inout Surface s) {
    vec3 up = vec3(0.0, 1.0, 0.0) - n * n.y;
    if (dot(up, up) < 0.05) return n;
    up = normalize(up);
    const float LINES = 140.0, STEEP = 0.5, BEGIN = 0.03, END = 0.18;
    vec3 p = (rest - middle.xyz) / middle.w;
    vec2 amount = smoothstep(vec2(BEGIN), vec2(END), shown.xy);
    // Lines bend, and neither begin nor end all at once.
    vec2 bend = 5.0 * vec2(noise(p * 7.0), noise(p * 7.0 + 31.7));
    amount *= 0.35 + 0.65 * smoothstep(0.3, 0.6, vec2(noise(p * 11.0 + 5.3), noise(p * 11.0 + 17.9)));
    vec2 across = groove(LINES * p.y + bend.x), upwards = groove(LINES * p.x + bend.y);
    // A groove is a depth: the normal leans towards where it goes down.
    n += STEEP * (amount.x * across.y * up + amount.y * upwards.y * cross(up, n));
    float deep = max(amount.x * across.x, amount.y * upwards.x);
    s.albedo *= 1.0 - 0.35 * deep * s.wrap;
    return normalize(n);
}

Surface surface_of(uint kind) {
    if (GENERAL && kind == EYE) return eyeball();
    switch (kind) {
        case TEETH: return Surface(vec3(0.60, 0.55, 0.45), vec3(0.4), 0.38, 0.04, 0.5);
        case MOUTH: return Surface(vec3(0.36, 0.10, 0.09), vec3(0.4, 0.2, 0.2), 0.35, 0.04, 0.4);
        case PAINTED:
        case SHEET: return Surface(vec3(1.0), vec3(0.2), 0.60, 0.02, 1.0);
        case WIRE: return Surface(vec3(0.42, 0.60, 0.66), vec3(0.5), 0.7, 0.01, 1.0);
        default: return Surface(vec3(0.53, 0.28, 0.19), vec3(0.42, 0.24, 0.17), 0.50, 0.026, 1.0);
    }
}

// What a surface is made of to show something else.
Surface shown_as(Surface s) {
    if (show.x == SHOW_DISTANCE || show.x == SHOW_MOTION) {
        s = Surface(heat(shown.z), vec3(0.4), 0.6, 0.02, s.reach);
    } else if (show.x == SHOW_WIRE && material != WIRE) {
        s = Surface(s.albedo * 0.10 + vec3(0.012, 0.016, 0.022), s.wrap, 0.6, 0.015, s.reach);
    } else if (show.x == SHOW_BLOCKS) {
        s = Surface(s.albedo * 0.12 + vec3(0.020, 0.024, 0.030), s.wrap, 0.6, 0.02, s.reach);
        s.albedo += embers(shown.z) * (0.12 + 0.68 * shown.x);
    }
    return s;
}

void main() {
    vec3 v = normalize(eye.xyz - position);
    vec3 n = normalize(normal);
    // The inside of a surface, seen through an opening: the back of a lip, or a head without a neck.
    float outside = 1.0;
    if (!gl_FrontFacing) {
        n = -n;
        if (material != SHEET) outside = 0.35;
    }
    if (GENERAL && show.x == SHOW_NORMALS) {
        pixel = vec4((0.5 + 0.5 * n) * outside, 1.0);
        return;
    }
    Surface s = surface_of(material);
    if (material >= PAINTED) s.albedo = colour.rgb;
    if (GENERAL) s = shown_as(s);
    if (GENERAL && show.x == SHOW_WRINKLES && material == SKIN) n = wrinkled(n, s);

    float shade = lit(n), facing = dot(n, key.xyz);
    // What the key light does not reach lies deep, more often than not: less of the other light gets there, too.
    float open = (0.72 + 0.28 * shade) * s.reach;
    vec3 key_colour = vec3(1.0, 0.95, 0.88) * key.w, fill_colour = vec3(0.80, 0.82, 0.96) * fill.w;
    // What lies on the other side of the middle is in the head's own shadow: lips and teeth, whichever way they face.
    float behind = smoothstep(-0.25, 0.10, dot(position - middle.xyz, rim.xyz) / middle.w);
    vec3 rim_colour = vec3(0.85, 0.93, 1.0) * rim.w * behind;
    vec3 above = vec3(0.165, 0.165, 0.175), below = vec3(0.100, 0.074, 0.060);
    vec3 around = mix(below, above, 0.5 + 0.5 * n.y);
    // Inside a mouth light has been reflected by what is red.
    if (s.reach < 1.0) around *= vec3(1.25, 0.85, 0.75);
    // Shadows let red through at their edges, as skin does.
    vec3 soft = pow(vec3(shade), 1.0 - 0.6 * s.wrap);
    vec3 light = s.albedo * (around * open + key_colour * soft * wrapped(facing, s.wrap) +
                             fill_colour * open * wrapped(dot(n, fill.xyz), s.wrap) +
                             rim_colour * wrapped(dot(n, rim.xyz), vec3(0.0)));
    float key_gloss = shade * highlight(n, key.xyz, v, s.roughness, s.specular);
    // A second, sharper lobe: the film of oil on skin.
    key_gloss += 0.15 * shade * highlight(n, key.xyz, v, s.roughness * 0.6, s.specular);
    light += key_colour * key_gloss;
    light += fill_colour * s.reach * highlight(n, fill.xyz, v, s.roughness, s.specular);
    float grazing = pow(1.0 - clamp(dot(n, v), 0.0, 1.0), 4.0);
    light += rim_colour * 0.35 * grazing * clamp(dot(n, rim.xyz) + 0.3, 0.0, 1.0);
    light *= outside;
    if (GENERAL && show.x == SHOW_BLOCKS) light += 0.22 * embers(shown.z);
    // Bright parts are rolled off, not cut, and keep most of their hue.
    float most = max(max(light.r, light.g), max(light.b, 1e-4));
    vec3 rolled = mix(light * (1.0 - exp(-1.3 * most)) / most, 1.0 - exp(-1.3 * light), 0.4);
    pixel = vec4(clamp(rolled * 1.06, 0.0, 1.0), 1.0);
}
