/*
 * A head whose weights are a clip's, of a few targets at a time; an instance comes while it plays; bounds from weights hold
 * what is drawn. Poses are compared with the float64 reference. Run by programs.rs: clips PART_OF_A_DEVICE_NAME.
 */
#define main minimal_main
#include "../../examples/c/minimal.c"
#undef main

enum { TARGETS = 12, WINDOW = 3, STEPS = 14, FRAMES = 8, VERTICES = 900, ADDED = 4 };

/* Weights of the clip: any numbers. */
static float key(uint32_t frame, uint32_t target) { return (float)((7 * target + 5 * frame) % 9) / 10; }

static DmBoundClip clip_bound(DmMesh mesh, const char *const *names) {
    float *values = room_for(FRAMES * TARGETS, sizeof *values);
    for (uint32_t i = 0; i < FRAMES * TARGETS; i++) values[i] = key(i / TARGETS, i % TARGETS);
    const DmClipArrays arrays = {.struct_size = sizeof arrays, .frame_count = FRAMES, .column_count = TARGETS,
                                 .fps = 10, .names = names, .values = values};
    DmClip clip;
    DmBoundClip bound;
    DM(dm_clip_from_arrays(&arrays, &clip));
    DM(dm_clip_bind(clip, mesh, &bound));
    DM(dm_clip_destroy(clip));
    free(values);
    return bound;
}

/* Whether a target has a weight in a step. */
static int is_used(uint32_t step, uint32_t target) {
    return (target + TARGETS - 2 * step % TARGETS) % TARGETS < WINDOW;
}

/* What the clip says. Its last frame stays. */
static double sampled(uint32_t target, double seconds) {
    const double at = fmin(seconds * 10, FRAMES - 1);
    const uint32_t from = (uint32_t)at, to = from + 1 < FRAMES ? from + 1 : from;
    return key(from, target) + (at - from) * (key(to, target) - key(from, target));
}

/* How far positions are from the reference at most, as a fraction of the diagonal; they are within bounds. */
static double compared(DmMesh mesh, DmWeightBounds bounds, const float *weights, const float *pose, double diagonal) {
    double *reference = room_for(VERTICES * FLOATS, sizeof *reference), worst = 0;
    float box[6];
    DM(dm_mesh_evaluate(mesh, weights, TARGETS, reference, VERTICES * FLOATS));
    DM(dm_weight_bounds_of(bounds, weights, TARGETS, 0, box));
    for (uint32_t v = 0; v < VERTICES; v++) {
        double sum = 0;
        for (int c = 0; c < 3; c++) {
            const double exact = reference[v * FLOATS + c];
            sum += pow(pose[v * FLOATS + c] - exact, 2);
            if (exact < box[c] || exact > box[c + 3]) fail("bounds", "are violated");
        }
        worst = fmax(worst, isfinite(sum) ? sqrt(sum) / diagonal : INFINITY);
    }
    free(reference);
    return worst;
}

static void read_pose(const Host *host, DmReadback readback, DmCrowd crowd, uint32_t instance, float *pose) {
    host_begin(host);
    DM(dm_readback_record(readback, host->cmd, crowd, &instance, 1));
    host_submit_and_wait(host);
    DM(dm_readback_pose(readback, 0, 0, pose, VERTICES * FLOATS));
}

/* A crowd that plays a clip of the head. */
typedef struct Player {
    DmGpuMesh mesh;
    DmClip clip;
    DmCrowd crowd;
} Player;

