/*
 * Invalid use of what updates do beside the pose: weights one by one, outputs, read-backs, post-morph passes; and
 * handles that are null. Included by misuse.c, which says what it expects.
 */

static void null_handles(void) {
    DmPoseView pose = {.struct_size = sizeof pose};
    DmEngineInfo info = {.struct_size = sizeof info};
    DmRenderVertices vertices = {.struct_size = sizeof vertices};
    HANDLE("null handle in place of a mesh", dm_mesh_render_vertices(no_mesh, &vertices));
    HANDLE("null handle in place of an engine", dm_engine_info((DmEngine){0}, &info));
    HANDLE("null handle in place of a mesh on the device", dm_release_staging(0));
    HANDLE("null handle in place of a mesh on the device", dm_gpu_mesh_destroy((DmGpuMesh){0}));
    HANDLE("null handle in place of a crowd", dm_crowd_pose(no_crowd, 0, &pose));
    HANDLE("null handle in place of a crowd", dm_crowd_destroy(no_crowd));
    HANDLE("null handle in place of a skin", dm_skin_destroy((DmSkin){0}));
    HANDLE("null handle in place of a clip", dm_clip_destroy((DmClip){0}));
    HANDLE("null handle in place of a bound clip", dm_bound_clip_destroy((DmBoundClip){0}));
    INVALID("'clip' is a null pointer", dm_clip_sample_head(NULL, 3, 30, NULL));
}

static VkBuffer storage_create(const Host *host, uint64_t bytes, VkDeviceMemory *memory) {
    const Readback made = readback_create(host, bytes, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
    *memory = made.memory;
    return made.buffer;
}

static void single_weights(DmCrowd crowd, DmCrowd animated) {
    INVALID("target 3", dm_crowd_set_weight(crowd, 0, 3, 1));
    INVALID("instance 9", dm_crowd_set_weight(crowd, 9, 0, 1));
    INVALID("NaN", dm_crowd_set_weight(crowd, 0, 0, NAN));
    INVALID("the crowd plays clips", dm_crowd_set_weight(animated, 0, 0, 1));
    HANDLE("null handle in place of a crowd", dm_crowd_set_weight(no_crowd, 0, 0, 1));
    WORKS(dm_crowd_set_weight(crowd, 0, 0, 0.25f));
}

static void descriptions(DmGpuMesh mesh) {
    DmCrowdDesc desc = {.struct_size = sizeof desc, .pose_usage = 1u << 30};
    DmCrowd crowd = {0};
    INVALID("pose buffers for", dm_crowd_create(mesh, &desc, &crowd));
    desc.pose_usage = 0, desc.reserved = 4;
    INVALID("DmCrowdDesc: 'reserved' is 4", dm_crowd_create(mesh, &desc, &crowd));
    HOLDS(crowd.bits == 0);
}

static void output_streams(DmCrowd crowd, VkBuffer buffer) {
    const DmOutputStream positions = {.stream = DM_STREAM_POSITION, .buffer = buffer};
    DmOutputStream stream = positions;
    DmOutputTarget target = {.struct_size = sizeof target, .streams = &stream, .stream_count = 1};
    const DmSkin none = {0};
    WORKS(dm_crowd_set_output_target(crowd, 0, none, &target));
    WORKS(dm_crowd_set_output_target(crowd, 0, none, NULL));
    target.stream_count = 0;
    INVALID("without streams", dm_crowd_set_output_target(crowd, 0, none, &target));
    target.stream_count = 1, target.streams = NULL;
    INVALID("'streams' is a null pointer", dm_crowd_set_output_target(crowd, 0, none, &target));
    target.streams = &stream, stream.buffer = VK_NULL_HANDLE;
    INVALID("'buffer' is null", dm_crowd_set_output_target(crowd, 0, none, &target));
    stream = positions, stream.stride = 8;
    INVALID("multiples of 4", dm_crowd_set_output_target(crowd, 0, none, &target));
    stream = positions, stream.offset = 2;
    INVALID("multiples of 4", dm_crowd_set_output_target(crowd, 0, none, &target));
    stream = positions, stream.stream = 77;
    INVALID("77 is no stream", dm_crowd_set_output_target(crowd, 0, none, &target));
    stream = positions, stream.stream = DM_STREAM_TANGENT;
    INVALID("stream 'tangent'", dm_crowd_set_output_target(crowd, 0, none, &target));
    stream = positions, stream.format = VK_FORMAT_R8G8B8A8_SNORM;
    INVALID("use a float32 format", dm_crowd_set_output_target(crowd, 0, none, &target));
    stream = positions, stream.reserved = 1;
    INVALID("DmOutputStream: 'reserved' is 1", dm_crowd_set_output_target(crowd, 0, none, &target));
}

static void queries(const Host *host, DmCrowd crowd) {
    const VkQueryPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                        .queryType = VK_QUERY_TYPE_TIMESTAMP, .queryCount = 1};
    VkQueryPool pool;
    HOLDS(vkCreateQueryPool(host->device, &info, NULL, &pool) == VK_SUCCESS);
    INVALID("'pool' is null", dm_crowd_set_queries(crowd, VK_NULL_HANDLE, 0, 1));
    HANDLE("null handle in place of a crowd", dm_crowd_set_queries(no_crowd, pool, 0, 1));
    WORKS(dm_crowd_set_queries(crowd, pool, 0, 1));
    WORKS(dm_crowd_set_weight(crowd, 0, 0, 0.5f));
    host_begin(host);
    INVALID("queries", dm_record_update(host->cmd, 1, &crowd, NULL));
    WORKS(dm_record_update(host->cmd, 1, &crowd, NULL));
    host_submit_and_wait(host);
    vkDestroyQueryPool(host->device, pool, NULL);
}

