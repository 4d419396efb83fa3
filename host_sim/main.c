/* SPDX-License-Identifier: MIT */
/* dahl-loop: an actuator loop on a CAN bus. Reads what is to run, opens what that needs, runs it, and writes what came
 * of it: each step in a function, undone in reverse order. */
#define _GNU_SOURCE
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>

#include "bus_open.h"
#include "messages.h"
#include "loop.h"
#include "options.h"
#include "plant.h"
#include "scene.h"
#include "summary.h"

static const double DESK_TIMEOUT_MS = 1000;

typedef struct {
    options_t options;
    scene_t scene;
    char log_path[1024];
    node_t nodes[FRAMES_NODES];
    motion_t motions[FRAMES_NODES];
    encoder_t encoders[FRAMES_NODES];
    faults_t faults[FRAMES_NODES];
    plant_t plant;
    candump_t log;
    sim_clock_t clock;
    loop_t loop;
} program_t;

static volatile sig_atomic_t stop;

static void on_signal(int number)
{
    (void)number;
    stop = 1;
}

static void catch_signals(void)
{
    struct sigaction action = {.sa_handler = on_signal};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
    prctl(PR_SET_TIMERSLACK, 1000L); /* ns; the default of 50 us would be seen in the beat */
}

/* Length of the folder part of a path, without its last slash. */
static int folder_length(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL ? 0 : (int)(slash - path);
}

/* Where the scene's log file is: as --log-file says, or in --data DIR, or beside the scene file. */
static int find_log(program_t *p)
{
    const options_t *options = &p->options;
    const char *file = options->log_file != NULL ? options->log_file : p->scene.motion.file;
    const char *folder = options->data != NULL ? options->data : options->scene;
    int length = options->data != NULL ? (int)strlen(folder) : folder_length(folder);
    if (options->log_file != NULL || file[0] == '/') {
        length = 0;
    }
    length = snprintf(p->log_path, sizeof p->log_path, "%.*s%s%s", length, folder, length > 0 ? "/" : "", file);
    return length < (int)sizeof p->log_path ? 0 : log_error("%s: path too long", file);
}

static uint32_t to_us(double ms)
{
    return (uint32_t)lround(ms * 1000);
}

static uint32_t timeout_us(const program_t *p)
{
    double given = p->scene.friction.timeout_ms;
    return to_us(given > 0 ? given : DESK_TIMEOUT_MS);
}

static int prepare_node(program_t *p, node_t *node, uint8_t number)
{
    const scene_friction_t *f = &p->scene.friction;
    dahl_params_t params = {(float)f->sigma0, (float)f->Fc, (float)f->theta_per_count};
    dahl_err_t result = node_init(node, &params, number);
    if (result != DAHL_OK) {
        return log_error("%s: [friction] sigma0 = %.9g, Fc = %.9g, theta_per_count = %.9g: dahl_prepare refuses (%d)",
                        p->options.scene, f->sigma0, f->Fc, f->theta_per_count, (int)result);
    }
    node->status_us = p->scene.has_status ? to_us(p->scene.status_period_ms) : 0;
    node->timeout_us = timeout_us(p);
    node->gain = (uint32_t)lround(f->gain * NODE_ONE);
    node->limit = (uint32_t)lround(f->limit * NODE_ONE);
    node->ramp_us = to_us(f->ramp_ms);
    node->max_step = (uint32_t)lround(f->max_step);
    node->gain_now = node->ramp_us == 0 ? node->gain : 0;
    return 0;
}

static uint8_t number_of(const program_t *p, uint32_t i)
{
    return (uint8_t)((uint32_t)p->scene.friction.node + i);
}

static int prepare_nodes(program_t *p)
{
    p->loop.nodes = p->nodes;
    p->loop.node_count = p->options.nodes;
    for (uint32_t i = 0; i < p->options.nodes; i++) {
        if (prepare_node(p, &p->nodes[i], number_of(p, i)) != 0) {
            return -1;
        }
    }
    return 0;
}

static int prepare_plant(program_t *p)
{
    motion_t *reference = p->scene.has_control ? &p->motions[0] : NULL;
    if (!plant_open(&p->plant, &p->scene, reference, &p->encoders[0])) {
        return -1;
    }
    if (p->options.trace != NULL && !plant_trace(&p->plant, p->options.trace)) {
        return log_error("--trace %s: %s", p->options.trace, strerror(errno));
    }
    p->encoders[0].motion = &p->plant.motion;
    return 0;
}

static int prepare_encoder(program_t *p, uint32_t i)
{
    encoder_t *encoder = &p->encoders[i];
    uint64_t seed = p->options.seed + i;
    encoder->motion = &p->motions[i];
    encoder->node = number_of(p, i);
    if (p->scene.has_motion && !motion_open(&p->motions[i], &p->scene.motion, p->log_path, seed)) {
        return -1;
    }
    if (p->scene.has_faults) {
        faults_open(&p->faults[i], p->scene.faults, ~seed, timeout_us(p));
        encoder->faults = &p->faults[i];
    }
    return 0;
}

static int prepare_encoders(program_t *p)
{
    if (p->scene.has_motion && p->scene.motion.kind == MOTION_LOG && find_log(p) != 0) {
        return -1;
    }
    p->loop.encoders = p->encoders;
    p->loop.encoder_count = p->options.nodes;
    for (uint32_t i = 0; i < p->options.nodes; i++) {
        if (prepare_encoder(p, i) != 0) {
            return -1;
        }
    }
    return p->scene.has_rotor ? prepare_plant(p) : 0;
}

