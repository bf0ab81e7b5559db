/*
 * What a host in C does to have a mesh morphed: start here to link deltamorph.
 *
 *     cc -std=c99 -I include examples/c/minimal.c -L target/release -ldeltamorph_c -lvulkan -lm -o minimal
 *     LD_LIBRARY_PATH=target/release ./minimal [MESH [PART OF A DEVICE'S NAME]]
 *
 * MESH is a folder of OBJ files, a packed file, or glTF (feature `gltf`); without it, or for "-", the built-in head.
 * Instance, device, queue and command buffer are the host's; deltamorph records into the command buffer. Every pose is
 * read back and compared with the float64 reference.
 */
#include <deltamorph.h>
#include <vulkan/vulkan.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { POSES = 20, FLOATS = 6 };

static void fail(const char *what, const char *why) { fprintf(stderr, "%s: %s\n", what, why), exit(1); }

#define VK(call) do { if ((call) != VK_SUCCESS) fail(#call, "failed"); } while (0)
#define DM(call) do { if ((call) != DM_OK) fail(#call, dm_last_error()); } while (0)

static void *room_for(size_t count, size_t size) {
    void *room = calloc(count + 1, size);
    if (!room) fail("calloc", "no memory");
    return room;
}

/* The host's own: what every Vulkan program has. */
typedef struct {
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    VkCommandPool pool;
    VkCommandBuffer cmd;
} Host;

static Host host_create(const char *wanted) {
    Host host = {0};
    VkApplicationInfo app = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_1};
    VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &app};
    VK(vkCreateInstance(&info, NULL, &host.instance));
    VkPhysicalDevice devices[16];
    uint32_t count = 16, family = 0;
    VkResult listed = vkEnumeratePhysicalDevices(host.instance, &count, devices);
    if (listed != VK_SUCCESS && listed != VK_INCOMPLETE) fail("vkEnumeratePhysicalDevices", "failed");
    for (uint32_t i = 0; i < count && !host.physical; i++) {
        VkPhysicalDeviceProperties properties;
        vkGetPhysicalDeviceProperties(devices[i], &properties);
        if (properties.apiVersion < VK_API_VERSION_1_1 || !strstr(properties.deviceName, wanted)) continue;
        host.physical = devices[i];
    }
    if (!host.physical) fail(wanted, "no such Vulkan 1.1 device");
    VkQueueFamilyProperties families[16];
    count = 16;
    vkGetPhysicalDeviceQueueFamilyProperties(host.physical, &count, families);
    const VkQueueFlags both = VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT;
    while (family < count && (families[family].queueFlags & both) != both) family++;
    if (family == count) fail(wanted, "no queue with graphics and compute");
    /* No extension, no feature: dm_requirements says so for DM_PATH_BLOCKS. */
    VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, .queueFamilyIndex = family,
                                     .queueCount = 1, .pQueuePriorities = &(float){1.0f}};
    VkDeviceCreateInfo device = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, .queueCreateInfoCount = 1,
                                 .pQueueCreateInfos = &queue};
    VK(vkCreateDevice(host.physical, &device, NULL, &host.device));
    vkGetDeviceQueue(host.device, family, 0, &host.queue);
    VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, .queueFamilyIndex = family,
                                    .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT};
    VK(vkCreateCommandPool(host.device, &pool, NULL, &host.pool));
    VkCommandBufferAllocateInfo cmd = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                       .commandPool = host.pool, .commandBufferCount = 1};
    VK(vkAllocateCommandBuffers(host.device, &cmd, &host.cmd));
    return host;
}

static void host_begin(const Host *host) {
    VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                      .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT};
    VK(vkBeginCommandBuffer(host->cmd, &begin));
}

/* Waits after each submission; an engine has several frames in flight (DmCrowdDesc::frames_in_flight). */
static void host_submit_and_wait(const Host *host) {
    const VkStructureType type = VK_STRUCTURE_TYPE_SUBMIT_INFO;
    VkSubmitInfo submit = {.sType = type, .commandBufferCount = 1, .pCommandBuffers = &host->cmd};
    VK(vkEndCommandBuffer(host->cmd));
    VK(vkQueueSubmit(host->queue, 1, &submit, VK_NULL_HANDLE));
    VK(vkQueueWaitIdle(host->queue));
}

/* Host-visible memory that poses are copied to. */
typedef struct {
    VkBuffer buffer;
    VkDeviceMemory memory;
    float *mapped;
} Readback;

static Readback readback_create(const Host *host, uint64_t bytes, VkBufferUsageFlags usage) {
    Readback readback = {0};
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .size = bytes,
                               .usage = usage};
    VK(vkCreateBuffer(host->device, &info, NULL, &readback.buffer));
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(host->device, readback.buffer, &needs);
    VkPhysicalDeviceMemoryProperties types;
    vkGetPhysicalDeviceMemoryProperties(host->physical, &types);
    const VkMemoryPropertyFlags visible = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    uint32_t type = 0;
    while (!(needs.memoryTypeBits >> type & 1) || (types.memoryTypes[type].propertyFlags & visible) != visible) type++;
    VkMemoryAllocateInfo allocate = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = needs.size,
                                     .memoryTypeIndex = type};
    VK(vkAllocateMemory(host->device, &allocate, NULL, &readback.memory));
    VK(vkBindBufferMemory(host->device, readback.buffer, readback.memory, 0));
    VK(vkMapMemory(host->device, readback.memory, 0, VK_WHOLE_SIZE, 0, (void **)&readback.mapped));
    return readback;
}

