// For two descriptors of the same memory: without the decoration Aliased, compilers assume that they do not overlap.
#extension GL_EXT_spirv_intrinsics : require
#define ALIASED spirv_decorate(20)
