/*
 * Invalid use of queue families, layers of clips, and bounds from weights; messages on a mesh.
 * Included by misuse.c, which says what it expects.
 */

static void families(const DmEngineDesc *good, DmGpuMesh mesh) {
    const uint32_t none = 77;
    DmEngineDesc bad = *good;
    DmEngine engine = {0};
    DmCrowdDesc desc = {.struct_size = sizeof desc, .queue_family = &none};
    DmCrowd crowd = {0};
    bad.queue_family_count = 1;
    INVALID("'queue_families' is a null pointer", dm_engine_create(&bad, &engine));
    bad.queue_families = &none;
    INVALID("queue family 77 of ", dm_engine_create(&bad, &engine));
    INVALID("queue family 77 of ", dm_crowd_create(mesh, &desc, &crowd));
    HOLDS(engine.bits == 0 && crowd.bits == 0);
}

static void layers(DmMesh mesh, DmCrowd crowd) {
    const char *name = NULL;
    const float values[2] = {0.5f, 1}, mask[3] = {1, 1, NAN};
    float weights[3] = {0};
    DmClip clip = {0};
    DmBoundClip bound = {0};
    WORKS(dm_mesh_target_name(mesh, 1, &name));
    const DmClipArrays arrays = {.struct_size = sizeof arrays, .frame_count = 2, .column_count = 1, .fps = 10,
                                 .names = &name, .values = values};
    WORKS(dm_clip_from_arrays(&arrays, &clip));
    INVALID("'names' is a null pointer", dm_clip_bind_names(clip, NULL, 1, &bound));
    INVALID("'bound' is a null pointer", dm_clip_bind_names(clip, &name, 1, NULL));
    INVALID("names no target", dm_clip_bind_names(clip, (const char *[]){"none"}, 1, &bound));
    HANDLE("null handle in place of a clip", dm_clip_bind_names((DmClip){0}, &name, 1, &bound));
    WORKS(dm_clip_bind(clip, mesh, &bound));
    DmClipLayer layer = {.struct_size = sizeof layer, .clip = bound, .weight = 1}, bad = layer;
    INVALID("a null pointer to DmClipLayer", dm_clips_mix(NULL, 1, weights, 3));
    INVALID("'weights' is a null pointer", dm_clips_mix(&layer, 1, NULL, 3));
    INVALID("bound to 3 targets, and 2 weights are mixed", dm_clips_mix(&layer, 1, weights, 2));
    bad.clip = (DmBoundClip){crowd.bits};
    HANDLE("the handle of a crowd in place of a bound clip", dm_clips_mix(&bad, 1, weights, 3));
    bad = layer, bad.time = NAN;
    INVALID("layer 0", dm_clips_mix(&bad, 1, weights, 3));
    bad = layer, bad.blend = 3;
    INVALID("blend of a layer (DM_LAYER_)", dm_clips_mix(&bad, 1, weights, 3));
    bad = layer, bad.mask = mask;
    INVALID("the mask of target 2", dm_clips_mix(&bad, 1, weights, 3));
    bad.mask = weights;
    INVALID("the mask of layer 1 overlaps 'weights'", dm_clips_mix((const DmClipLayer[]){layer, bad}, 2, weights, 3));
    bad = layer, bad.struct_size = 8;
    INVALID("DmClipLayer with a struct_size of 8", dm_clips_mix((const DmClipLayer[]){layer, bad}, 2, weights, 3));
    HOLDS(weights[1] == 0);
    WORKS(dm_clips_mix(&layer, 1, weights, 3));
    HOLDS(weights[1] == 0.5f);
    WORKS(dm_bound_clip_destroy(bound));
    WORKS(dm_clip_destroy(clip));
}