/* The crowd has a pose. */
static void readbacks(const Host *host, DmEngine engine, DmCrowd crowd, DmCrowd elsewhere) {
    DmReadback readback = {0};
    const uint32_t instances[2] = {0, 5};
    float *vertices = room_for(1200, sizeof *vertices);
    INVALID("'readback' is a null pointer", dm_readback_create(engine, NULL));
    HANDLE("null handle in place of an engine", dm_readback_create((DmEngine){0}, &readback));
    HANDLE("null handle in place of a read-back", dm_readback_pose(readback, 0, 0, vertices, 1200));
    WORKS(dm_readback_create(engine, &readback));
    INVALID("pose 0 of 0", dm_readback_pose(readback, 0, 0, vertices, 1200));
    INVALID("'cmd' is null", dm_readback_record(readback, NULL, crowd, instances, 1));
    host_begin(host);
    INVALID("instance 5", dm_readback_record(readback, host->cmd, crowd, instances, 2));
    INVALID("'instances' is a null pointer", dm_readback_record(readback, host->cmd, crowd, NULL, 2));
    INVALID("another DmEngine", dm_readback_record(readback, host->cmd, elsewhere, instances, 1));
    HANDLE("null handle in place of a crowd", dm_readback_record(readback, host->cmd, no_crowd, instances, 1));
    WORKS(dm_readback_record(readback, host->cmd, crowd, instances, 1));
    host_submit_and_wait(host);
    INVALID("pose 1 of 1", dm_readback_pose(readback, 1, 0, vertices, 1200));
    INVALID("room for 1199 elements, and 1200", dm_readback_pose(readback, 0, 0, vertices, 1199));
    INVALID("'values' is a null pointer", dm_readback_pose(readback, 0, 0, NULL, 1200));
    INVALID("a stream that was not read back", dm_readback_pose(readback, 0, DM_STREAM_COLOR, vertices, 1200));
    INVALID("77 is no stream", dm_readback_pose(readback, 0, 77, vertices, 1200));
    WORKS(dm_readback_pose(readback, 0, 0, vertices, 1200));
    HOLDS(isfinite(vertices[0]) && isfinite(vertices[1199]));
    WORKS(dm_readback_destroy(readback));
    HANDLE("was destroyed", dm_readback_destroy(readback));
    free(vertices);
}

