// block-float32: six planes of float32. CPU: src/pack/formats/block_float32.rs.

#define DELTA vec3

void load_entry(uint entry, uint lane, out DELTA position[VERTICES], out DELTA normal[VERTICES], out uvec2 shifts) {
    shifts = uvec2(0u);
    uint at = deltas_at + entry * (6u * BLOCK_SIZE) + lane;
    position[0] = vec3(uintBitsToFloat(asset[at]), uintBitsToFloat(asset[at + BLOCK_SIZE]),
                       uintBitsToFloat(asset[at + 2u * BLOCK_SIZE]));
    normal[0] = vec3(uintBitsToFloat(asset[at + 3u * BLOCK_SIZE]), uintBitsToFloat(asset[at + 4u * BLOCK_SIZE]),
                     uintBitsToFloat(asset[at + 5u * BLOCK_SIZE]));
}