static void weight_bounds(DmMesh mesh) {
    const float weights[3] = {0, NAN, 0}, zeros[3] = {0};
    float box[6] = {7};
    DmCrowdDesc desc = {.struct_size = sizeof desc, .path = 99};
    DmWeightBounds bounds = {0};
    INVALID("update path (DM_PATH_)", dm_weight_bounds_create(mesh, &desc, &bounds));
    INVALID("'bounds' is a null pointer", dm_weight_bounds_create(mesh, NULL, NULL));
    HANDLE("null handle in place of a mesh", dm_weight_bounds_create(no_mesh, NULL, &bounds));
    HANDLE("null handle in place of bounds from weights", dm_weight_bounds_of(bounds, zeros, 3, 0, box));
    HANDLE("null handle in place of bounds from weights", dm_weight_bounds_destroy(bounds));
    WORKS(dm_weight_bounds_create(mesh, NULL, &bounds));
    INVALID("2 weights for 3 targets", dm_weight_bounds_of(bounds, zeros, 2, 0, box));
    INVALID("not finite", dm_weight_bounds_of(bounds, weights, 3, 0, box));
    INVALID("not finite", dm_weight_bounds_of(bounds, zeros, 3, INFINITY, box));
    INVALID("'weights' is a null pointer", dm_weight_bounds_of(bounds, NULL, 3, 0, box));
    INVALID("'least_and_greatest' is a null pointer", dm_weight_bounds_of(bounds, zeros, 3, 0, NULL));
    HOLDS(box[0] == 7);
    WORKS(dm_weight_bounds_of(bounds, zeros, 3, 0, box));
    HOLDS(box[0] < box[3]);
    WORKS(dm_weight_bounds_destroy(bounds));
    HANDLE("was destroyed", dm_weight_bounds_destroy(bounds));
}

/* A host that is told something calls the library, and gets errors of its own. */
static void told(void *user, uint32_t severity, const char *text) {
    HOLDS(severity == DM_MESSAGE_NOTE && strstr(text, "the folder 'targets' has no .obj file"));
    HANDLE("null handle in place of a mesh", dm_mesh_destroy(no_mesh));
    ++*(int *)user;
}

static void messages(void) {
    char folder[1100], targets[1200], neutral[1200];
    snprintf(folder, sizeof folder, "%s.face", program);
    snprintf(targets, sizeof targets, "%s/targets", folder);
    snprintf(neutral, sizeof neutral, "%s/neutral.obj", folder);
    HOLDS(mkdir(folder, 0777) == 0 && mkdir(targets, 0777) == 0);
    FILE *file = fopen(neutral, "w");
    HOLDS(file && fputs("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", file) >= 0 && fclose(file) == 0);
    int count = 0;
    DmMeshDesc desc = {.struct_size = sizeof desc, .message = told, .message_user = &count};
    DmMesh mesh = {0};
    WORKS(dm_mesh_open(folder, &desc, &mesh));
    HOLDS(count == 1);
    WORKS(dm_mesh_destroy(mesh));
    desc.struct_size = offsetof(DmMeshDesc, message); /* of a program that was built before there were messages */
    WORKS(dm_mesh_open(folder, &desc, &mesh));
    HOLDS(count == 1);
    WORKS(dm_mesh_destroy(mesh));
}

static void levels(DmCrowd crowd, DmCrowd animated) {
    INVALID("plays no clips", dm_crowd_set_level(crowd, 0, 1));
    INVALID("a level of -1 targets", dm_crowd_set_level(animated, 0, -1));
    WORKS(dm_crowd_set_level(animated, 0, 2));
}

/* As a host does that has an allocator: memory of its own for each buffer. */
typedef struct { const Host *host; uint32_t live, most; } Memories;

static int32_t allocate_memory(void *user, const DmMemoryRequest *request, DmHostMemory *memory) {
    Memories *memories = user;
    const VkDevice device = memories->host->device;
    VkPhysicalDeviceMemoryProperties types;
    VkMemoryAllocateInfo info = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = request->size};
    if (memories->live == memories->most) return VK_ERROR_OUT_OF_DEVICE_MEMORY;
    vkGetPhysicalDeviceMemoryProperties(memories->host->physical, &types);
    while (!(request->type_bits >> info.memoryTypeIndex & 1) ||
           request->required & ~types.memoryTypes[info.memoryTypeIndex].propertyFlags) info.memoryTypeIndex++;
    VK(vkAllocateMemory(device, &info, NULL, &memory->memory));
    if (request->required) VK(vkMapMemory(device, memory->memory, 0, VK_WHOLE_SIZE, 0, &memory->mapped));
    memory->token = ++memories->live;
    return VK_SUCCESS;
}

static void free_memory(void *user, const DmHostMemory *memory) {
    Memories *memories = user;
    HOLDS(memory->token > 0);
    memories->live--;
    vkFreeMemory(memories->host->device, memory->memory, NULL);
}

