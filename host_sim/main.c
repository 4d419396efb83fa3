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
#include <unistd.h>

#include "bus_open.h"
#include "files.h"
#include "loop.h"
#include "messages.h"
#include "options.h"
#include "parts.h"
#include "scene.h"
#include "summary.h"

typedef struct {
    options_t options;
    scene_t scene;
    char log_path[FILES_PATH];
    parts_t parts;
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

/* What was ignored at the start (SIGHUP under nohup) stays ignored, but for Ctrl-C, which a shell ignores for what it starts in
 * the background. */
static void catch_signal(int number)
{
    const struct sigaction action = {.sa_handler = on_signal};
    struct sigaction before;
    bool known = sigaction(number, NULL, &before) == 0;
    if (known && (before.sa_handler != SIG_IGN || number == SIGINT || number == SIGPIPE)) {
        sigaction(number, &action, NULL);
    }
}

/* Every signal that ends a program and can be caught ends a run early, with whole files; those of a program gone wrong do not. */
static void catch_signals(void)
{
    static const int endings[] = {SIGHUP,  SIGINT,  SIGQUIT, SIGTERM, SIGUSR1,   SIGUSR2, SIGPIPE,  SIGALRM,
                                  SIGXCPU, SIGXFSZ, SIGIO,   SIGPROF, SIGVTALRM, SIGPWR,  SIGSTKFLT};
    for (size_t i = 0; i < sizeof endings / sizeof endings[0]; i++) {
        catch_signal(endings[i]);
    }
    for (int number = SIGRTMIN; number <= SIGRTMAX; number++) {
        catch_signal(number);
    }
}

/* Also where it ended before the kernel was asked to tell. 0, or an exit code after one error line: a process that runs and is
 * not the parent, such as $$ inside ( ), which is the shell around it. */
static int end_with_parent(uint32_t parent)
{
    if (parent == 0) {
        return 0;
    }
    prctl(PR_SET_PDEATHSIG, (unsigned long)SIGTERM);
    pid_t now = getppid();
    if (now == (pid_t)parent) {
        return 0;
    }
    if (kill((pid_t)parent, 0) == 0 || errno == EPERM) {
        log_error("--with-parent %u: this process did not start dahl-loop; %ld did", (unsigned)parent, (long)now);
        return EXIT_BAD_INPUT;
    }
    stop = 1;
    return 0;
}

/* All that these parts listen to. */
static size_t list_ids(const program_t *p, uint32_t ids[4 * DAHL_FRAMES_NODES])
{
    size_t count = 0;
    for (uint32_t i = 0; i < p->options.nodes; i++) {
        if (p->parts.node_count > 0) {
            ids[count++] = DAHL_FRAMES_ID_ENCODER | parts_number(&p->parts, i);
            ids[count++] = DAHL_FRAMES_ID_PARAM_WRITE | parts_number(&p->parts, i);
            ids[count++] = DAHL_FRAMES_ID_RESET | parts_number(&p->parts, i);
        }
        if (p->parts.encoder_count > 0) {
            ids[count++] = DAHL_FRAMES_ID_TORQUE | parts_number(&p->parts, i);
        }
    }
    return count;
}

static int open_outputs(program_t *p, const char *bus_name)
{
    const options_t *options = &p->options;
    if (options->log != NULL && !candump_open(&p->log, options->log, bus_name, options->is_virtual)) {
        log_error("--log %s: %s", options->log, errno == ENXIO ? "nobody reads this pipe" : strerror(errno));
        return EXIT_RUNTIME;
    }
    p->loop.log = options->log != NULL ? &p->log : NULL;
    if (options->trace != NULL && !plant_trace(&p->parts.plant, options->trace)) {
        log_error("--trace %s: %s", options->trace, strerror(errno));
        return EXIT_RUNTIME;
    }
    return 0;
}

static int open_bus(program_t *p)
{
    open_bus_t opened;
    uint32_t ids[4 * DAHL_FRAMES_NODES];
    sim_clock_start(&p->clock, p->options.is_virtual);
    bool all = p->options.log != NULL || p->options.is_virtual || p->options.bitrate > 0;
    bus_config_t config = {
        .spec = p->options.bus,
        .clock = sim_clock_seam(&p->clock),
        .is_patient = p->options.is_virtual,
        .bitrate = p->options.bitrate,
        .ids = all ? NULL : ids,
        .id_count = list_ids(p, ids),
    };
    int code = bus_open(&opened, &config);
    if (code != 0) {
        return code;
    }
    p->loop.bus = opened.bus;
    return open_outputs(p, opened.name);
}

static void set_up_loop(program_t *p)
{
    const options_t *options = &p->options;
    p->loop.nodes = p->parts.nodes;
    p->loop.node_count = p->parts.node_count;
    p->loop.encoders = p->parts.encoders;
    p->loop.encoder_count = p->parts.encoder_count;
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
        log_error("--log %s: %s; %llu lines are missing", p->options.log,
                  errno == 0 || errno == EAGAIN ? "its reader is too slow" : strerror(errno),
                  (unsigned long long)p->log.missing);
        code = EXIT_RUNTIME;
    }
    if (p->parts.plant.trace != NULL && !plant_close(&p->parts.plant)) {
        log_error("--trace %s: %s", p->options.trace, strerror(errno));
        code = EXIT_RUNTIME;
    }
    if (p->options.summary != NULL && !summary_write(p->options.summary, &p->options, &p->scene, &p->loop,
                                                       p->scene.has_control ? &p->parts.plant : NULL)) {
        log_error("--summary %s: %s", p->options.summary, strerror(errno));
        code = EXIT_RUNTIME;
    }
    return code;
}

