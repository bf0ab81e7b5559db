// Places of the six numbers of a vertex in a pose: one after the other, or as the host arranges them in its own
// vertices. Specialization constants from PLACES_ID on, which pose formats (poses/) read; host: src/pack/vertex.rs. A
// number that is not stored has the place of one that is.
layout(constant_id = PLACES_ID) const uint VERTEX_NUMBERS = 6;  // numbers from vertex to vertex
layout(constant_id = PLACES_ID + 1) const uint PLACE_0 = 0;
layout(constant_id = PLACES_ID + 2) const uint PLACE_1 = 1;
layout(constant_id = PLACES_ID + 3) const uint PLACE_2 = 2;
layout(constant_id = PLACES_ID + 4) const uint PLACE_3 = 3;
layout(constant_id = PLACES_ID + 5) const uint PLACE_4 = 4;
layout(constant_id = PLACES_ID + 6) const uint PLACE_5 = 5;
layout(constant_id = PLACES_ID + 7) const uint STORED = 63;     // a bit for each number: whether it is stored
#define STORES(number) ((STORED & (1u << (number))) != 0u)
#define HAS_PLACES