/* An engine of its own, with memory of the host's: timestamps, names of steps, statistics of memory. */
static void handed_over(const Host *host, const DmEngineDesc *device, DmMesh mesh) {
    const VkQueryPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                        .queryType = VK_QUERY_TYPE_TIMESTAMP, .queryCount = 2};
    const VkQueryResultFlags wide = VK_QUERY_RESULT_64_BIT;
    VkQueryPool pool;
    DmEngine engine;
    DmGpuMesh uploaded;
    DmCrowd crowd;
    DmUpdate update = {.struct_size = sizeof update};
    uint32_t count = 0;
    uint64_t at[2];
    DmStepName step;
    VK(vkCreateQueryPool(host->device, &info, NULL, &pool));
    Memories memories = {host, 0, 1};
    DmEngineDesc own = *device;
    own.allocate_memory = allocate_memory, own.memory_user = &memories;
    INVALID("'allocate_memory' without 'free_memory'", dm_engine_create(&own, &engine));
    own.free_memory = free_memory;
    WORKS(dm_engine_create(&own, &engine));
    host_begin(host);
    REFUSED(DM_ERROR_OUT_OF_MEMORY, "vkAllocateMemory", dm_mesh_upload(engine, host->cmd, mesh, &uploaded));
    memories.most = 100;
    WORKS(dm_mesh_upload(engine, host->cmd, mesh, &uploaded));
    host_submit_and_wait(host);
    WORKS(dm_gpu_mesh_release_staging(uploaded));
    WORKS(dm_crowd_create(uploaded, NULL, &crowd));
    host_begin(host);
    vkCmdResetQueryPool(host->cmd, pool, 0, 2);
    WORKS(dm_crowd_set_queries(crowd, pool, 0, 1));
    INVALID("1 queries for the 2 timestamps", dm_record_update(host->cmd, crowd, &update));
    HOLDS(update.timestamps == 0);
    WORKS(dm_crowd_set_queries(crowd, pool, 0, 2));
    WORKS(dm_record_update(host->cmd, crowd, &update));
    host_submit_and_wait(host);
    VK(vkGetQueryPoolResults(host->device, pool, 0, 2, sizeof at, at, sizeof *at, wide));
    HOLDS(update.timestamps == 2 && at[0] > 0 && at[0] <= at[1]);
    INVALID("'count' is a null pointer", dm_crowd_step_names(crowd, NULL, NULL));
    WORKS(dm_crowd_step_names(crowd, &count, NULL));
    HOLDS(count == 1);
    WORKS(dm_crowd_step_names(crowd, &count, &step));
    HOLDS(strcmp(step.name, "blocks") == 0);

    DmMemory memory = {.struct_size = sizeof memory};
    char json[600] = "", poses[80];
    WORKS(dm_engine_memory(engine, &memory));
    HOLDS(memory.meshes.allocations + memory.poses.allocations + memory.lists.allocations == memories.live);
    HOLDS(memory.meshes.bytes > 0 && memory.staging.bytes == 0 && memory.allocated >= memory.poses.bytes);
    WORKS(dm_engine_memory_json(engine, &count, NULL));
    HOLDS(count > 100 && count < sizeof json);
    count--;
    INVALID("'text' has room for", dm_engine_memory_json(engine, &count, json));
    count = sizeof json;
    WORKS(dm_engine_memory_json(engine, &count, json));
    snprintf(poses, sizeof poses, "\"poses\": {\"bytes\": %llu, \"allocations\": 1}",
             (unsigned long long)memory.poses.bytes);
    HOLDS(count == strlen(json) + 1 && strstr(json, poses));
    WORKS(dm_crowd_destroy(crowd));
    WORKS(dm_gpu_mesh_destroy(uploaded));
    HOLDS(memories.live == 0);
    WORKS(dm_engine_destroy(engine));
    vkDestroyQueryPool(host->device, pool, NULL);
}

/* As `steps`. */
static void more(const Host *host, DmMesh mesh, DmGpuMesh uploaded, DmCrowd crowd, DmCrowd animated) {
    const DmEngineDesc device = {.struct_size = sizeof device, .instance = host->instance,
                                 .physical_device = host->physical, .device = host->device,
                                 .get_instance_proc_addr = vkGetInstanceProcAddr};
    families(&device, uploaded);
    handed_over(host, &device, mesh);
    layers(mesh, crowd);
    weight_bounds(mesh);
    levels(crowd, animated);
}