static void record_readback(const Host *host, const Readback *readback, const DmPoseView *pose) {
    VkBufferCopy region = {.srcOffset = pose->offset, .size = pose->size};
    vkCmdCopyBuffer(host->cmd, pose->buffer, readback->buffer, 1, &region);
    VkMemoryBarrier read = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER, .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                            .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    const VkPipelineStageFlags from = VK_PIPELINE_STAGE_TRANSFER_BIT, to = VK_PIPELINE_STAGE_HOST_BIT;
    vkCmdPipelineBarrier(host->cmd, from, to, 0, 1, &read, 0, NULL, 0, NULL);
}

/* Morphs a mesh, and returns how far positions are from the reference at most, as a fraction of the diagonal. */
static double morph(const Host *host, DmEngine engine, DmMesh mesh, const DmMeshInfo *info) {
    DmGpuMesh uploaded;
    host_begin(host);
    DM(dm_mesh_upload(engine, host->cmd, mesh, &uploaded));
    host_submit_and_wait(host);
    DM(dm_release_staging(uploaded.bits));
    DmCrowdDesc desc = {.struct_size = sizeof desc, .consumers = DM_READ_BY_VERTEX_ATTRIBUTES | DM_READ_BY_COPIES};
    DmCrowd crowd;
    DM(dm_crowd_create(uploaded, &desc, &crowd));

    Readback readback = readback_create(host, info->pose_bytes, VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    float *weights = room_for(info->target_count, sizeof *weights);
    double *reference = room_for((size_t)info->vertex_count * FLOATS, sizeof *reference), worst = 0;
    uint32_t *packed = room_for(info->vertex_count, sizeof *packed);
    for (uint32_t v = 0; v < info->vertex_count; v++) packed[v] = v;
    DM(dm_mesh_remap_indices(mesh, packed, info->vertex_count)); /* packing reorders vertices */
    for (uint32_t i = 0; i < POSES; i++) {
        for (uint32_t t = i % 3; t < info->target_count; t += 3) weights[t] = (float)((7 * t + 3 * i) % 11) / 10;
        DmUpdate update = {.struct_size = sizeof update};
        DmPoseView pose = {.struct_size = sizeof pose};
        DM(dm_crowd_set_weights(crowd, 0, weights, info->target_count));
        host_begin(host);
        DM(dm_record_update(host->cmd, 1, &crowd, &update)); /* never submitted? dm_crowd_discard(crowd, update.ticket) */
        DM(dm_crowd_pose(crowd, 0, &pose)); /* draws from pose.buffer go here */
        record_readback(host, &readback, &pose);
        host_submit_and_wait(host);
        DM(dm_mesh_evaluate(mesh, weights, info->target_count, reference, (size_t)info->vertex_count * FLOATS));
        for (uint32_t v = 0; v < info->vertex_count; v++) {
            double sum = 0;
            const float *got = &readback.mapped[packed[v] * FLOATS];
            for (int c = 0; c < 3; c++) sum += pow(got[c] - reference[v * FLOATS + c], 2);
            worst = fmax(worst, isfinite(sum) ? sqrt(sum) : INFINITY);
        }
    }
    free(weights), free(reference), free(packed);
    vkDestroyBuffer(host->device, readback.buffer, NULL), vkFreeMemory(host->device, readback.memory, NULL);
    DM(dm_crowd_destroy(crowd));
    DM(dm_gpu_mesh_destroy(uploaded));
    return worst / info->diagonal;
}

int main(int argc, char **argv) {
    const Host host = host_create(argc > 2 ? argv[2] : "");
    DmEngineDesc desc = {.struct_size = sizeof desc, .instance = host.instance, .physical_device = host.physical,
                         .device = host.device, .get_instance_proc_addr = vkGetInstanceProcAddr};
    DmEngine engine;
    DM(dm_engine_create(&desc, &engine));
    DmEngineInfo on = {.struct_size = sizeof on};
    DM(dm_engine_info(engine, &on));
    DmMesh mesh;
    DmSampleDesc sample = {.struct_size = sizeof sample, .vertices = 5000, .targets = 52};
    if (argc > 1 && strcmp(argv[1], "-") != 0) DM(dm_mesh_open(argv[1], NULL, &mesh));
    else DM(dm_mesh_sample_head(&sample, NULL, &mesh));
    DmMeshInfo info = {.struct_size = sizeof info};
    DM(dm_mesh_info(mesh, &info));
    const double error = morph(&host, engine, mesh, &info);
    printf("%s: %d poses of %u vertices and %u targets, within %.1e of the diagonal\n", on.device_name, (int)POSES,
           info.vertex_count, info.target_count, error);
    DM(dm_mesh_destroy(mesh));
    DM(dm_engine_destroy(engine));
    vkDestroyCommandPool(host.device, host.pool, NULL);
    vkDestroyDevice(host.device, NULL);
    vkDestroyInstance(host.instance, NULL);
    if (!(error <= 1e-5)) fail("poses", "differ from the reference");
    return 0;
}
