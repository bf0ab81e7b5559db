#version 450
// Skin, eyes, teeth and the rest under three lights. Colours are linear: the image's format makes sRGB of them.
#extension GL_GOOGLE_include_directive : require
#include "scene.glsl"
#include "heat.glsl"

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
};

// The share of the key light that arrives: four by four comparisons around the place.
float lit(vec3 n) {
    if (eye.w == 0.0) return 1.0;
    // Off the surface by a few texels of the map, so that it does not lie in its own shadow; by more where light grazes.
    float texel = eye.w / length(vec3(shadow[0][0], shadow[1][0], shadow[2][0]));
    float slope = min(1.0 - dot(n, key.xyz), 1.3);
    vec4 place = shadow * vec4(position + n * texel * (1.5 + 9.0 * slope), 1.0);
    float sum = 0.0;
    for (int y = 0; y < 4; y++)
        for (int x = 0; x < 4; x++)
            sum += texture(depths, vec3(place.xy + (vec2(x, y) - 1.5) * 1.5 * eye.w, place.z - 0.0015));
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
    Surface s = Surface(vec3(0.72, 0.68, 0.65), vec3(0.25), 0.16, 0.04);
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

Surface surface_of(uint kind) {
    switch (kind) {
        case EYE: return eyeball();
        case TEETH: return Surface(vec3(0.60, 0.55, 0.45), vec3(0.4), 0.38, 0.04);
        case MOUTH: return Surface(vec3(0.36, 0.10, 0.09), vec3(0.4, 0.2, 0.2), 0.35, 0.04);
        default: return Surface(vec3(0.53, 0.28, 0.19), vec3(0.42, 0.24, 0.17), 0.50, 0.026);
    }
}

void main() {
    vec3 v = normalize(eye.xyz - position);
    vec3 n = normalize(normal);
    // The inside of a surface, seen through an opening: the back of a lip, or a head without a neck.
    float outside = 1.0;
    if (!gl_FrontFacing) {
        n = -n;
        outside = 0.35;
    }
    if (show.x == SHOW_NORMALS) {
        pixel = vec4((0.5 + 0.5 * n) * outside, 1.0);
        return;
    }
    Surface s = surface_of(material);
    if (show.x == SHOW_CHECKER) {
        vec2 square = floor(shown.xy * show.z);
        float odd = mod(square.x + square.y, 2.0);
        vec3 tint = 0.35 + 0.6 * vec3(fract(shown.x), fract(shown.y), 0.5);
        s.albedo = mix(tint, tint * 0.18, odd);
    } else if (show.x == SHOW_DISTANCE || show.x == SHOW_VALUES) {
        s = Surface(heat(shown.z), vec3(0.4), 0.6, 0.02);
    }

    float shade = lit(n), facing = dot(n, key.xyz);
    // What the key light does not reach lies deep, more often than not: less of the other light gets there, too.
    float open = 0.6 + 0.4 * shade;
    vec3 key_colour = vec3(1.0, 0.95, 0.88) * key.w, fill_colour = vec3(0.66, 0.77, 1.0) * fill.w;
    vec3 rim_colour = vec3(0.85, 0.93, 1.0) * rim.w;
    vec3 above = vec3(0.15, 0.165, 0.19), below = vec3(0.085, 0.065, 0.055);
    vec3 around = mix(below, above, 0.5 + 0.5 * n.y);
    // Shadows let red through at their edges, as skin does.
    vec3 soft = pow(vec3(shade), 1.0 - 0.6 * s.wrap);
    vec3 light = s.albedo * (around * open + key_colour * soft * wrapped(facing, s.wrap) +
                             fill_colour * open * wrapped(dot(n, fill.xyz), s.wrap) +
                             rim_colour * wrapped(dot(n, rim.xyz), vec3(0.0)));
    float key_gloss = shade * highlight(n, key.xyz, v, s.roughness, s.specular);
    // A second, sharper lobe: the film of oil on skin.
    key_gloss += 0.15 * shade * highlight(n, key.xyz, v, s.roughness * 0.6, s.specular);
    light += key_colour * key_gloss;
    light += fill_colour * highlight(n, fill.xyz, v, s.roughness, s.specular);
    float grazing = pow(1.0 - clamp(dot(n, v), 0.0, 1.0), 4.0);
    light += rim_colour * 0.35 * grazing * clamp(dot(n, rim.xyz) + 0.3, 0.0, 1.0);
    // Bright parts are rolled off, not cut, and keep most of their hue.
    light *= outside;
    float most = max(max(light.r, light.g), max(light.b, 1e-4));
    vec3 rolled = mix(light * (1.0 - exp(-1.3 * most)) / most, 1.0 - exp(-1.3 * light), 0.4);
    pixel = vec4(clamp(rolled * 1.06, 0.0, 1.0), 1.0);
}
