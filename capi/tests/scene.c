/*
 * A face and its teeth in C, whose float64 is computed here: a set takes one weight vector; the face's poses are in the
 * host's interleaved vertices, and are skinned and given normals of their surface; the teeth are read back and decoded.
 * Run by programs.rs: scene PART_OF_A_DEVICE_NAME [FILE.glb]. With a file, the face is written there, and opened.
 */
#define main minimal_main
#include "../../examples/c/minimal.c"
#undef main

enum { SIDE = 24, TEETH_SIDE = 9, TARGETS = 6, JOINTS = 3, STRIDE = 48, FRAMES = 9, INFLUENCES = 4, QUERIES = 8 };

static const char *const NAMES[TARGETS] = {"smile", "blink", "jawOpen", "browUp", "pucker", "sneer"};

/* A patch of side x side vertices, and how its targets move them; z is up. */
typedef struct {
    uint32_t vertices, targets, triangles, *indices;
    float *positions, *deltas[TARGETS];
    const char *const *names;
} Patch;

static Patch patch_create(uint32_t side, uint32_t first_target, uint32_t targets) {
    Patch patch = {.vertices = side * side, .targets = targets, .triangles = 2 * (side - 1) * (side - 1),
                   .names = &NAMES[first_target]};
    patch.positions = room_for(patch.vertices, 12);
    patch.indices = room_for(patch.triangles, 12);
    for (uint32_t t = 0; t < targets; t++) patch.deltas[t] = room_for(patch.vertices, 12);
    for (uint32_t v = 0; v < patch.vertices; v++) {
        const float x = (float)(v % side) / (float)(side - 1), y = (float)(v / side) / (float)(side - 1);
        patch.positions[v * 3] = x, patch.positions[v * 3 + 1] = y;
        patch.positions[v * 3 + 2] = 0.2f * sinf(3 * x) * cosf(2 * y);
        for (uint32_t t = 0; t < targets; t++) {
            const float dx = x - 0.15f * (float)(t + first_target + 1), dy = y - 0.5f + 0.1f * (float)t;
            const float height = expf(-30 * (dx * dx + dy * dy));
            if (height < 0.02f) continue;
            patch.deltas[t][v * 3] = 0.1f * height, patch.deltas[t][v * 3 + 2] = 0.25f * height;
        }
    }
    uint32_t *next = patch.indices;
    for (uint32_t y = 0; y + 1 < side; y++) {
        for (uint32_t x = 0; x + 1 < side; x++) {
            const uint32_t a = y * side + x, b = a + 1, c = a + side, d = c + 1, two[6] = {a, b, d, a, d, c};
            memcpy(next, two, sizeof two), next += 6;
        }
    }
    return patch;
}

static void patch_destroy(Patch *patch) {
    for (uint32_t t = 0; t < patch->targets; t++) free(patch->deltas[t]);
    free(patch->positions), free(patch->indices);
}

/* From vertices of 20 bytes, of which positions are 12; deltas are contiguous. */
static DmMesh patch_mesh(const Patch *patch) {
    float *vertices = room_for(patch->vertices, 20);
    for (uint32_t v = 0; v < patch->vertices; v++) memcpy(vertices + v * 5, patch->positions + v * 3, 12);
    DmTargetArrays targets[TARGETS] = {{0}};
    for (uint32_t t = 0; t < patch->targets; t++)
        targets[t] = (DmTargetArrays){.struct_size = sizeof *targets, .name = patch->names[t],
                                      .positions = patch->deltas[t], .stride = t % 2 ? 12 : 0};
    DmMeshArrays arrays = {.struct_size = sizeof arrays, .vertex_count = patch->vertices, .name = "patch",
                           .positions = vertices, .stride = 20, .indices = patch->indices,
                           .index_count = patch->triangles * 3, .targets = targets, .target_count = patch->targets};
    DmMesh mesh;
    DM(dm_mesh_from_arrays(&arrays, NULL, &mesh));
    free(vertices);
    return mesh;
}

