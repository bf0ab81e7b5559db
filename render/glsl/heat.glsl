// From nothing (grey) over blue, green and yellow to red, and white beyond the end of the scale. Linear colours.
vec3 heat(float t) {
    const vec3 stops[6] = vec3[](vec3(0.10, 0.10, 0.11), vec3(0.03, 0.10, 0.45), vec3(0.02, 0.38, 0.42),
                                 vec3(0.12, 0.50, 0.06), vec3(0.80, 0.52, 0.02), vec3(0.72, 0.03, 0.02));
    if (t > 1.0) return vec3(0.95, 0.75, 0.9);
    float at = clamp(t, 0.0, 1.0) * 5.0;
    int i = min(int(at), 4);
    return mix(stops[i], stops[i + 1], at - float(i));
}
