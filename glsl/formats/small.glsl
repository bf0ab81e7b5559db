// small: as few bits as an entry needs, for the vertices in its mask. CPU: src/pack/formats/small.rs.

#define INTEGERS
#define DELTA ivec3

// The component of a record (96 bits at most) that starts at bit `at` and has `width` bits; 0 for no bits.
int record_field(uvec3 record, uint at, uint width) {
    uint low = at < 32u ? record.x : (at < 64u ? record.y : record.z);
    uint high = at < 32u ? record.y : (at < 64u ? record.z : 0u);
    uint shift = at & 31u;
    // Two shifts: one by 32 would be undefined.
    uint bits = (low >> shift) | ((high << 1) << (31u - shift));
    int field = int(bits << ((32u - width) & 31u)) >> ((32u - width) & 31u);
    return width == 0u ? 0 : field;
}

void load_entry(uint entry, uint lane, out DELTA position[VERTICES], out DELTA normal[VERTICES], out uvec2 shifts) {
    shifts = uvec2(0u);
    position[0] = ivec3(0);
    normal[0] = ivec3(0);
    uint header = headers_at + entry * (2u + BLOCK_SIZE / 32u);
    uint word = lane >> 5;
    uint mask = asset[header + 2u + word];
    uint bit = lane & 31u;
    if ((mask >> bit & 1u) == 0u) return;
    // The place of the record among those of the vertices in the mask.
    uint rank = uint(bitCount(mask & ((1u << bit) - 1u)));
    for (uint i = 0u; i < word; ++i) rank += uint(bitCount(asset[header + 2u + i]));
    uint widths = asset[header + 1u];
    uvec3 wp = uvec3(widths, widths >> 5, widths >> 10) & 31u;
    uvec3 wn = uvec3(widths >> 15, widths >> 20, widths >> 25) & 31u;
    uvec3 ap = uvec3(0u, wp.x, wp.x + wp.y);
    uint half_record = ap.z + wp.z;
    uvec3 an = half_record + uvec3(0u, wn.x, wn.x + wn.y);
    uint size = an.z + wn.z;
    uint from = rank * size;
    uint at = deltas_at + asset[header] + (from >> 5);
    uint shift = from & 31u;
    // Load no word that the record does not reach.
    uint w0 = asset[at];
    uint w1 = shift + size > 32u ? asset[at + 1u] : 0u;
    uint w2 = shift + size > 64u ? asset[at + 2u] : 0u;
    uint w3 = shift + size > 96u ? asset[at + 3u] : 0u;
    uvec3 record = (uvec3(w0, w1, w2) >> shift) | ((uvec3(w1, w2, w3) << 1) << (31u - shift));
    position[0] = ivec3(record_field(record, ap.x, wp.x), record_field(record, ap.y, wp.y), record_field(record, ap.z, wp.z));
    normal[0] = ivec3(record_field(record, an.x, wn.x), record_field(record, an.y, wn.y), record_field(record, an.z, wn.z));
}