static void put(FILE *file, const void *bytes, size_t size) {
    if (fwrite(bytes, 1, size, file) != size) fail("fwrite", "failed");
}

/* The patch as a glTF file: positions, indices, and the positions of targets, in that order. */
static void patch_write(const Patch *patch, const char *path) {
    const uint32_t triples = patch->vertices * 12, indices = patch->triangles * 12;
    char json[16384], views[2048] = "", accessors[4096] = "", targets[1024] = "", names[1024] = "";
    uint32_t at = 0;
    for (uint32_t i = 0; i < patch->targets + 2; i++) {
        const int is_index = i == 1;
        const char *comma = i == 0 ? "" : ",";
        const uint32_t size = is_index ? indices : triples;
        sprintf(views + strlen(views), "%s{\"buffer\":0,\"byteOffset\":%u,\"byteLength\":%u}", comma, at, size);
        sprintf(accessors + strlen(accessors), "%s{\"bufferView\":%u,\"componentType\":%d,\"count\":%u,%s}", comma, i,
                is_index ? 5125 : 5126, is_index ? patch->triangles * 3 : patch->vertices,
                is_index ? "\"type\":\"SCALAR\"" : "\"type\":\"VEC3\",\"min\":[-9,-9,-9],\"max\":[9,9,9]");
        if (i > 1) {
            sprintf(targets + strlen(targets), "%s{\"POSITION\":%u}", i == 2 ? "" : ",", i);
            sprintf(names + strlen(names), "%s\"%s\"", i == 2 ? "" : ",", patch->names[i - 2]);
        }
        at += size;
    }
    sprintf(json,
            "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":%u}],\"bufferViews\":[%s],"
            "\"accessors\":[%s],"
            "\"meshes\":[{\"extras\":{\"targetNames\":[%s]},\"primitives\":[{\"attributes\":{\"POSITION\":0},"
            "\"indices\":1,\"targets\":[%s]}]}],\"nodes\":[{\"mesh\":0}],\"scenes\":[{\"nodes\":[0]}],\"scene\":0}",
            at, views, accessors, names, targets);
    while (strlen(json) % 4) strcat(json, " ");
    const uint32_t text = (uint32_t)strlen(json);
    const uint32_t header[5] = {0x46546c67, 2, 28 + text + at, text, 0x4e4f534a}, chunk[2] = {at, 0x004e4942};
    FILE *file = fopen(path, "wb");
    if (!file) fail(path, "cannot be written");
    put(file, header, sizeof header), put(file, json, text), put(file, chunk, sizeof chunk);
    put(file, patch->positions, triples), put(file, patch->indices, indices);
    for (uint32_t t = 0; t < patch->targets; t++) put(file, patch->deltas[t], triples);
    if (fclose(file) != 0) fail(path, "cannot be written");
}

/* The pose that the arrays and weights say, positions alone. */
static void patch_evaluate(const Patch *patch, const float *weights, double *out) {
    for (uint32_t i = 0; i < patch->vertices * 3; i++) {
        out[i] = patch->positions[i];
        for (uint32_t t = 0; t < patch->targets; t++) out[i] += (double)weights[t] * patch->deltas[t][i];
    }
}

static double distance(const float *a, const double *b) {
    const double sum = pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2);
    return isfinite(sum) ? sqrt(sum) : INFINITY;
}

static void cross(const double *a, const double *b, double *out) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static void normalize(double *a) {
    const double length = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    for (int i = 0; i < 3; i++) a[i] /= length;
}

/* What is wrong, and by how much at most. */
typedef struct {
    const char *what;
    double allowed, worst;
} Error;
enum { MORPHED, PACKED, TEETH, SKINNED, SKINNED_NORMALS, SURFACE_NORMALS, DECODED, ERRORS };
static Error errors[ERRORS] = {{"morphed", 1e-4, 0},          {"morphed, as packed", 1e-6, 0}, {"teeth", 1e-6, 0},
                               {"skinned", 1e-6, 0},          {"skinned normals", 1e-5, 0},    {"normals", 1e-5, 0},
                               {"decoded", 0, 0}};