static int check_numbers(const program_t *p)
{
    unsigned nodes = p->options.nodes;
    if (number_of(p, nodes - 1) >= FRAMES_NODES) {
        return log_error("--nodes %u: with the scene's first node %u, numbers would pass 15", nodes,
                        (unsigned)p->scene.friction.node);
    }
    if (nodes > 1 && p->scene.has_rotor) {
        return log_error("--nodes %u: a scene with a [rotor] has one", nodes);
    }
    if (p->options.trace != NULL && !p->scene.has_rotor) {
        return log_error("--trace %s: %s has no [rotor] to trace", p->options.trace, p->options.scene);
    }
    return 0;
}

static int check_parts(const program_t *p, bool node, bool encoder)
{
    if (!node && !encoder) {
        return log_error("%s: names no [%s], so there is nothing to run for this --role", p->options.scene,
                        p->options.run_node ? "friction" : "motion");
    }
    if (!encoder && p->options.is_virtual && !(p->options.seconds > 0)) {
        return log_error("--virtual without an encoder never ends: give --seconds");
    }
    return check_numbers(p);
}

static int prepare_parts(program_t *p)
{
    bool node = p->options.run_node && p->scene.has_friction;
    bool encoder = p->options.run_encoder && (p->scene.has_motion || p->scene.has_motor);
    int result = check_parts(p, node, encoder);
    if (result == 0 && node) {
        result = prepare_nodes(p);
    }
    if (result == 0 && encoder) {
        result = prepare_encoders(p);
    }
    return result;
}

/* All that these parts listen to. */
static size_t list_ids(const program_t *p, uint32_t ids[4 * FRAMES_NODES])
{
    size_t count = 0;
    for (uint32_t i = 0; i < p->options.nodes; i++) {
        if (p->loop.node_count > 0) {
            ids[count++] = FRAMES_ID_ENCODER | number_of(p, i);
            ids[count++] = FRAMES_ID_PARAM_WRITE | number_of(p, i);
            ids[count++] = FRAMES_ID_RESET | number_of(p, i);
        }
        if (p->loop.encoder_count > 0) {
            ids[count++] = FRAMES_ID_TORQUE | number_of(p, i);
        }
    }
    return count;
}

static int open_bus(program_t *p)
{
    open_bus_t opened;
    uint32_t ids[4 * FRAMES_NODES];
    sim_clock_start(&p->clock, p->options.is_virtual);
    bool all = p->options.log != NULL || p->options.is_virtual || p->options.bitrate > 0;
    bus_wish_t wish = {
        .spec = p->options.bus,
        .clock = sim_clock_seam(&p->clock),
        .patient = p->options.is_virtual,
        .bitrate = p->options.bitrate,
        .ids = all ? NULL : ids,
        .id_count = list_ids(p, ids),
    };
    int code = bus_open(&opened, &wish);
    if (code != 0) {
        return code;
    }
    p->loop.bus = opened.bus;
    if (p->options.log != NULL && !candump_open(&p->log, p->options.log, opened.name)) {
        log_error("--log %s: %s", p->options.log, strerror(errno));
        return EXIT_RUNTIME;
    }
    p->loop.log = p->options.log != NULL ? &p->log : NULL;
    return 0;
}

static void set_up_loop(program_t *p)
{
    const options_t *options = &p->options;
    p->loop.clock = &p->clock;
    p->loop.stop = &stop;
    p->loop.max_ticks = options->seconds > 0 ? (uint64_t)llround(options->seconds * 1000) : UINT64_MAX;
    p->loop.wait_clients = options->wait_clients;
    p->loop.until_idle = options->until_idle;
    p->loop.lockstep = options->lockstep;
    p->loop.bitrate = options->bitrate;
    p->loop.paced = options->bitrate > 0 && strcmp(options->bus, "loopback") == 0;
}

static int write_results(program_t *p)
{
    int code = 0;
    if (p->loop.log != NULL && !candump_close(&p->log)) {
        log_error("--log %s: %s", p->options.log, strerror(errno));
        code = EXIT_RUNTIME;
    }
    if (p->plant.trace != NULL && !plant_close(&p->plant)) {
        log_error("--trace %s: it could not be written whole", p->options.trace);
        code = EXIT_RUNTIME;
    }
    if (p->options.summary != NULL && !summary_write(p->options.summary, &p->options, &p->scene, &p->loop,
                                                       p->scene.has_control ? &p->plant : NULL)) {
        log_error("--summary %s: %s", p->options.summary, strerror(errno));
        code = EXIT_RUNTIME;
    }
    return code;
}

static int outcome(const program_t *p)
{
    if (p->loop.gone) {
        log_error("--bus %s: the bus is gone after %llu ticks", p->options.bus, (unsigned long long)p->loop.ticks);
        return EXIT_RUNTIME;
    }
    return p->encoders[0].failed ? EXIT_BAD_INPUT : 0;
}

static int run(program_t *p)
{
    int code = open_bus(p);
    if (code != 0) {
        return code;
    }
    set_up_loop(p);
    loop_run(&p->loop);
    p->loop.bus->ops->close(p->loop.bus);
    int written = write_results(p);
    int ended = outcome(p);
    return ended != 0 ? ended : written;
}

int main(int argc, char **argv)
{
    static program_t program;
    int answered = options_read(&program.options, argc, argv);
    if (answered != 0) {
        return answered < 0 ? EXIT_BAD_INPUT : 0;
    }
    if (!scene_read(&program.scene, program.options.scene, program.options.sets, program.options.set_count)) {
        return EXIT_BAD_INPUT;
    }
    catch_signals();
    int code = prepare_parts(&program) != 0 ? EXIT_BAD_INPUT : run(&program);
    for (size_t i = 0; i < FRAMES_NODES; i++) {
        motion_close(&program.motions[i]);
    }
    return code;
}
