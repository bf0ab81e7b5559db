/*
 * Invalid use of the C API: every call here has to be refused with the code and the words that are documented, and
 * leave everything as it was. Run by programs.rs, also under valgrind. "cpu": what needs no device; "device": the rest.
 */
#define main minimal_main
#include "../../examples/c/minimal.c"
#undef main

#include <math.h>
#include <pthread.h>
#include <sys/stat.h>

static int failures = 0;

static void expect(int line, const char *call, DmResult got, DmResult wanted, const char *words) {
    const char *said = dm_last_error();
    if (got == wanted && (wanted == DM_OK || strstr(said, words))) return;
    fprintf(stderr, "line %d: %s returned %u, not %u with '%s': %s\n", line, call, got, wanted, words, said);
    failures++;
}
#define REFUSED(code, words, call) expect(__LINE__, #call, call, code, words)
#define INVALID(words, call) REFUSED(DM_ERROR_INVALID, words, call)
#define HANDLE(words, call) REFUSED(DM_ERROR_HANDLE, words, call)
#define WORKS(call) expect(__LINE__, #call, call, DM_OK, "")
#define HOLDS(condition) \
    do { if (!(condition)) fprintf(stderr, "line %d: %s\n", __LINE__, #condition), failures++; } while (0)

static const DmMesh no_mesh = {0};
/* The path of the program, beside which files are written. */
static char program[1024];
static const DmCrowd no_crowd = {0};

#include "misuse_steps.c"
#include "misuse_more.c"

static DmMesh sample(uint32_t format) {
    DmSampleDesc head = {.struct_size = sizeof head, .vertices = 200, .targets = 3};
    DmMeshDesc desc = {.struct_size = sizeof desc, .delta_format = format};
    DmMesh mesh = {0};
    WORKS(dm_mesh_sample_head(&head, &desc, &mesh));
    return mesh;
}

static void handles(void) {
    DmMesh mesh = sample(0), written = {77};
    DmClip clip = {mesh.bits}, own = {0};
    DmMeshInfo info = {.struct_size = sizeof info};
    DmClipInfo clip_info = {.struct_size = sizeof clip_info};
    HOLDS(strlen(dm_last_error()) == 0);
    HANDLE("dm_mesh_info: a null handle in place of a mesh", dm_mesh_info(no_mesh, &info));
    HANDLE("the handle of a mesh in place of a clip", dm_clip_info(clip, &clip_info));
    HANDLE("is no handle", dm_mesh_info((DmMesh){0x1234}, &info));
    HANDLE("never created", dm_mesh_info((DmMesh){mesh.bits + 1000}, &info));
    HANDLE("never created", dm_mesh_info((DmMesh){mesh.bits + (1ull << 32)}, &info));
    HANDLE("null handle in place of a crowd", dm_crowd_reset_history(no_crowd, 0));
    HANDLE("null handle in place of a mesh on the device", dm_crowd_create((DmGpuMesh){0}, NULL, &(DmCrowd){0}));
    HANDLE("null handle in place of an engine", dm_engine_destroy((DmEngine){0}));
    DmMeshDesc desc = {.struct_size = sizeof desc, .engine = {mesh.bits}};
    HANDLE("the handle of a mesh in place of an engine", dm_mesh_sample_head(NULL, &desc, &written));
    HOLDS(written.bits == 77);
    const char *name = NULL;
    WORKS(dm_mesh_target_name(mesh, 2, &name));
    HOLDS(name && strlen(name) > 0);
    WORKS(dm_clip_sample_head(&(DmSampleDesc){.struct_size = sizeof(DmSampleDesc), .targets = 2}, 3, 30, &own));
    INVALID("'path' is a null pointer", dm_mesh_write(mesh, NULL));
    REFUSED(DM_ERROR_IO, "/no/such/folder/a.dmorph: cannot write", dm_mesh_write(mesh, "/no/such/folder/a.dmorph"));
    HANDLE("null handle in place of a mesh", dm_mesh_write(no_mesh, "a.dmorph"));
    WORKS(dm_mesh_destroy(mesh));
    HANDLE("was destroyed", dm_mesh_info(mesh, &info));
    HANDLE("was destroyed", dm_mesh_destroy(mesh));
    DmMesh next = sample(0);
    HOLDS(next.bits != mesh.bits);
    HANDLE("was destroyed", dm_mesh_info(mesh, &info));
    WORKS(dm_mesh_info(next, &info));
    HOLDS(info.vertex_count == 200 && info.target_count == 3 && info.struct_size == sizeof info);
    WORKS(dm_mesh_destroy(next));
    WORKS(dm_clip_destroy(own));
}

static void pointers_and_sizes(void) {
    DmMesh mesh = sample(0);
    struct { DmMeshInfo info; uint32_t later[2]; } larger = {{.struct_size = sizeof larger}, {5, 5}};
    struct { DmMeshDesc desc; uint32_t later; } asks = {{.struct_size = sizeof asks}, 1};
    DmMeshDesc none = {0}, flags = {.struct_size = sizeof flags, .flags = 1u << 20};
    DmSampleDesc head = {.struct_size = sizeof head, .vertices = 9, .targets = 1};
    DmMesh made = {0};
    INVALID("a null pointer to DmMeshInfo", dm_mesh_info(mesh, NULL));
    INVALID("'mesh' is a null pointer", dm_mesh_sample_head(NULL, NULL, NULL));
    INVALID("struct_size of 0; set it to sizeof(DmMeshDesc)", dm_mesh_sample_head(NULL, &none, &made));
    INVALID("something is set behind", dm_mesh_sample_head(NULL, &asks.desc, &made));
    INVALID("flag 0x100000 is unknown", dm_mesh_sample_head(NULL, &flags, &made));
    const uint32_t size = sizeof(DmSampleDesc);
    INVALID("10,000,000 vertices at most", dm_mesh_sample_head(&(DmSampleDesc){.struct_size = size, .vertices = UINT32_MAX}, NULL, &made));
    INVALID("2000000000 targets; use", dm_mesh_sample_head(&(DmSampleDesc){.struct_size = size, .targets = 2000000000}, NULL, &made));
    INVALID("a sparsity of 3; use", dm_mesh_sample_head(&(DmSampleDesc){.struct_size = size, .sparsity = 3}, NULL, &made));
    INVALID("a sparsity of NaN; use", dm_mesh_sample_head(&(DmSampleDesc){.struct_size = size, .sparsity = NAN}, NULL, &made));
    DmClip sampled = {0};
    INVALID("more than 2^24 weights", dm_clip_sample_head(NULL, UINT32_MAX, 30, &sampled));
    INVALID("from 0.1 to 1000", dm_clip_sample_head(NULL, 2, 1e-9f, &sampled));
    INVALID("'path' is a null pointer", dm_mesh_open(NULL, NULL, &made));
    INVALID("'path' is no UTF-8", dm_mesh_open("\xff\xfe", NULL, &made));
    HOLDS(made.bits == 0);
    asks.later = 0;
    WORKS(dm_mesh_sample_head(&head, &asks.desc, &made));
    WORKS(dm_mesh_destroy(made));
    WORKS(dm_mesh_info(mesh, &larger.info));
    HOLDS(larger.info.vertex_count == 200 && larger.later[0] == 0 && larger.later[1] == 0);
    HOLDS(larger.info.struct_size == sizeof larger);

    uint32_t count = 1, index = 0, few[3], wrong[1] = {200};
    double reference[6];
    INVALID("'count' is a null pointer", dm_mesh_indices(mesh, NULL, NULL));
    INVALID("room for 1 elements", dm_mesh_indices(mesh, &count, few));
    WORKS(dm_mesh_indices(mesh, &count, NULL));
    HOLDS(count == larger.info.index_count && count % 3 == 0);
    INVALID("index 200", dm_mesh_remap_indices(mesh, wrong, 1));
    HOLDS(wrong[0] == 200);
    INVALID("'indices' is a null pointer", dm_mesh_remap_indices(mesh, NULL, 1));
    INVALID("no multiple of 4", dm_mesh_remap_indices(mesh, (uint32_t *)(void *)((char *)few + 1), 1));
    WORKS(dm_mesh_remap_indices(mesh, NULL, 0));
    INVALID("target 3 of a mesh with 3", dm_mesh_target_name(mesh, 3, &(const char *){NULL}));
    INVALID("no target 'none'", dm_mesh_find_target(mesh, "none", &index));
    INVALID("4 weights for 3 targets", dm_mesh_evaluate(mesh, (float[4]){0}, 4, reference, 6));
    INVALID("room for 6 elements, and 1200", dm_mesh_evaluate(mesh, NULL, 0, reference, 6));
    INVALID("update path (DM_PATH_)", dm_requirements(99, &count, NULL));
    INVALID("format of poses (DM_POSE_)", dm_pose_vertex_input(99, 0, &count, NULL, &count, NULL));
    INVALID("'bindings' is a null pointer", dm_pose_vertex_input(0, 0, &count, NULL, &index, NULL));
    WORKS(dm_requirements(DM_PATH_FEEDBACK, &count, NULL));
    HOLDS(count == 1);
    DmRequirement needed;
    WORKS(dm_requirements(DM_PATH_FEEDBACK, &count, &needed));
    HOLDS(strcmp(needed.extension, "VK_EXT_transform_feedback") == 0 && strlen(needed.reason) > 0);
    WORKS(dm_mesh_destroy(mesh));
}

static void meshes_and_clips(void) {
    const float triangle[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, up[9] = {0, 0, 1, 0, 0, 0, 0, 0, 0};
    const uint32_t indices[3] = {0, 1, 2}, beyond[3] = {0, 1, 3};
    DmTargetArrays targets[2] = {{.struct_size = sizeof *targets, .name = "a", .positions = up},
                                 {.struct_size = sizeof *targets, .name = "b", .positions = triangle}};
    DmMeshArrays arrays = {.struct_size = sizeof arrays, .vertex_count = 3, .positions = triangle, .indices = indices,
                           .index_count = 3, .targets = targets, .target_count = 2};
    DmMesh mesh = {0};
    DmMeshArrays bad = arrays;
    bad.positions = NULL;
    INVALID("'positions' is a null pointer", dm_mesh_from_arrays(&bad, NULL, &mesh));
    bad = arrays, bad.targets = NULL;
    INVALID("a null pointer to DmTargetArrays", dm_mesh_from_arrays(&bad, NULL, &mesh));
    bad = arrays, bad.indices = beyond;
    INVALID("3", dm_mesh_from_arrays(&bad, NULL, &mesh));
    bad = arrays, bad.index_count = 2;
    INVALID("give three per triangle", dm_mesh_from_arrays(&bad, NULL, &mesh));
    bad = arrays, bad.stride = 8;
    INVALID("'stride' is 8", dm_mesh_from_arrays(&bad, NULL, &mesh));
    bad.stride = 14;
    INVALID("a multiple of 4", dm_mesh_from_arrays(&bad, NULL, &mesh));
    targets[1].struct_size = 4;
    INVALID("struct_size of 4", dm_mesh_from_arrays(&arrays, NULL, &mesh));
    targets[1].struct_size = sizeof *targets;
    REFUSED(DM_ERROR_IO, "/no/such/mesh: cannot read: No such file", dm_mesh_open("/no/such/mesh", NULL, &mesh));
    targets[1].name = "a";
    INVALID("dm_mesh_from_arrays: unnamed: targets 0 and 1 are both", dm_mesh_from_arrays(&arrays, NULL, &mesh));
    targets[1].name = "b";
    REFUSED(DM_ERROR_INPUT, "bytes in memory", dm_mesh_from_bytes("garbage", 7, NULL, NULL, &mesh));
    INVALID("'bytes' is a null pointer", dm_mesh_from_bytes(NULL, 7, NULL, NULL, &mesh));
    HOLDS(mesh.bits == 0);
    WORKS(dm_mesh_from_arrays(&arrays, NULL, &mesh));

    const char *names[2] = {"a", "c"};
    const float values[4] = {0, 0, 1, 0.5f};
    DmClipArrays keys = {.struct_size = sizeof keys, .frame_count = 2, .column_count = 1, .fps = 30, .names = names,
                         .values = values};
    DmClip clip = {0}, unknown = {0};
    DmBoundClip bound = {0};
    float weights[2];
    REFUSED(DM_ERROR_IO, "/no/such/clip.csv", dm_clip_open("/no/such/clip.csv", 0, &clip));
    WORKS(dm_clip_from_arrays(&keys, &clip));
    const char *others[2] = {"c", "d"};
    keys.names = others;
    WORKS(dm_clip_from_arrays(&keys, &unknown));
    keys.names = names, keys.column_count = 2;
    INVALID("clip 'unnamed': none of its columns ('c') is a target", dm_clip_bind(unknown, mesh, &bound));
    INVALID("'bound' is a null pointer", dm_clip_bind(clip, mesh, NULL));
    keys.fps = -1;
    INVALID("-1 frames per second", dm_clip_from_arrays(&keys, &clip));
    keys.fps = 30, keys.values = NULL;
    INVALID("'values' is a null pointer", dm_clip_from_arrays(&keys, &clip));
    WORKS(dm_clip_bind(clip, mesh, &bound));
    INVALID("room for 1 elements", dm_bound_clip_sample(bound, 0, weights, 1));
    INVALID("no number", dm_bound_clip_sample(bound, NAN, weights, 2));
    WORKS(dm_bound_clip_sample(bound, 1e9, weights, 2));
    WORKS(dm_clip_destroy(clip));
    WORKS(dm_clip_destroy(unknown));
    WORKS(dm_bound_clip_destroy(bound));
    HANDLE("was destroyed", dm_bound_clip_sample(bound, 0, weights, 2));
    WORKS(dm_mesh_destroy(mesh));
}

/* Threads use a mesh until another destroys it: each call works, or is refused. */
static void *use(void *argument) {
    const DmMesh mesh = *(const DmMesh *)argument;
    const float weights[3] = {0.25f, 0.5f, 0.75f};
    double pose[1200];
    DmResult result = DM_OK;
    while (result == DM_OK) result = dm_mesh_evaluate(mesh, weights, 3, pose, 1200);
    return result == DM_ERROR_HANDLE && strstr(dm_last_error(), "was destroyed") ? NULL : argument;
}

static void threads(void) {
    DmMesh mesh = sample(0);
    pthread_t all[3];
    INVALID("null pointer", dm_mesh_info(mesh, NULL));
    char *before = room_for(strlen(dm_last_error()), 1);
    strcpy(before, dm_last_error());
    for (int i = 0; i < 3; i++) HOLDS(pthread_create(&all[i], NULL, use, &mesh) == 0);
    for (int i = 0; i < 20; i++) WORKS(dm_mesh_evaluate(mesh, NULL, 0, (double[1200]){0}, 1200));
    WORKS(dm_mesh_destroy(mesh));
    for (int i = 0; i < 3; i++) {
        void *failed = NULL;
        HOLDS(pthread_join(all[i], &failed) == 0 && !failed);
    }
    HOLDS(strcmp(before, dm_last_error()) == 0); /* messages are each thread's own */
    free(before);
}

static void engines(const Host *host, DmEngine *engine) {
    DmEngineDesc good = {.struct_size = sizeof good, .instance = host->instance, .physical_device = host->physical,
                         .device = host->device, .get_instance_proc_addr = vkGetInstanceProcAddr}, bad = good;
    INVALID("a null pointer to DmEngineDesc", dm_engine_create(NULL, engine));
    INVALID("'engine' is a null pointer", dm_engine_create(&good, NULL));
    bad.instance = NULL;
    INVALID("'instance' is null", dm_engine_create(&bad, engine));
    bad = good, bad.device = NULL;
    INVALID("'device' is null", dm_engine_create(&bad, engine));
    bad = good, bad.get_instance_proc_addr = NULL;
    INVALID("'get_instance_proc_addr' is null", dm_engine_create(&bad, engine));
    bad = good, bad.reserved = 3;
    INVALID("'reserved' is 3", dm_engine_create(&bad, engine));
    good.get_device_proc_addr = vkGetDeviceProcAddr;
    good.clamp_to_android_baseline = 1;
    WORKS(dm_engine_create(&good, engine));
}

static void crowds(const Host *host, DmEngine engine, DmEngine other) {
    DmMesh mesh = sample(0), dense = sample(DM_DELTAS_FLOAT32);
    DmGpuMesh uploaded = {0}, elsewhere = {0};
    INVALID("'cmd' is null", dm_mesh_upload(engine, NULL, mesh, &uploaded));
    HANDLE("null handle in place of an engine", dm_mesh_upload((DmEngine){0}, NULL, mesh, &uploaded));
    HANDLE("null handle in place of a crowd", dm_record_update(NULL, 1, &no_crowd, NULL));
    host_begin(host);
    HANDLE("null handle in place of a mesh", dm_mesh_upload(engine, host->cmd, no_mesh, &uploaded));
    INVALID("'gpu_mesh' is a null pointer", dm_mesh_upload(engine, host->cmd, mesh, NULL));
    WORKS(dm_mesh_upload(engine, host->cmd, mesh, &uploaded));
    WORKS(dm_mesh_upload(other, host->cmd, dense, &elsewhere));
    host_submit_and_wait(host);
    WORKS(dm_release_staging(uploaded.bits));
    DmPoseView pose = {.struct_size = sizeof pose};
    DmStreamView stream = {.struct_size = sizeof stream};
    INVALID("the engine is used by 1 DmGpuMesh; destroy", dm_engine_destroy(engine));

    DmCrowd crowd = {0}, second = {0}, far = {0};
    DmCrowdDesc desc = {.struct_size = sizeof desc, .path = DM_PATH_COMPUTE};
    INVALID("compute", dm_crowd_create(uploaded, &desc, &crowd));
    WORKS(dm_crowd_create(elsewhere, &desc, &far));
    desc.path = DM_PATH_FEEDBACK; /* the extension is missing: whether the batch would do does not matter */
    REFUSED(DM_ERROR_UNSUPPORTED, "VK_EXT_transform_feedback", dm_crowd_create(elsewhere, &desc, &crowd));
    desc.path = 4;
    INVALID("4 is no update path (DM_PATH_)", dm_crowd_create(elsewhere, &desc, &crowd));
    desc = (DmCrowdDesc){.struct_size = sizeof desc, .slots = 1};
    WORKS(dm_crowd_create(uploaded, &desc, &crowd));
    WORKS(dm_crowd_create(uploaded, NULL, &second));

    const float weights[3] = {1, 0.5f, -0.25f};
    uint32_t instance = 9;
    DmUpdate update = {.struct_size = sizeof update}, again = update;
    INVALID("no pose yet", dm_crowd_pose(crowd, 0, &pose));
    INVALID("weights", dm_crowd_set_weights(crowd, 0, weights, 2));
    INVALID("instance", dm_crowd_set_weights(crowd, 1, weights, 3));
    INVALID("plays no clips", dm_crowd_set_time(crowd, 1));
    INVALID("plays no clips", dm_release_staging(crowd.bits));
    INVALID("capacity", dm_crowd_add(crowd, &instance));
    HOLDS(instance == 9);
    INVALID("instance", dm_crowd_reset_history(crowd, 1));
    INVALID("instance", dm_crowd_set_hidden(crowd, 7, 1));
    INVALID("instance", dm_crowd_remove(crowd, 7));
    INVALID("update 1 of 0", dm_crowd_discard(crowd, (DmTicket){crowd.bits, 1}));
    WORKS(dm_crowd_set_weights(crowd, 0, weights, 3));
    INVALID("'cmd' is null", dm_record_update(NULL, 1, &crowd, &update));

    host_begin(host);
    HANDLE("null handle in place of a crowd", dm_record_update(host->cmd, 1, &no_crowd, &update));
    INVALID("an update of an empty list of crowds", dm_record_update(host->cmd, 0, NULL, NULL));
    INVALID("named twice", dm_record_update(host->cmd, 2, (DmCrowd[]){crowd, crowd}, NULL));
    INVALID("several engines", dm_record_update(host->cmd, 2, (DmCrowd[]){crowd, far}, NULL));
    INVALID("'crowds' is a null pointer", dm_record_update(host->cmd, 2, NULL, NULL));
    INVALID("struct_size of 0", dm_record_update(host->cmd, 1, &crowd, &(DmUpdate){0}));
    WORKS(dm_record_update(host->cmd, 1, &crowd, &update)); /* never runs */
    HOLDS(update.ticket.number == 1 && update.ticket.crowd == crowd.bits && update.coefficients == 3);
    INVALID("the ticket of another crowd", dm_crowd_discard(second, update.ticket));
    VK(vkEndCommandBuffer(host->cmd));
    WORKS(dm_crowd_discard(crowd, update.ticket));
    WORKS(dm_crowd_discard(crowd, update.ticket)); /* it stays so */
    INVALID("no pose yet", dm_crowd_pose(crowd, 0, &pose));
    host_begin(host);
    DmUpdate updates[2] = {update, again};
    WORKS(dm_record_update(host->cmd, 2, (DmCrowd[]){second, crowd}, updates));
    host_submit_and_wait(host);
    HOLDS(updates[0].ticket.crowd == second.bits && updates[1].ticket.crowd == crowd.bits);
    HOLDS(updates[0].ticket.number == 1 && updates[1].ticket.number == 2);
    WORKS(dm_crowd_pose(crowd, 0, &pose));
    HOLDS(pose.buffer && pose.stride == 24 && pose.format == DM_POSE_FLOAT32 && pose.units[5] == 1 && !pose.offsets[5]);
    WORKS(dm_crowd_stream(crowd, 0, DM_STREAM_NORMAL, &stream));
    HOLDS(stream.components == 3 && stream.buffer);
    INVALID("stream", dm_crowd_stream(crowd, 0, DM_STREAM_TANGENT, &stream));

    DmClip clip = {0};
    DmCrowd animated = {0};
    DmSampleDesc head = {.struct_size = sizeof head, .vertices = 200, .targets = 3};
    WORKS(dm_clip_sample_head(&head, 5, 30, &clip));
    DmAnimationDesc clips = {.struct_size = sizeof clips, .clip_count = 1, .clips = &clip, .key_bits = 8};
    host_begin(host);
    INVALID("keys of 8 bits", dm_crowd_create_animated(uploaded, host->cmd, NULL, &clips, &animated));
    clips.key_bits = 16;
    clips.clips = NULL;
    INVALID("'clips' is a null pointer", dm_crowd_create_animated(uploaded, host->cmd, NULL, &clips, &animated));
    clips.clips = &clip;
    DmLevelDesc levels = {.struct_size = sizeof levels, .pin_count = 1, .pins = (const char *[]){"none"}};
    clips.level = &levels;
    HANDLE("null handle in place of a mesh", dm_crowd_create_animated(uploaded, host->cmd, NULL, &clips, &animated));
    levels.mesh = mesh;
    INVALID("begins with 'none'", dm_crowd_create_animated(uploaded, host->cmd, NULL, &clips, &animated));
    levels.pins = NULL;
    INVALID("'pins' is a null pointer", dm_crowd_create_animated(uploaded, host->cmd, NULL, &clips, &animated));
    levels.pin_count = 0;
    WORKS(dm_crowd_create_animated(uploaded, host->cmd, NULL, &clips, &animated));
    WORKS(dm_clip_destroy(clip));
    INVALID("the crowd plays clips", dm_crowd_set_weights(animated, 0, weights, 3));
    DmPlayback playback = {.struct_size = sizeof playback, .clip = 1};
    INVALID("clip", dm_crowd_play(animated, 0, &playback));
    playback.clip = 0;
    WORKS(dm_crowd_play(animated, 0, &playback));
    INVALID("NaN", dm_crowd_set_time(animated, NAN));
    WORKS(dm_crowd_set_time(animated, 0.1));
    WORKS(dm_record_update(host->cmd, 1, &animated, NULL));
    host_submit_and_wait(host);
    WORKS(dm_release_staging(animated.bits));
    steps(host, engine, other, mesh, dense, uploaded, crowd, animated, far);
    more(host, mesh, uploaded, crowd, animated);

    WORKS(dm_mesh_destroy(mesh));
    WORKS(dm_gpu_mesh_destroy(uploaded));
    WORKS(dm_crowd_pose(crowd, 0, &pose)); /* crowds keep what they need */
    INVALID("the engine is used by 3 DmCrowd; destroy", dm_engine_destroy(engine));
    WORKS(dm_crowd_destroy(crowd));
    WORKS(dm_crowd_destroy(second));
    WORKS(dm_crowd_destroy(animated));
    WORKS(dm_crowd_destroy(far));
    WORKS(dm_gpu_mesh_destroy(elsewhere));
    WORKS(dm_mesh_destroy(dense));
    HANDLE("was destroyed", dm_crowd_pose(crowd, 0, &pose));
    HANDLE("was destroyed", dm_record_update(host->cmd, 1, &crowd, NULL));
    WORKS(dm_engine_destroy(other));
    WORKS(dm_engine_destroy(engine));
    HANDLE("was destroyed", dm_engine_destroy(engine));
}

int main(int argc, char **argv) {
    if (argc < 2) fail("usage", "misuse cpu|device [PART OF A DEVICE'S NAME]");
    snprintf(program, sizeof program, "%s", argv[0]);
    if (strcmp(argv[1], "cpu") == 0) {
        handles(), null_handles(), pointers_and_sizes(), meshes_and_clips(), messages(), threads();
    } else {
        const Host host = host_create(argc > 2 ? argv[2] : "");
        DmEngine engine = {0}, other = {0};
        engines(&host, &engine), engines(&host, &other);
        crowds(&host, engine, other);
        vkDestroyCommandPool(host.device, host.pool, NULL);
        vkDestroyDevice(host.device, NULL);
        vkDestroyInstance(host.instance, NULL);
    }
    printf("%d of the calls did not do what they should\n", failures);
    return failures != 0;
}
