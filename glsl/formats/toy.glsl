// toy: 16 bits per component, in three adjacent words. CPU: src/pack/formats/toy.rs.

#define INTEGERS
#define DELTA ivec3

void load_entry(uint entry, uint lane, out DELTA position[VERTICES], out DELTA normal[VERTICES], out uvec2 shifts) {
    uint header = asset[headers_at + entry];
    shifts = uvec2(header & 0xffu, (header >> 8) & 0xffu);
    uint at = deltas_at + (entry * BLOCK_SIZE + lane) * 3u;
    int a = int(asset[at]), b = int(asset[at + 1u]), c = int(asset[at + 2u]);
    position[0] = ivec3(bitfieldExtract(a, 0, 16), a >> 16, bitfieldExtract(b, 0, 16));
    normal[0] = ivec3(b >> 16, bitfieldExtract(c, 0, 16), c >> 16);
}