static void note(int which, double error) { errors[which].worst = fmax(errors[which].worst, error); }

/* Joints of a frame: each turns about an axis of its own, and moves. Three rows of four. */
static void joints_set(float *joints, uint32_t frame) {
    for (int j = 0; j < JOINTS; j++) {
        const double angle = 0.1 * (double)frame * (double)(j + 1), c = cos(angle), s = sin(angle);
        const int a = j % 3, b = (j + 1) % 3;
        float *rows = joints + j * 12;
        memset(rows, 0, 48);
        rows[a * 4 + a] = rows[b * 4 + b] = (float)c;
        rows[a * 4 + b] = (float)-s, rows[b * 4 + a] = (float)s;
        rows[((j + 2) % 3) * 5] = 1;
        rows[j * 4 + 3] = (float)(0.1 * j);
    }
}

static void skinned_check(const float *got, const float *pose, const uint16_t *which, const float *weights,
                          const float *joints) {
    double m[12] = {0}, sum = 0, determinant = 0, position[3], rows[3][3], cofactors[3][3], normal[3];
    for (int k = 0; k < INFLUENCES; k++) sum += weights[k];
    for (int k = 0; k < INFLUENCES; k++)
        for (int i = 0; i < 12; i++) m[i] += weights[k] / sum * joints[which[k] * 12 + i];
    for (int r = 0; r < 3; r++) {
        position[r] = m[r * 4] * pose[0] + m[r * 4 + 1] * pose[1] + m[r * 4 + 2] * pose[2] + m[r * 4 + 3];
        memcpy(rows[r], m + r * 4, sizeof rows[r]);
    }
    /* The inverse transpose is the cofactors through the determinant, whose sign is all that matters here. */
    for (int r = 0; r < 3; r++) cross(rows[(r + 1) % 3], rows[(r + 2) % 3], cofactors[r]);
    for (int i = 0; i < 3; i++) determinant += rows[0][i] * cofactors[0][i];
    for (int r = 0; r < 3; r++)
        normal[r] = copysign(1, determinant) *
                    (cofactors[r][0] * pose[3] + cofactors[r][1] * pose[4] + cofactors[r][2] * pose[5]);
    normalize(normal);
    note(SKINNED, distance(got, position));
    note(SKINNED_NORMALS, distance(got + 3, normal));
}

/* Normals of the surface of a pose, area-weighted; vertices and triangles are those of the patch. */
static void surface_check(const Patch *patch, const float *got, const char *poses) {
    double *sums = room_for(patch->vertices, 3 * sizeof *sums);
    for (uint32_t i = 0; i < patch->triangles; i++) {
        const uint32_t *corners = patch->indices + i * 3;
        double edges[2][3], area[3];
        const float *from = (const float *)(const void *)(poses + corners[0] * STRIDE);
        for (int e = 0; e < 2; e++) {
            const float *to = (const float *)(const void *)(poses + corners[e + 1] * STRIDE);
            for (int c = 0; c < 3; c++) edges[e][c] = (double)to[c] - from[c];
        }
        cross(edges[0], edges[1], area);
        for (int k = 0; k < 3; k++)
            for (int c = 0; c < 3; c++) sums[corners[k] * 3 + c] += area[c];
    }
    for (uint32_t v = 0; v < patch->vertices; v++) {
        normalize(sums + v * 3);
        note(SURFACE_NORMALS, distance(got + v * 3, sums + v * 3));
    }
    free(sums);
}