/* One whose instances all play; commands are being recorded. */
static Player player_begin(const Host *host, DmEngine engine, DmMesh mesh, const DmCrowdDesc *desc,
                           const DmLevelDesc *level) {
    Player player;
    const DmSampleDesc head = {.struct_size = sizeof head, .vertices = VERTICES, .targets = TARGETS};
    const DmPlayback playback = {.struct_size = sizeof playback};
    const DmAnimationDesc clips = {
        .struct_size = sizeof clips, .clip_count = 1, .clips = &player.clip, .level = level};
    DM(dm_clip_sample_head(&head, 20, 30, &player.clip));
    host_begin(host);
    DM(dm_mesh_upload(engine, host->cmd, mesh, &player.mesh));
    DM(dm_crowd_create_animated(player.mesh, host->cmd, desc, &clips, &player.crowd));
    const uint32_t instances = desc->instances == 0 ? 1 : desc->instances;
    for (uint32_t instance = 0; instance < instances; instance++) DM(dm_crowd_play(player.crowd, instance, &playback));
    return player;
}

static void player_destroy(Player player) {
    DM(dm_clip_destroy(player.clip));
    DM(dm_crowd_destroy(player.crowd));
    DM(dm_gpu_mesh_destroy(player.mesh));
}

/* Of three instances at the same time of a clip, two keep the target that is pinned, and one keeps all: two poses are the same,
 * bit for bit, and the third is another. */
static void keep_fewer_targets(const Host *host, DmEngine engine, DmMesh mesh, DmReadback readback) {
    const char *pin;
    const DmCrowdDesc desc = {.struct_size = sizeof desc, .instances = 3};
    const DmLevelDesc levels = {.struct_size = sizeof levels, .pin_count = 1, .mesh = mesh, .pins = &pin};
    float *poses = room_for(3 * VERTICES * FLOATS, sizeof *poses);
    DM(dm_mesh_target_name(mesh, 0, &pin));
    const Player player = player_begin(host, engine, mesh, &desc, &levels);
    const DmCrowd crowd = player.crowd;
    DM(dm_crowd_set_level(crowd, 0, 1));
    DM(dm_crowd_set_level(crowd, 1, 1));
    DM(dm_crowd_set_time(crowd, 0.3));
    DM(dm_record_update(host->cmd, 1, &crowd, NULL));
    host_submit_and_wait(host);
    DM(dm_release_staging(crowd.bits));
    for (uint32_t instance = 0; instance < 3; instance++)
        read_pose(host, readback, crowd, instance, poses + instance * VERTICES * FLOATS);
    const size_t bytes = VERTICES * FLOATS * sizeof *poses;
    if (memcmp(poses, poses + VERTICES * FLOATS, bytes) != 0) fail("a head at the same level", "keeps other targets");
    if (memcmp(poses, poses + 2 * VERTICES * FLOATS, bytes) == 0) fail("a head at level 1", "keeps all targets");
    player_destroy(player);
    free(poses);
}

/* An instance that comes and plays the clip of another has its pose, bit for bit. */
static void add_to_players(const Host *host, DmEngine engine, DmMesh mesh, DmReadback readback) {
    const DmCrowdDesc desc = {.struct_size = sizeof desc, .instances = 2};
    const DmPlayback playback = {.struct_size = sizeof playback};
    float *poses = room_for(2 * VERTICES * FLOATS, sizeof *poses);
    uint32_t added = 9;
    const Player player = player_begin(host, engine, mesh, &desc, NULL);
    const DmCrowd crowd = player.crowd;
    DM(dm_crowd_remove(crowd, 1));
    DM(dm_crowd_set_time(crowd, 0.2));
    DM(dm_record_update(host->cmd, 1, &crowd, NULL));
    host_submit_and_wait(host);
    DM(dm_release_staging(crowd.bits));
    host_begin(host);
    DM(dm_crowd_add(crowd, &added));
    DM(dm_crowd_play(crowd, added, &playback));
    DM(dm_record_update(host->cmd, 1, &crowd, NULL));
    host_submit_and_wait(host);
    for (uint32_t instance = 0; instance < 2; instance++)
        read_pose(host, readback, crowd, instance, poses + instance * VERTICES * FLOATS);
    if (memcmp(poses, poses + VERTICES * FLOATS, VERTICES * FLOATS * sizeof *poses) != 0)
        fail("an instance that came", "has another pose");
    player_destroy(player);
    free(poses);
}

