/* SPDX-License-Identifier: MIT */
/* dahl-loop: an actuator loop on a CAN bus. Read options and run file, open bus and files, run, write the results. */
#define _GNU_SOURCE
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <unistd.h>

#include "bus_open.h"
#include "counters.h"
#include "files.h"
#include "loop.h"
#include "stderr_messages.h"
#include "options.h"
#include "run_file.h"
#include "setup.h"
#include "timing.h"

enum { IDS_PER_NODE = 4, TIMER_SLACK_NS = 1000 }; /* the kernel's default slack of 50 us would delay the ticks */

typedef struct {
    options_t options;
    run_t run;
    char counts_path[FILES_PATH];
    setup_t setup;
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

/* A signal that was ignored at the start (SIGHUP under nohup) stays ignored. SIGINT is caught nevertheless: a shell ignores it
 * for programs in the background. */
static void catch_signal(int number)
{
    const struct sigaction action = {.sa_handler = on_signal};
    struct sigaction before;
    bool is_known = sigaction(number, NULL, &before) == 0;
    if (is_known && (before.sa_handler != SIG_IGN || number == SIGINT || number == SIGPIPE)) {
        sigaction(number, &action, NULL);
    }
}

/* Each signal that would terminate the program, except those of a programming error, ends the run early with whole files. */
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

/* End with the parent, also if it ended before the prctl() call. Returns 0, or prints one error line and returns an exit code
 * if `parent` runs but is another process. In a subshell ( ), $$ is the shell around it. */
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

/* All ids that the nodes and encoders receive. */
static size_t list_ids(const program_t *p, uint32_t ids[IDS_PER_NODE * DAHL_FRAMES_NODES])
{
    size_t count = 0;
    for (uint32_t i = 0; i < p->options.nodes; i++) {
        uint32_t number = setup_number(&p->setup, i);
        if (p->setup.node_count > 0) {
            ids[count++] = DAHL_FRAMES_ID_ENCODER | number;
            ids[count++] = DAHL_FRAMES_ID_PARAM_WRITE | number;
            ids[count++] = DAHL_FRAMES_ID_RESET | number;
        }
        if (p->setup.encoder_count > 0) {
            ids[count++] = DAHL_FRAMES_ID_TORQUE | number;
        }
    }
    return count;
}

static int open_outputs(program_t *p, const char *bus_name)
{
    const options_t *options = &p->options;
    if (options->log != NULL && !candump_open(&p->log, options->log, bus_name, options->is_virtual)) {
        log_error("--log %s: %s", options->log, errno == ENXIO ? "this pipe has no reader" : strerror(errno));
        return EXIT_RUNTIME;
    }
    p->loop.log = options->log != NULL ? &p->log : NULL;
    if (options->trace != NULL && !plant_trace(&p->setup.plant, options->trace)) {
        log_error("--trace %s: %s", options->trace, strerror(errno));
        return EXIT_RUNTIME;
    }
    return 0;
}

static int open_bus(program_t *p)
{
    open_bus_t opened;
    uint32_t ids[IDS_PER_NODE * DAHL_FRAMES_NODES];
    sim_clock_start(&p->clock, p->options.is_virtual);
    bool needs_all = p->options.log != NULL || p->options.is_virtual;
    bus_config_t config = {
        .spec = p->options.bus,
        .clock = sim_clock_interface(&p->clock),
        .is_patient = p->options.is_virtual,
        .ids = needs_all ? NULL : ids,
        .id_count = list_ids(p, ids),
    };
    int code = bus_open(&opened, &config);
    if (code != 0) {
        return code;
    }
    p->loop.bus = opened.bus;
    return open_outputs(p, opened.name);
}

static void configure_loop(program_t *p)
{
    const options_t *options = &p->options;
    p->loop.nodes = p->setup.nodes;
    p->loop.node_count = p->setup.node_count;
    p->loop.encoders = p->setup.encoders;
    p->loop.encoder_count = p->setup.encoder_count;
    p->loop.clock = &p->clock;
    p->loop.stop = &stop;
    p->loop.max_ticks = options->seconds > 0 ? (uint64_t)llround(options->seconds * TICKS_PER_SECOND) : UINT64_MAX;
    p->loop.wait_clients = (uint32_t)options->wait_clients;
    p->loop.until_idle = options->until_idle;
    p->loop.is_lockstep = options->lockstep;
}

static void note_cut_frames(const program_t *p)
{
    if (p->log.cut > 0) {
        log_note("--log: %llu CAN FD frames of more than 8 bytes are left out; dahl record writes them",
                 (unsigned long long)p->log.cut);
    }
}

static int close_log(program_t *p)
{
    note_cut_frames(p);
    if (p->loop.log == NULL || candump_close(&p->log)) {
        return 0;
    }
    log_error("--log %s: %s; %llu lines are missing", p->options.log,
              errno == 0 || errno == EAGAIN ? "its reader is too slow" : strerror(errno), (unsigned long long)p->log.missing);
    return EXIT_RUNTIME;
}

static int write_results(program_t *p)
{
    int code = close_log(p);
    if (p->setup.plant.trace != NULL && !plant_close(&p->setup.plant)) {
        log_error("--trace %s: %s", p->options.trace, strerror(errno));
        code = EXIT_RUNTIME;
    }
    const plant_t *plant = p->run.has_control && p->setup.encoder_count > 0 ? &p->setup.plant : NULL;
    if (p->options.counters != NULL && !counters_write(p->options.counters, &p->loop, plant)) {
        log_error("--counters %s: %s", p->options.counters, strerror(errno));
        code = EXIT_RUNTIME;
    }
    return code;
}

/* A motion that is shorter than --seconds ends the run. */
static void note_early_end(const program_t *p)
{
    const encoder_t *first = &p->setup.encoders[0];
    if (p->options.seconds > 0 && first->has_ended && !first->has_failed) {
        log_note("--seconds %g: the motion ended after %g s", p->options.seconds, loop_seconds(&p->loop));
    }
}

static int exit_code(const program_t *p)
{
    if (p->loop.is_bus_gone) {
        log_error("--bus %s: the bus is gone after %llu ticks", p->options.bus, (unsigned long long)p->loop.ticks);
        return EXIT_RUNTIME;
    }
    return p->setup.encoders[0].has_failed ? EXIT_BAD_INPUT : 0;
}

static int run(program_t *p)
{
    int code = open_bus(p);
    if (code != 0) {
        return code;
    }
    configure_loop(p);
    loop_run(&p->loop);
    note_early_end(p);
    p->loop.bus->ops->close(p->loop.bus);
    int write_code = write_results(p);
    code = exit_code(p);
    return code != 0 ? code : write_code;
}

/* Returns 0, or prints one error line and returns an exit code. */
static int prepare(program_t *p)
{
    const options_t *options = &p->options;
    if (!run_file_read(&p->run, options->run_file)) {
        return EXIT_BAD_INPUT;
    }
    bool has_counts = p->run.motion.number == MOTION_COUNTS;
    if ((has_counts && files_find_counts(p->counts_path, options->run_file, p->run.motion.file) != 0) ||
        files_check(options, p->counts_path) != 0) {
        return EXIT_BAD_INPUT;
    }
    p->setup.options = options;
    p->setup.run = &p->run;
    p->setup.counts_path = p->counts_path;
    return setup_create(&p->setup) == 0 ? 0 : EXIT_BAD_INPUT;
}

int main(int argc, char **argv)
{
    static program_t program;
    catch_signals();
    int result = options_read(&program.options, argc, argv);
    if (result != 0) {
        return result < 0 ? EXIT_BAD_INPUT : 0;
    }
    prctl(PR_SET_TIMERSLACK, (unsigned long)TIMER_SLACK_NS);
    int code = end_with_parent((uint32_t)program.options.parent);
    if (code == 0) {
        code = prepare(&program);
    }
    if (code == 0) {
        code = run(&program);
    }
    setup_close(&program.setup);
    return code;
}
