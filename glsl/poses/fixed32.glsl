// fixed32: six integers, the displacement from the base pose in steps. CPU: src/pack/poses/fixed32.rs.

// All poses of a group of instances, where POSES_BINDING says and, with TEXELS, the binding after it; the number
// `at` of a pose is that of a component.
#define INTEGER_POSES
#define NUMBER int
#define ADDEND ivec3
#ifdef POSES_BINDING
#define NUMBER_OF(word) int(word)
#define WORD_OF(number) uint(number)
#include "poses/six_words.glsl"
#endif