int main(int argc, char **argv) {
    const Host host = host_create(argc > 1 ? argv[1] : "");
    const uint32_t family = 0; /* the only one of these drivers */
    const DmEngineDesc device = {.struct_size = sizeof device, .instance = host.instance,
                                 .physical_device = host.physical, .device = host.device,
                                 .get_instance_proc_addr = vkGetInstanceProcAddr, .queue_families = &family,
                                 .queue_family_count = 1};
    DmEngine engine;
    DM(dm_engine_create(&device, &engine));
    const DmSampleDesc head = {.struct_size = sizeof head, .vertices = VERTICES, .targets = TARGETS};
    const DmMeshDesc packing = {.struct_size = sizeof packing, .delta_format = DM_DELTAS_SMALL};
    DmMeshInfo info = {.struct_size = sizeof info};
    DmMesh mesh;
    DM(dm_mesh_sample_head(&head, &packing, &mesh));
    DM(dm_mesh_info(mesh, &info));
    const char *names[TARGETS];
    for (uint32_t t = 0; t < TARGETS; t++) DM(dm_mesh_target_name(mesh, t, &names[t]));

    DmGpuMesh uploaded;
    host_begin(&host);
    DM(dm_mesh_upload(engine, host.cmd, mesh, &uploaded));
    host_submit_and_wait(&host);
    DM(dm_release_staging(uploaded.bits));

    const DmCrowdDesc desc = {.struct_size = sizeof desc, .instances = 2, .queue_family = &family,
                              .consumers = DM_READ_BY_VERTEX_ATTRIBUTES | DM_READ_BY_COPIES};
    DmCrowd crowd;
    DmWeightBounds bounds;
    DmReadback readback;
    DM(dm_crowd_create(uploaded, &desc, &crowd));
    DM(dm_crowd_remove(crowd, 1));
    DM(dm_weight_bounds_create(mesh, &desc, &bounds));
    DM(dm_readback_create(engine, &readback));
    const DmBoundClip clip = clip_bound(mesh, names);
    float *pose = room_for(VERTICES * FLOATS, sizeof *pose);
    double worst = 0;
    uint32_t added = 0;
    for (uint32_t step = 0; step < STEPS; step++) {
        const double seconds = 0.07 * step;
        float weights[TARGETS];
        DM(dm_bound_clip_sample(clip, 10 * seconds, weights, TARGETS));
        for (uint32_t t = 0; t < TARGETS; t++) {
            if (fabs(weights[t] - sampled(t, seconds)) > 1e-6) fail("a clip", "are other weights");
            if (!is_used(step, t)) weights[t] = 0;
        }
        if (step == ADDED) DM(dm_crowd_add(crowd, &added));
        host_begin(&host);
        for (uint32_t i = 0; i <= added; i++) DM(dm_crowd_set_weights(crowd, i, weights, TARGETS));
        DM(dm_record_update(host.cmd, 1, &crowd, NULL));
        host_submit_and_wait(&host);
        for (uint32_t i = 0; i <= added; i++) {
            read_pose(&host, readback, crowd, i, pose);
            worst = fmax(worst, compared(mesh, bounds, weights, pose, info.diagonal));
        }
    }
    add_to_players(&host, engine, mesh, readback);
    keep_fewer_targets(&host, engine, mesh, readback);
    printf("%d steps of %u instances, within %.1e of the diagonal\n", (int)STEPS, added + 1, worst);

    DM(dm_bound_clip_destroy(clip));
    DM(dm_readback_destroy(readback));
    DM(dm_weight_bounds_destroy(bounds));
    DM(dm_crowd_destroy(crowd));
    DM(dm_gpu_mesh_destroy(uploaded));
    DM(dm_mesh_destroy(mesh));
    DM(dm_engine_destroy(engine));
    vkDestroyCommandPool(host.device, host.pool, NULL);
    vkDestroyDevice(host.device, NULL);
    vkDestroyInstance(host.instance, NULL);
    free(pose);
    if (!(worst <= 1e-5)) fail("poses", "differ from the reference");
    return 0;
}
