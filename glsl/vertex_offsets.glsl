// Offsets of the six numbers of a vertex in a pose: one after the other, or where the application has them in its own
// vertices. Specialization constants from OFFSETS_ID on, which pose formats (poses/) read; on the CPU: src/pack/vertex.rs. A
// number that is not stored has the offset of one that is.
layout(constant_id = OFFSETS_ID) const uint VERTEX_NUMBERS = 6;  // numbers from vertex to vertex
layout(constant_id = OFFSETS_ID + 1) const uint OFFSET_0 = 0;
layout(constant_id = OFFSETS_ID + 2) const uint OFFSET_1 = 1;
layout(constant_id = OFFSETS_ID + 3) const uint OFFSET_2 = 2;
layout(constant_id = OFFSETS_ID + 4) const uint OFFSET_3 = 3;
layout(constant_id = OFFSETS_ID + 5) const uint OFFSET_4 = 4;
layout(constant_id = OFFSETS_ID + 6) const uint OFFSET_5 = 5;
layout(constant_id = OFFSETS_ID + 7) const uint STORED = 63;     // a bit for each number: whether it is stored
#define STORES(number) ((STORED & (1u << (number))) != 0u)
#define HAS_OFFSETS
