// fixed32: six integers in units. CPU: src/pack/poses/fixed32.rs.

#include "poses/integers.glsl"
#define POSE_ELEMENT int
#define NUMBER_OF(word) int(word)
#define WORD_OF(number) uint(number)
#include "poses/six_words.glsl"
