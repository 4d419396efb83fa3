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

#include "bus_choice.h"
#include "complain.h"
#include "loop.h"
#include "options.h"
#include "scene.h"
#include "summary.h"

static const double DESK_TIMEOUT_MS = 1000;

typedef struct {
    options_t options;
    scene_t scene;
    char log_path[1024];
    dahl_plan_t plan;
    node_t node;
    motion_t motion;
    encoder_t encoder;
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
    return length < (int)sizeof p->log_path ? 0 : complain("%s: path too long", file);
}

static int prepare_node(program_t *p)
{
    const scene_friction_t *f = &p->scene.friction;
    dahl_params_t params = {(float)f->sigma0, (float)f->Fc, (float)f->theta_per_count};
    dahl_err_t result = dahl_prepare(&p->plan, &params);
    if (result != DAHL_OK) {
        return complain("%s: [friction] sigma0 = %.9g, Fc = %.9g, theta_per_count = %.9g: dahl_prepare refuses (%d)",
                        p->options.scene, f->sigma0, f->Fc, f->theta_per_count, (int)result);
    }
    node_init(&p->node, &p->plan, (uint8_t)f->node);
    p->node.status_us = p->scene.has_status ? (uint32_t)lround(p->scene.status_period_ms * 1000) : 0;
    p->node.timeout_us = (uint32_t)lround((f->timeout_ms > 0 ? f->timeout_ms : DESK_TIMEOUT_MS) * 1000);
    p->loop.node = &p->node;
    return 0;
}

static int prepare_encoder(program_t *p)
{
    if (p->scene.motion.kind == MOTION_LOG && find_log(p) != 0) {
        return -1;
    }
    if (!motion_open(&p->motion, &p->scene.motion, p->log_path, p->options.seed)) {
        return -1;
    }
    p->encoder.motion = &p->motion;
    p->encoder.node = (uint8_t)p->scene.friction.node;
    p->loop.encoder = &p->encoder;
    return 0;
}

static int check_parts(const program_t *p, bool node, bool encoder)
{
    if (!node && !encoder) {
        return complain("%s: names no [%s], so there is nothing to run for this --role", p->options.scene,
                        p->options.run_node ? "friction" : "motion");
    }
    if (!encoder && p->options.is_virtual && !(p->options.seconds > 0)) {
        return complain("--virtual without an encoder never ends: give --seconds");
    }
    return 0;
}

static int prepare_parts(program_t *p)
{
    bool node = p->options.run_node && p->scene.has_friction;
    bool encoder = p->options.run_encoder && p->scene.has_motion;
    int result = check_parts(p, node, encoder);
    if (result == 0 && node) {
        result = prepare_node(p);
    }
    if (result == 0 && encoder) {
        result = prepare_encoder(p);
    }
    return result;
}

static int open_bus(program_t *p)
{
    bus_choice_t choice;
    sim_clock_start(&p->clock, p->options.is_virtual);
    int code = bus_choose(&choice, p->options.bus, sim_clock_seam(&p->clock), p->options.is_virtual);
    if (code != 0) {
        return code;
    }
    p->loop.bus = choice.bus;
    if (p->options.log != NULL && !candump_open(&p->log, p->options.log, choice.name)) {
        complain("--log %s: %s", p->options.log, strerror(errno));
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
}

static int write_results(program_t *p)
{
    int code = 0;
    if (p->loop.log != NULL && !candump_close(&p->log)) {
        complain("--log %s: %s", p->options.log, strerror(errno));
        code = EXIT_RUNTIME;
    }
    if (p->options.summary != NULL && !summary_write(p->options.summary, &p->options, &p->scene, &p->loop)) {
        complain("--summary %s: %s", p->options.summary, strerror(errno));
        code = EXIT_RUNTIME;
    }
    return code;
}

static int outcome(const program_t *p)
{
    if (p->loop.gone) {
        complain("--bus %s: the bus is gone after %llu ticks", p->options.bus, (unsigned long long)p->loop.ticks);
        return EXIT_RUNTIME;
    }
    return p->encoder.failed ? EXIT_BAD_INPUT : 0;
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
    if (!scene_read(&program.scene, program.options.scene)) {
        return EXIT_BAD_INPUT;
    }
    catch_signals();
    int code = prepare_parts(&program) != 0 ? EXIT_BAD_INPUT : run(&program);
    motion_close(&program.motion);
    return code;
}