int main(int argc, char **argv) {
    const Host host = host_create(argc > 1 ? argv[1] : "");
    DmEngineDesc device = {.struct_size = sizeof device, .instance = host.instance, .physical_device = host.physical,
                           .device = host.device, .get_instance_proc_addr = vkGetInstanceProcAddr};
    DmEngine engine;
    DM(dm_engine_create(&device, &engine));

    /* The teeth have the third target of the face and the ones after it. */
    char packed_file[4096];
    Patch face = patch_create(SIDE, 0, TARGETS), teeth = patch_create(TEETH_SIDE, 2, TARGETS - 2);
    DmMesh meshes[2] = {{0}, patch_mesh(&teeth)};
    if (argc > 2) {
        patch_write(&face, argv[2]);
        DM(dm_mesh_open(argv[2], NULL, &meshes[0]));
        /* Packed once, and read without packing. */
        strcat(strcpy(packed_file, argv[2]), ".dmorph");
        DM(dm_mesh_write(meshes[0], packed_file));
        DM(dm_mesh_destroy(meshes[0]));
        DM(dm_mesh_open(packed_file, NULL, &meshes[0]));
    } else {
        meshes[0] = patch_mesh(&face);
    }
    DmMeshInfo info = {.struct_size = sizeof info};
    DM(dm_mesh_info(meshes[0], &info));
    if (info.vertex_count != face.vertices || info.target_count != TARGETS) fail("the face", "has other counts");
    uint16_t *influences = room_for(face.vertices, 2 * INFLUENCES);
    float *influence = room_for(face.vertices, 4 * INFLUENCES);
    for (uint32_t i = 0; i < face.vertices * INFLUENCES; i++)
        influences[i] = (uint16_t)((i + i / 7) % JOINTS), influence[i] = (float)(1 + i % 5);
    DmSkinDesc skin_desc = {.struct_size = sizeof skin_desc, .joints = influences, .weights = influence,
                            .joint_count = JOINTS};
    DmGpuMesh uploaded[2];
    DmSkin skin;
    DmSurface surface;
    host_begin(&host);
    for (int i = 0; i < 2; i++) DM(dm_mesh_upload(engine, host.cmd, meshes[i], &uploaded[i]));
    DM(dm_skin_upload(engine, host.cmd, meshes[0], &skin_desc, &skin));
    DM(dm_surface_upload(engine, host.cmd, meshes[0], &surface));
    host_submit_and_wait(&host);
    DM(dm_release_staging(uploaded[0].bits));
    DM(dm_release_staging(skin.bits));
    DM(dm_release_staging(surface.bits));

    /* Position and normal are written in the order of the mesh; 24 bytes behind them are the application's. */
    const uint32_t pose_bytes = face.vertices * STRIDE;
    const VkBufferUsageFlags storage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
    Readback vertices = readback_create(&host, pose_bytes, storage | VK_BUFFER_USAGE_VERTEX_BUFFER_BIT);
    Readback skinned = readback_create(&host, face.vertices * 48, storage);
    Readback normals = readback_create(&host, face.vertices * 12, storage);
    Readback joints = readback_create(&host, FRAMES * 192, storage);
    Readback decoded = readback_create(&host, teeth.vertices * 12, storage);
    char *bytes = (char *)vertices.mapped;
    memset(bytes, 0xa5, pose_bytes);
    DmCrowdDesc descs[2] = {{.struct_size = sizeof *descs, .instances = 2},
                            {.struct_size = sizeof *descs, .pose_format = DM_POSE_FIXED32}};
    DmCrowd crowds[2];
    for (int i = 0; i < 2; i++) DM(dm_crowd_create(uploaded[i], &descs[i], &crowds[i]));
    const DmOutputStream interleaved[2] = {
        {.stream = DM_STREAM_POSITION, .buffer = vertices.buffer, .stride = STRIDE},
        {.stream = DM_STREAM_NORMAL, .buffer = vertices.buffer, .stride = STRIDE, .offset = 12},
    };
    const uint64_t half = face.vertices * 24;
    const DmOutputStream in_turn[2] = {
        {.stream = DM_STREAM_POSITION, .buffer = skinned.buffer, .stride = 24,
         .second_buffer = skinned.buffer, .second_offset = half},
        {.stream = DM_STREAM_NORMAL, .buffer = skinned.buffer, .stride = 24, .offset = 12,
         .second_buffer = skinned.buffer, .second_offset = half + 12},
    };
    const DmOutputStream recomputed = {.stream = DM_STREAM_NORMAL, .buffer = normals.buffer};
    const DmOutputStream plain = {.stream = DM_STREAM_POSITION, .buffer = decoded.buffer};
    const DmSkin none = {0};
    DmOutputTarget target = {.struct_size = sizeof target, .streams = interleaved, .stream_count = 2};
    DM(dm_crowd_set_output_target(crowds[0], 0, none, &target));
    target.streams = in_turn, target.joints = joints.buffer, target.joints_bytes = FRAMES * 192;
    DM(dm_crowd_set_output_target(crowds[0], 1, skin, &target));
    target = (DmOutputTarget){.struct_size = sizeof target, .streams = &recomputed, .stream_count = 1};
    DM(dm_crowd_set_normals_target(crowds[0], 0, surface, &target));
    target.streams = &plain, target.pose_order = 1;
    DM(dm_crowd_set_output_target(crowds[1], 0, none, &target));

    DmReadback readback;
    DM(dm_readback_create(engine, &readback));
    const VkQueryPoolCreateInfo of_times = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                            .queryType = VK_QUERY_TYPE_TIMESTAMP, .queryCount = QUERIES};
    VkQueryPool queries;
    if (vkCreateQueryPool(host.device, &of_times, NULL, &queries) != VK_SUCCESS) fail("a query pool", "is not there");
    double *exact = room_for(face.vertices, 6 * sizeof *exact), *reference = room_for(face.vertices, 6 * sizeof *exact);
    float *read = room_for(teeth.vertices, 6 * sizeof *read);
    uint32_t *teeth_packed = room_for(teeth.vertices, sizeof *teeth_packed);
    for (uint32_t v = 0; v < teeth.vertices; v++) teeth_packed[v] = v;
    DM(dm_mesh_remap_indices(meshes[1], teeth_packed, teeth.vertices));
    for (uint32_t frame = 0; frame < FRAMES; frame++) {
        float weights[TARGETS], *held = weights + 2, *frame_joints = joints.mapped + frame * 48;
        for (uint32_t t = 0; t < TARGETS; t++) weights[t] = (float)((5 * t + 3 * frame) % 8) / 8;
        joints_set(frame_joints, frame);
        for (uint32_t i = 0; i < 2; i++) DM(dm_crowd_set_weights(crowds[0], i, weights, face.targets));
        DM(dm_crowd_set_weights(crowds[1], 0, weights + 2, teeth.targets));
        if (frame == FRAMES - 1) { /* one by one, the teeth alone */
            DM(dm_crowd_set_weight(crowds[1], 0, 0, 0.875f));
            uint32_t sneer;
            DM(dm_mesh_find_target(meshes[1], "sneer", &sneer));
            DM(dm_crowd_set_weight(crowds[1], 0, sneer, 0.375f));
        }
        DM(dm_crowd_set_joints(crowds[0], 1, frame * 192));
        DmUpdate updates[2] = {{.struct_size = sizeof *updates}, {.struct_size = sizeof *updates}};
        const uint32_t instance = 0;
        host_begin(&host);
        vkCmdResetQueryPool(host.cmd, queries, 0, QUERIES);
        DM(dm_crowd_set_queries(crowds[0], queries, 0, QUERIES));
        DM(dm_record_update(host.cmd, 2, crowds, updates));
        DM(dm_readback_record(readback, host.cmd, crowds[1], &instance, 1));
        VkMemoryBarrier read_by_host = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                        .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                                        .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
        const VkPipelineStageFlags from = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, to = VK_PIPELINE_STAGE_HOST_BIT;
        vkCmdPipelineBarrier(host.cmd, from, to, 0, 1, &read_by_host, 0, NULL, 0, NULL);
        host_submit_and_wait(&host);

        /* Blocks, outputs, normals. */
        uint64_t times[QUERIES] = {0};
        if (updates[0].timestamps != 4 || updates[1].timestamps != 0) fail("timestamps", "are not those of three steps");
        vkGetQueryPoolResults(host.device, queries, 0, 4, sizeof times, times, 8, VK_QUERY_RESULT_64_BIT);
        for (int i = 0; i < 3; i++)
            if (times[i] > times[i + 1] || times[i] == 0) fail("timestamps", "are not in order");

        patch_evaluate(&face, weights, exact);
        DM(dm_mesh_evaluate(meshes[0], weights, TARGETS, reference, (size_t)face.vertices * 6));
        DmOutputView view = {.struct_size = sizeof view};
        DM(dm_crowd_output(crowds[0], 1, &view));
        if (view.buffer != skinned.buffer || (frame > 0 && view.previous_offset == view.offset))
            fail("the skinned pose", "is elsewhere");
        for (uint32_t v = 0; v < face.vertices; v++) {
            const float *pose = (const float *)(const void *)(bytes + v * STRIDE);
            note(MORPHED, distance(pose, exact + v * 3) / info.diagonal);
            note(PACKED, distance(pose, reference + v * 6) / info.diagonal);
            const double *normal = reference + v * 6 + 3;
            const double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
            note(PACKED, distance(pose + 3, (double[3]){normal[0] / length, normal[1] / length, normal[2] / length}));
            skinned_check(skinned.mapped + view.offset / 4 + v * 6, pose, influences + v * INFLUENCES,
                          influence + v * INFLUENCES, frame_joints);
        }
        surface_check(&face, normals.mapped, bytes);
        for (uint32_t v = 0; v < face.vertices; v++)
            for (int i = 24; i < STRIDE; i++)
                if (bytes[v * STRIDE + i] != (char)0xa5) fail("the host's bytes", "were written");

        if (frame == FRAMES - 1) held[0] = 0.875f, held[3] = 0.375f;
        DM(dm_mesh_evaluate(meshes[1], held, teeth.targets, reference, (size_t)teeth.vertices * 6));
        DM(dm_readback_pose(readback, 0, 0, read, (size_t)teeth.vertices * 6));
        for (uint32_t v = 0; v < teeth.vertices; v++) {
            note(TEETH, distance(read + v * 6, reference + v * 6) / info.diagonal);
            note(DECODED, memcmp(read + v * 6, decoded.mapped + teeth_packed[v] * 3, 12) ? INFINITY : 0);
        }
    }

    DM(dm_readback_destroy(readback));
    vkDestroyQueryPool(host.device, queries, NULL);
    for (int i = 0; i < 2; i++) DM(dm_crowd_destroy(crowds[i]));
    for (int i = 0; i < 2; i++) DM(dm_gpu_mesh_destroy(uploaded[i]));
    for (int i = 0; i < 2; i++) DM(dm_mesh_destroy(meshes[i]));
    DM(dm_skin_destroy(skin));
    DM(dm_surface_destroy(surface));
    DM(dm_engine_destroy(engine));
    const Readback all[5] = {vertices, skinned, normals, joints, decoded};
    for (int i = 0; i < 5; i++) {
        vkDestroyBuffer(host.device, all[i].buffer, NULL);
        vkFreeMemory(host.device, all[i].memory, NULL);
    }
    vkDestroyCommandPool(host.device, host.pool, NULL);
    vkDestroyDevice(host.device, NULL);
    vkDestroyInstance(host.instance, NULL);
    free(influences), free(influence), free(exact), free(reference), free(read), free(teeth_packed);
    patch_destroy(&face), patch_destroy(&teeth);
    int failed = 0;
    for (int i = 0; i < ERRORS; i++) {
        printf("%s: within %.1e\n", errors[i].what, errors[i].worst);
        failed |= !(errors[i].worst <= errors[i].allowed);
    }
    if (failed) fail("the scene", "differs from what it should be");
    return 0;
}
