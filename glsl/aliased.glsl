// Two descriptors of the same memory: without the decoration Aliased compilers take them for different memory.
#extension GL_EXT_spirv_intrinsics : require
#define ALIASED spirv_decorate(20)