static void skins(const Host *host, DmEngine engine, DmEngine other, DmMesh mesh, DmMesh another, DmCrowd crowd,
                  VkBuffer buffer) {
    uint16_t *joints = room_for(800, sizeof *joints);
    float *weights = room_for(800, sizeof *weights);
    for (int i = 0; i < 800; i++) joints[i] = (uint16_t)(i % 2), weights[i] = 0.25f;
    DmSkinDesc desc = {.struct_size = sizeof desc, .joints = joints, .weights = weights, .joint_count = 2}, bad = desc;
    DmSkin skin = {0}, foreign = {0}, different = {0};
    INVALID("'cmd' is null", dm_skin_upload(engine, NULL, mesh, &desc, &skin));
    host_begin(host);
    INVALID("'skin' is a null pointer", dm_skin_upload(engine, host->cmd, mesh, &desc, NULL));
    INVALID("a null pointer to DmSkinDesc", dm_skin_upload(engine, host->cmd, mesh, NULL, &skin));
    HANDLE("null handle in place of a mesh", dm_skin_upload(engine, host->cmd, no_mesh, &desc, &skin));
    bad.influences = 5;
    INVALID("'joints' is", dm_skin_upload(engine, host->cmd, mesh, (bad.joints = NULL, &bad), &skin));
    bad = desc, bad.influences = 2;
    INVALID("use 4 or 8 influences", dm_skin_upload(engine, host->cmd, mesh, &bad, &skin));
    bad = desc, bad.joint_count = 0;
    INVALID("1 to 65536 joints", dm_skin_upload(engine, host->cmd, mesh, &bad, &skin));
    bad = desc, bad.joint_count = 1;
    INVALID("names joint", dm_skin_upload(engine, host->cmd, mesh, &bad, &skin));
    bad = desc, bad.reserved = 2;
    INVALID("DmSkinDesc: 'reserved' is 2", dm_skin_upload(engine, host->cmd, mesh, &bad, &skin));
    weights[5] = -1;
    INVALID("weight -1", dm_skin_upload(engine, host->cmd, mesh, &desc, &skin));
    weights[5] = 0.25f;
    HOLDS(skin.bits == 0);
    WORKS(dm_skin_upload(engine, host->cmd, mesh, &desc, &skin));
    WORKS(dm_skin_upload(other, host->cmd, mesh, &desc, &foreign));
    WORKS(dm_skin_upload(engine, host->cmd, another, &desc, &different));
    host_submit_and_wait(host);
    WORKS(dm_release_staging(skin.bits));
    DmOutputStream positions = {.stream = DM_STREAM_POSITION, .buffer = buffer};
    DmOutputTarget target = {.struct_size = sizeof target, .streams = &positions, .stream_count = 1, .joints = buffer,
                             .joints_bytes = 96}, wrong = target;
    DmOutputView view = {.struct_size = sizeof view};
    INVALID("not skinned", dm_crowd_set_joints(crowd, 0, 0));
    INVALID("has no output", dm_crowd_output(crowd, 0, &view));
    INVALID("a null pointer to DmOutputView", dm_crowd_output(crowd, 0, NULL));
    INVALID("'skin' is the null handle", dm_crowd_set_output_target(crowd, 0, (DmSkin){0}, &target));
    INVALID("upload it with the crowd's engine", dm_crowd_set_output_target(crowd, 0, foreign, &target));
    INVALID("a skin of mesh", dm_crowd_set_output_target(crowd, 0, different, &target));
    INVALID("instance 7", dm_crowd_set_output_target(crowd, 7, skin, &target));
    wrong.joints = VK_NULL_HANDLE;
    INVALID("'joints' is null", dm_crowd_set_output_target(crowd, 0, skin, &wrong));
    wrong = target, wrong.joints_bytes = 95;
    INVALID("room for all joints", dm_crowd_set_output_target(crowd, 0, skin, &wrong));
    wrong = target, wrong.method = 3;
    INVALID("method of skinning (DM_SKIN_)", dm_crowd_set_output_target(crowd, 0, skin, &wrong));
    WORKS(dm_crowd_set_output_target(crowd, 0, skin, &target));
    INVALID("room for all joints", dm_crowd_set_joints(crowd, 0, 16));
    INVALID("multiple of 16", dm_crowd_set_joints(crowd, 0, 8));
    WORKS(dm_crowd_set_output_target(crowd, 0, (DmSkin){0}, NULL));
    INVALID("not skinned", dm_crowd_set_joints(crowd, 0, 0));
    WORKS(dm_skin_destroy(skin));
    WORKS(dm_skin_destroy(foreign));
    WORKS(dm_skin_destroy(different));
    HANDLE("was destroyed", dm_crowd_set_output_target(crowd, 0, skin, &target));
    free(joints), free(weights);
}

