/* What deltamorph.h of the first 0.1 declares: UPDATE_FIRST_HEADER=1 before its release. */
#pragma once
#include <stddef.h>
#include <stdint.h>
#include <vulkan/vulkan_core.h>
#define DM_MESH_SPLIT 1
#define DM_MESH_WELD 2
#define DM_MESH_KEEP_ALL 4
#define DM_MESSAGE_NOTE 1
#define DM_DELTAS_FLOAT32 1
#define DM_DELTAS_SNORM16 2
#define DM_DELTAS_FAST 4
#define DM_DELTAS_SMALL 5
#define DM_POSE_FLOAT32 1
#define DM_POSE_FIXED32 2
#define DM_POSE_FIXED16 3
#define DM_POSE_REBUILT16 4
#define DM_PATH_BLOCKS 1
#define DM_PATH_COMPUTE 2
#define DM_PATH_FEEDBACK 3
#define DM_MODE_INCREMENTAL 1
#define DM_MODE_REBUILD 2
#define DM_READ_BY_VERTEX_ATTRIBUTES 1
#define DM_READ_BY_VERTEX_SHADERS 2
#define DM_READ_BY_COMPUTE_SHADERS 4
#define DM_READ_BY_COPIES 8
#define DM_READ_BY_ACCELERATION_STRUCTURES 16
#define DM_READ_BY_MESH_SHADERS 32
#define DM_READ_BY_FRAGMENT_SHADERS 64
#define DM_READ_BY_RAY_TRACING_SHADERS 128
#define DM_SKIN_LINEAR 1
#define DM_SKIN_DUAL_QUATERNION 2
#define DM_STREAM_POSITION 1
#define DM_STREAM_NORMAL 2
#define DM_STREAM_TANGENT 3
#define DM_STREAM_TEXCOORD 4
#define DM_STREAM_COLOR 5
#define DM_STREAM_MASK 6
#define DM_VERSION_MAJOR 0
#define DM_VERSION_MINOR 1
#define DM_VERSION_PATCH 0
typedef uint32_t DmResult;
typedef struct DmRequirement { const char *extension; const char *feature; const char *reason; } DmRequirement;
typedef struct DmMesh { uint64_t bits; } DmMesh;
typedef struct DmMeshInfo { uint32_t struct_size; uint32_t vertex_count; uint32_t padded_vertex_count; uint32_t target_count; uint32_t index_count; uint32_t delta_format; float diagonal; uint32_t reserved; uint64_t pose_bytes; uint64_t device_bytes; } DmMeshInfo;
typedef struct DmRenderVertices { uint32_t struct_size; uint32_t vertex_count; uint32_t index_count; uint32_t reserved; uint32_t *pose_vertices; float *texcoords; uint32_t *indices; } DmRenderVertices;
typedef struct DmEngine { uint64_t bits; } DmEngine;
typedef void (*DmMessage)(void *user, uint32_t severity, const char *text);
typedef struct DmMeshDesc { uint32_t struct_size; uint32_t flags; struct DmEngine engine; float position_tolerance; float normal_tolerance; uint32_t delta_format; uint32_t block_size; float position_error; float normal_error_degrees; float absolute_error; float weight_max; DmMessage message; void *message_user; } DmMeshDesc;
typedef struct DmTargetArrays { uint32_t struct_size; uint32_t stride; const char *name; const float *positions; const float *normals; const float *tangents; } DmTargetArrays;
typedef struct DmMeshArrays { uint32_t struct_size; uint32_t vertex_count; const char *name; const float *positions; const float *normals; const float *tangents; const float *texcoords; const uint32_t *indices; const struct DmTargetArrays *targets; uint32_t index_count; uint32_t target_count; uint32_t absolute; uint32_t stride; } DmMeshArrays;
typedef struct DmClip { uint64_t bits; } DmClip;
typedef struct DmClipArrays { uint32_t struct_size; uint32_t frame_count; uint32_t column_count; float fps; const char *name; const char *const *names; const float *values; } DmClipArrays;
typedef struct DmClipInfo { uint32_t struct_size; uint32_t frame_count; uint32_t column_count; float fps; } DmClipInfo;
typedef struct DmBoundClip { uint64_t bits; } DmBoundClip;
typedef struct DmSampleDesc { uint32_t struct_size; uint32_t vertices; uint32_t targets; float sparsity; uint64_t seed; } DmSampleDesc;
typedef struct DmMemoryRequest { uint64_t size; uint64_t alignment; uint32_t type_bits; uint32_t required; uint32_t preferred; uint32_t reserved; } DmMemoryRequest;
typedef struct DmHostMemory { VkDeviceMemory memory; uint64_t offset; void *mapped; uint64_t token; } DmHostMemory;
typedef int32_t (*DmAllocateMemory)(void *user, const struct DmMemoryRequest *request, struct DmHostMemory *memory);
typedef void (*DmFreeMemory)(void *user, const struct DmHostMemory *memory);
typedef struct DmEngineDesc { uint32_t struct_size; uint32_t transform_feedback; VkInstance instance; VkPhysicalDevice physical_device; VkDevice device; PFN_vkGetInstanceProcAddr get_instance_proc_addr; PFN_vkGetDeviceProcAddr get_device_proc_addr; const VkPhysicalDeviceFeatures *enabled_features; VkPipelineCache pipeline_cache; uint32_t clamp_to_android_baseline; uint32_t reserved; uint32_t debug_names; uint32_t buffer_device_address; const uint32_t *queue_families; uint64_t queue_family_count; DmAllocateMemory allocate_memory; DmFreeMemory free_memory; void *memory_user; } DmEngineDesc;
typedef struct DmMemoryUse { uint64_t bytes; uint64_t allocations; } DmMemoryUse;
typedef struct DmEngineInfo { uint32_t struct_size; uint32_t is_software; uint64_t max_storage_range; uint64_t allocated_bytes; char device_name[256]; struct DmMemoryUse meshes; struct DmMemoryUse poses; struct DmMemoryUse animation; struct DmMemoryUse lists; struct DmMemoryUse staging; struct DmMemoryUse readback; } DmEngineInfo;
typedef struct DmGpuMesh { uint64_t bits; } DmGpuMesh;
typedef struct DmCrowdDesc { uint32_t struct_size; uint32_t instances; uint32_t path; uint32_t batch; uint32_t mode; uint32_t slots; uint32_t pose_format; uint32_t frames_in_flight; uint32_t consumers; float tolerance; float weight_max; float error_budget; uint32_t pose_usage; uint32_t reserved; const uint32_t *queue_family; } DmCrowdDesc;
typedef struct DmCrowd { uint64_t bits; } DmCrowd;
typedef struct DmLevelDesc { uint32_t struct_size; uint32_t pin_count; struct DmMesh mesh; const char *const *pins; } DmLevelDesc;
typedef struct DmAnimationDesc { uint32_t struct_size; uint32_t clip_count; const struct DmClip *clips; uint32_t key_bits; uint32_t reserved; const struct DmLevelDesc *level; } DmAnimationDesc;
typedef struct DmPlayback { uint32_t struct_size; uint32_t clip; double start; double speed; uint32_t once; uint32_t reserved; } DmPlayback;
typedef struct DmTicket { uint64_t crowd; uint64_t number; } DmTicket;
typedef struct DmUpdate { uint32_t struct_size; float bound; struct DmTicket ticket; uint64_t coefficients; uint64_t passes; uint64_t rebuilt; uint64_t dirty_blocks; uint64_t rebuilt_blocks; uint64_t bytes_moved; uint64_t bytes_floor; uint32_t timestamps; uint32_t reserved; } DmUpdate;
typedef struct DmPoseView { uint32_t struct_size; uint32_t stride; VkBuffer buffer; uint64_t offset; uint64_t size; uint32_t format; uint32_t slot; float units[6]; float offsets[6]; VkBuffer previous_buffer; uint64_t previous_offset; } DmPoseView;
typedef struct DmStreamView { uint32_t struct_size; uint32_t stride; VkBuffer buffer; uint64_t offset; uint32_t components; uint32_t format; float units[4]; float offsets[4]; uint32_t slot; uint32_t reserved; } DmStreamView;
typedef struct DmReadback { uint64_t bits; } DmReadback;
typedef struct DmSkin { uint64_t bits; } DmSkin;
typedef struct DmOutputStream { uint32_t stream; uint32_t stride; VkBuffer buffer; uint64_t offset; VkBuffer second_buffer; uint64_t second_offset; uint32_t format; uint32_t reserved; } DmOutputStream;
typedef struct DmOutputTarget { uint32_t struct_size; uint32_t stream_count; const struct DmOutputStream *streams; VkBuffer joints; uint64_t joints_bytes; uint64_t joints_offset; uint32_t method; uint32_t pose_order; } DmOutputTarget;
typedef struct DmSurface { uint64_t bits; } DmSurface;
typedef struct DmSkinDesc { uint32_t struct_size; uint32_t influences; const uint16_t *joints; const float *weights; uint32_t joint_count; uint32_t reserved; } DmSkinDesc;
typedef struct DmOutputView { uint32_t struct_size; uint32_t reserved; VkBuffer buffer; uint64_t offset; VkBuffer previous_buffer; uint64_t previous_offset; } DmOutputView;
typedef struct DmWeightBounds { uint64_t bits; } DmWeightBounds;
#define DM_OK 0
#define DM_ERROR_IO 1
#define DM_ERROR_INPUT 2
#define DM_ERROR_INVALID 3
#define DM_ERROR_UNSUPPORTED 4
#define DM_ERROR_OUT_OF_MEMORY 5
#define DM_ERROR_DEVICE_LOST 6
#define DM_ERROR_VULKAN 7
#define DM_ERROR_HANDLE 1000
#define DM_ERROR_PANIC 1001
const char *dm_last_error(void);
uint32_t dm_version(void);
DmResult dm_requirements(uint32_t path, uint32_t *count, struct DmRequirement *items);
DmResult dm_pose_vertex_input(uint32_t format, uint32_t previous, uint32_t *binding_count, VkVertexInputBindingDescription *bindings, uint32_t *attribute_count, VkVertexInputAttributeDescription *attributes);
DmResult dm_mesh_info(struct DmMesh mesh, struct DmMeshInfo *info);
DmResult dm_mesh_target_name(struct DmMesh mesh, uint32_t target, const char **name);
DmResult dm_mesh_find_target(struct DmMesh mesh, const char *name, uint32_t *target);
DmResult dm_mesh_remap_indices(struct DmMesh mesh, uint32_t *indices, size_t count);
DmResult dm_mesh_indices(struct DmMesh mesh, uint32_t *count, uint32_t *indices);
DmResult dm_mesh_render_vertices(struct DmMesh mesh, struct DmRenderVertices *vertices);
DmResult dm_mesh_evaluate(struct DmMesh mesh, const float *weights, uint32_t weight_count, double *pose, size_t count);
DmResult dm_mesh_open(const char *path, const struct DmMeshDesc *desc, struct DmMesh *mesh);
DmResult dm_mesh_from_bytes(const void *bytes, size_t size, const char *name, const struct DmMeshDesc *desc, struct DmMesh *mesh);
DmResult dm_mesh_from_arrays(const struct DmMeshArrays *arrays, const struct DmMeshDesc *desc, struct DmMesh *mesh);
DmResult dm_mesh_write(struct DmMesh mesh, const char *path);
DmResult dm_mesh_destroy(struct DmMesh mesh);
DmResult dm_clip_open(const char *path, float fps, struct DmClip *clip);
DmResult dm_clip_from_arrays(const struct DmClipArrays *arrays, struct DmClip *clip);
DmResult dm_clip_info(struct DmClip clip, struct DmClipInfo *info);
DmResult dm_clip_destroy(struct DmClip clip);
DmResult dm_clip_bind(struct DmClip clip, struct DmMesh mesh, struct DmBoundClip *bound);
DmResult dm_bound_clip_sample(struct DmBoundClip clip, double frame, float *weights, uint32_t count);
DmResult dm_bound_clip_destroy(struct DmBoundClip clip);
DmResult dm_mesh_sample_head(const struct DmSampleDesc *sample, const struct DmMeshDesc *desc, struct DmMesh *mesh);
DmResult dm_clip_sample_head(const struct DmSampleDesc *sample, uint32_t frame_count, float fps, struct DmClip *clip);
DmResult dm_engine_create(const struct DmEngineDesc *desc, struct DmEngine *engine);
DmResult dm_engine_info(struct DmEngine engine, struct DmEngineInfo *info);
DmResult dm_mesh_upload(struct DmEngine engine, VkCommandBuffer cmd, struct DmMesh mesh, struct DmGpuMesh *gpu_mesh);
DmResult dm_gpu_mesh_destroy(struct DmGpuMesh mesh);
DmResult dm_crowd_create(struct DmGpuMesh mesh, const struct DmCrowdDesc *desc, struct DmCrowd *crowd);
DmResult dm_crowd_create_animated(struct DmGpuMesh mesh, VkCommandBuffer cmd, const struct DmCrowdDesc *desc, const struct DmAnimationDesc *animation, struct DmCrowd *crowd);
DmResult dm_crowd_destroy(struct DmCrowd crowd);
DmResult dm_crowd_reset_history(struct DmCrowd crowd, uint32_t instance);
DmResult dm_crowd_set_hidden(struct DmCrowd crowd, uint32_t instance, uint32_t hidden);
DmResult dm_crowd_add(struct DmCrowd crowd, uint32_t *instance);
DmResult dm_crowd_remove(struct DmCrowd crowd, uint32_t instance);
DmResult dm_crowd_play(struct DmCrowd crowd, uint32_t instance, const struct DmPlayback *playback);
DmResult dm_crowd_set_time(struct DmCrowd crowd, double seconds);
DmResult dm_crowd_set_level(struct DmCrowd crowd, uint32_t instance, float level);
DmResult dm_crowd_set_weights(struct DmCrowd crowd, uint32_t instance, const float *weights, uint32_t count);
DmResult dm_crowd_set_weight(struct DmCrowd crowd, uint32_t instance, uint32_t target, float weight);
DmResult dm_record_update(VkCommandBuffer cmd, uint32_t count, const struct DmCrowd *crowds, struct DmUpdate *updates);
DmResult dm_crowd_set_queries(struct DmCrowd crowd, VkQueryPool pool, uint32_t first, uint32_t count);
DmResult dm_crowd_discard(struct DmCrowd crowd, struct DmTicket ticket);
DmResult dm_crowd_pose(struct DmCrowd crowd, uint32_t instance, struct DmPoseView *view);
DmResult dm_crowd_stream(struct DmCrowd crowd, uint32_t instance, uint32_t stream, struct DmStreamView *view);
DmResult dm_readback_create(struct DmEngine engine, struct DmReadback *readback);
DmResult dm_readback_record(struct DmReadback readback, VkCommandBuffer cmd, struct DmCrowd crowd, const uint32_t *instances, uint32_t count);
DmResult dm_readback_pose(struct DmReadback readback, uint32_t at, uint32_t stream, float *values, size_t count);
DmResult dm_readback_destroy(struct DmReadback readback);
DmResult dm_crowd_set_output_target(struct DmCrowd crowd, uint32_t instance, struct DmSkin skin, const struct DmOutputTarget *target);
DmResult dm_surface_upload(struct DmEngine engine, VkCommandBuffer cmd, struct DmMesh mesh, struct DmSurface *surface);
DmResult dm_surface_destroy(struct DmSurface surface);
DmResult dm_crowd_set_normals_target(struct DmCrowd crowd, uint32_t instance, struct DmSurface surface, const struct DmOutputTarget *target);
DmResult dm_skin_upload(struct DmEngine engine, VkCommandBuffer cmd, struct DmMesh mesh, const struct DmSkinDesc *desc, struct DmSkin *skin);
DmResult dm_skin_destroy(struct DmSkin skin);
DmResult dm_crowd_set_joints(struct DmCrowd crowd, uint32_t instance, uint64_t offset);
DmResult dm_crowd_output(struct DmCrowd crowd, uint32_t instance, struct DmOutputView *view);
DmResult dm_weight_bounds_create(struct DmMesh mesh, const struct DmCrowdDesc *desc, struct DmWeightBounds *bounds);
DmResult dm_weight_bounds_of(struct DmWeightBounds bounds, const float *weights, uint32_t count, float bound, float *least_and_greatest);
DmResult dm_weight_bounds_destroy(struct DmWeightBounds bounds);
DmResult dm_release_staging(uint64_t handle);
DmResult dm_engine_destroy(struct DmEngine engine);
