// pair: 13 bits per component of the first triple, 8 of the second, in two adjacent words. CPU:
// src/pack/formats/pair.rs.

#define INTEGERS
#define DELTA ivec3

void load_entry(uint entry, uint lane, out DELTA position[VERTICES], out DELTA normal[VERTICES], out uvec2 shifts) {
    uint header = asset[entry];
    shifts = uvec2(header & 0xffu, (header >> 8) & 0xffu);
    // Deltas begin at a multiple of four words. The expression shows compilers an even index: one aligned load of both
    // words.
    uint pair = deltas_at / 2u + entry * BLOCK_SIZE + lane;
    uint a = asset[2u * pair], b = asset[2u * pair + 1u];
    position[0] =
        ivec3(bitfieldExtract(int(a), 0, 13), bitfieldExtract(int(a), 13, 13), bitfieldExtract(int(b), 0, 13));
    normal[0] =
        ivec3(bitfieldExtract(int(b), 13, 8), bitfieldExtract(int(b), 21, 8), (int(b) >> 29) * 32 + int(a >> 26));
}