/* A motion that is shorter than --seconds ends the run. */
static void note_early_end(const program_t *p)
{
    const encoder_t *first = &p->parts.encoders[0];
    if (p->options.seconds > 0 && first->ended && !first->failed) {
        char text[120];
        snprintf(text, sizeof text, "--seconds %g: the scene's motion ended after %g s", p->options.seconds,
                 (double)(p->loop.ticks * LOOP_PERIOD_NS) * 1e-9);
        log_warning(text);
    }
}

static int outcome(const program_t *p)
{
    if (p->loop.gone) {
        log_error("--bus %s: the bus is gone after %llu ticks", p->options.bus, (unsigned long long)p->loop.ticks);
        return EXIT_RUNTIME;
    }
    return p->parts.encoders[0].failed ? EXIT_BAD_INPUT : 0;
}

static int run(program_t *p)
{
    int code = open_bus(p);
    if (code != 0) {
        return code;
    }
    set_up_loop(p);
    loop_run(&p->loop);
    note_early_end(p);
    p->loop.bus->ops->close(p->loop.bus);
    int written = write_results(p);
    int ended = outcome(p);
    return ended != 0 ? ended : written;
}

/* 0, or an exit code after one error line was printed. */
static int prepare(program_t *p)
{
    const options_t *options = &p->options;
    if (!scene_read(&p->scene, options->scene, options->sets, options->set_count)) {
        return EXIT_BAD_INPUT;
    }
    if (files_find_log(p->log_path, options, &p->scene) != 0 || files_check(options, p->log_path) != 0) {
        return EXIT_BAD_INPUT;
    }
    p->parts.options = options;
    p->parts.scene = &p->scene;
    p->parts.log_path = p->log_path;
    return parts_prepare(&p->parts) == 0 ? 0 : EXIT_BAD_INPUT;
}

int main(int argc, char **argv)
{
    static program_t program;
    catch_signals();
    int answered = options_read(&program.options, argc, argv);
    if (answered != 0) {
        return answered < 0 ? EXIT_BAD_INPUT : 0;
    }
    prctl(PR_SET_TIMERSLACK, 1000L); /* ns; the default of 50 us would be seen in the ticks */
    int code = end_with_parent(program.options.parent);
    if (code == 0) {
        code = prepare(&program);
    }
    if (code == 0) {
        code = run(&program);
    }
    parts_close(&program.parts);
    return code;
}