static void surfaces_and_outputs(const Host *host, DmEngine engine, DmEngine other, DmMesh mesh, DmCrowd crowd,
                                  VkBuffer buffer) {
    DmSurface surface = {0}, foreign = {0};
    DmOutputStream stream = {.stream = DM_STREAM_NORMAL, .buffer = buffer};
    DmOutputTarget normals = {.struct_size = sizeof normals, .streams = &stream, .stream_count = 1}, output = normals;
    INVALID("'cmd' is null", dm_surface_upload(engine, NULL, mesh, &surface));
    host_begin(host);
    INVALID("'surface' is a null pointer", dm_surface_upload(engine, host->cmd, mesh, NULL));
    HANDLE("null handle in place of a mesh", dm_surface_upload(engine, host->cmd, no_mesh, &surface));
    WORKS(dm_surface_upload(engine, host->cmd, mesh, &surface));
    WORKS(dm_surface_upload(other, host->cmd, mesh, &foreign));
    host_submit_and_wait(host);
    WORKS(dm_release_staging(surface.bits));
    HANDLE("null handle in place of a surface", dm_crowd_set_normals_target(crowd, 0, (DmSurface){0}, &normals));
    INVALID("upload it with the crowd's engine", dm_crowd_set_normals_target(crowd, 0, foreign, &normals));
    INVALID("instance 7", dm_crowd_set_normals_target(crowd, 7, surface, &normals));
    stream.stream = DM_STREAM_POSITION;
    INVALID("DM_STREAM_NORMAL", dm_crowd_set_normals_target(crowd, 0, surface, &normals));
    stream.stream = DM_STREAM_NORMAL, stream.buffer = VK_NULL_HANDLE;
    INVALID("'buffer' is null", dm_crowd_set_normals_target(crowd, 0, surface, &normals));
    stream.buffer = buffer;
    normals.struct_size = 0;
    INVALID("struct_size of 0", dm_crowd_set_normals_target(crowd, 0, surface, &normals));
    WORKS(dm_crowd_set_normals_target(crowd, 0, (DmSurface){0}, NULL));
    INVALID("instance 7", dm_crowd_set_output_target(crowd, 7, (DmSkin){0}, &output));
    HANDLE("null handle in place of a crowd", dm_crowd_set_output_target(no_crowd, 0, (DmSkin){0}, &output));
    INVALID("1 DmGpuMesh, 3 DmCrowd, 1 DmSurface; destroy these first", dm_engine_destroy(engine));
    WORKS(dm_surface_destroy(surface));
    WORKS(dm_surface_destroy(foreign));
    HANDLE("was destroyed", dm_surface_destroy(surface));
}

/* The crowd and the animated one are of `mesh`, 200 vertices and 3 targets, as `uploaded`; `elsewhere` of another engine. */
static void steps(const Host *host, DmEngine engine, DmEngine other, DmMesh mesh, DmMesh another, DmGpuMesh uploaded,
                  DmCrowd crowd, DmCrowd animated, DmCrowd elsewhere) {
    VkDeviceMemory memory;
    const VkBuffer buffer = storage_create(host, 1 << 16, &memory);
    single_weights(crowd, animated);
    descriptions(uploaded);
    output_streams(crowd, buffer);
    queries(host, crowd);
    readbacks(host, engine, crowd, elsewhere);
    skins(host, engine, other, mesh, another, crowd, buffer);
    surfaces_and_outputs(host, engine, other, mesh, crowd, buffer);
    vkDestroyBuffer(host->device, buffer, NULL), vkFreeMemory(host->device, memory, NULL);
}
