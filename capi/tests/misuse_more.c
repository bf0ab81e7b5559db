/*
 * Invalid use of queue families, and bounds from weights; messages on a mesh.
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
    HOLDS(severity == DM_MESSAGE_NOTE && strstr(text, "no .obj file in a folder 'targets'"));
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

/* An engine of its own, with memory of the host's, and statistics of it. */
static void handed_over(const Host *host, const DmEngineDesc *device, DmMesh mesh) {
    DmEngine engine;
    DmGpuMesh uploaded;
    DmCrowd crowd;
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
    WORKS(dm_release_staging(uploaded.bits));
    WORKS(dm_crowd_create(uploaded, NULL, &crowd));
    host_begin(host);
    WORKS(dm_record_update(host->cmd, 1, &crowd, NULL));
    host_submit_and_wait(host);

    DmEngineInfo memory = {.struct_size = sizeof memory};
    WORKS(dm_engine_info(engine, &memory));
    HOLDS(memory.meshes.allocations + memory.poses.allocations + memory.lists.allocations == memories.live);
    HOLDS(memory.meshes.bytes > 0 && memory.staging.bytes == 0 && memory.allocated_bytes >= memory.poses.bytes);
    WORKS(dm_crowd_destroy(crowd));
    WORKS(dm_gpu_mesh_destroy(uploaded));
    HOLDS(memories.live == 0);
    WORKS(dm_engine_destroy(engine));
}

/* As `steps`. */
static void more(const Host *host, DmMesh mesh, DmGpuMesh uploaded, DmCrowd crowd, DmCrowd animated) {
    const DmEngineDesc device = {.struct_size = sizeof device, .instance = host->instance,
                                 .physical_device = host->physical, .device = host->device,
                                 .get_instance_proc_addr = vkGetInstanceProcAddr};
    families(&device, uploaded);
    handed_over(host, &device, mesh);
    weight_bounds(mesh);
    levels(crowd, animated);
}
