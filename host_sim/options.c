/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE
#include "options.h"

#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stderr_messages.h"
#include "dahl.h"

#define SOCKETCAND "socketcand:"

static const char help[] =
    "usage: dahl-loop RUN_FILE [options]\n"
    "Run an actuator loop on a CAN bus: an encoder sends counts at 1 kHz, a friction node answers each with a torque.\n"
    "\n"
    "  RUN_FILE           lines section.key = value; host_sim/steering.run is an example, host_sim/keys.csv lists all keys.\n"
    "                     Only parts with a key run. `dahl loop --scene NAME` makes it from a scene\n"
    "  --bus SPEC         loopback (default)      inside this process\n"
    "                     socketcan:IF            a CAN interface of the kernel, e.g. socketcan:vcan0\n"
    "                     socketcand:PORT         serve up to 16 python-can clients on 127.0.0.1:PORT, bus vcan0; 0: any\n"
    "                                             free port; a client that is not in raw mode after 5 s is dropped\n"
    "                     socketcand:HOST:PORT    join such a server; PORT/CHANNEL names its bus if it is not vcan0\n"
    "  --nodes N          N encoders and N nodes, 1 to 16; numbers start at friction.node, each has its own seed\n"
    "  --role ROLE        both (default), encoder or node: the part of the loop that this process runs\n"
    "  --virtual          virtual time: as fast as possible; the same seed gives the same log, byte for byte\n"
    "  --lockstep         an encoder waits for each answer, a node's clock for each count, 2 s at most, so that neither a\n"
    "                     slow node nor a busy machine loses frames\n"
    "  --seconds S        end after S seconds of ticks, or earlier with the motion\n"
    "  --seed N           seed of random motions and faults (default 1)\n"
    "  --log FILE         write each frame of the bus as candump -L does; if the reader of a pipe is too slow, whole lines\n"
    "                     are omitted and counted, and the exit code is 1; CAN FD frames of more than 8 bytes are left out\n"
    "                     and counted\n"
    "  --trace FILE       write angle, velocity and torques of the rotor as CSV, a row each tick\n"
    "  --counters FILE    write all counters as lines key = value; - for stdout, after the line with the port of a served bus\n"
    "  --wait-clients N   start when N clients are on the served bus\n"
    "  --until-idle       end when all clients of the served bus have left\n"
    "  --with-parent PID  end when process PID, which started this one, has ended ($$ in a shell)\n"
    "  --help, --version\n"
    "\n"
    "SIGINT (Ctrl-C), SIGTERM, SIGHUP and similar signals end a run early, with whole files. Exit code: 0; 1 if the bus or a\n"
    "file failed; 2 for bad input. Example, from the project's folder; it waits for its first client and ends with its last:\n"
    "  build/host/host_sim/dahl-loop host_sim/steering.run --bus socketcand:28600 --wait-clients 1 --until-idle &\n";

enum { OPTION_FIRST = 256, BUS, NODES, ROLE, VIRTUAL, LOCKSTEP, SECONDS, SEED, LOG, TRACE, COUNTERS, WAIT, IDLE, PARENT, HELP,
       VERSION };

static const struct option long_options[] = {
    {"bus", required_argument, NULL, BUS},           {"nodes", required_argument, NULL, NODES},
    {"role", required_argument, NULL, ROLE},         {"virtual", no_argument, NULL, VIRTUAL},
    {"lockstep", no_argument, NULL, LOCKSTEP},       {"seconds", required_argument, NULL, SECONDS},
    {"seed", required_argument, NULL, SEED},         {"log", required_argument, NULL, LOG},
    {"trace", required_argument, NULL, TRACE},       {"counters", required_argument, NULL, COUNTERS},
    {"wait-clients", required_argument, NULL, WAIT}, {"until-idle", no_argument, NULL, IDLE},
    {"with-parent", required_argument, NULL, PARENT}, {"help", no_argument, NULL, HELP},
    {"version", no_argument, NULL, VERSION},         {NULL, 0, NULL, 0},
};

static int parse_role(options_t *options, const char *text)
{
    bool is_both = strcmp(text, "both") == 0;
    options->run_encoder = is_both || strcmp(text, "encoder") == 0;
    options->run_node = is_both || strcmp(text, "node") == 0;
    if (!options->run_encoder && !options->run_node) {
        return log_error("--role %s: not one of both, encoder, node", text);
    }
    return 0;
}

static int parse_seconds(options_t *options, const char *text)
{
    char *end;
    options->seconds = strtod(text, &end);
    if (end == text || *end != '\0' || !(options->seconds >= 0.001) || options->seconds > 1e9) {
        return log_error("--seconds %s: not a number from 0.001 to 1e9", text);
    }
    return 0;
}

static int parse_integer(const char *name, const char *text, uint64_t low, uint64_t high, uint64_t *to)
{
    char *end;
    errno = 0;
    *to = strtoull(text, &end, 10);
    if (text[0] < '0' || text[0] > '9' || *end != '\0' || errno != 0 || *to < low || *to > high) {
        return log_error("--%s %s: not an integer from %llu to %llu", name, text, (unsigned long long)low,
                        (unsigned long long)high);
    }
    return 0;
}

static int parse_uint32(const char *name, const char *text, uint32_t low, uint32_t high, uint32_t *to)
{
    uint64_t value = 0;
    int result = parse_integer(name, text, low, high, &value);
    *to = (uint32_t)value;
    return result;
}

static int parse_flag(options_t *options, int which)
{
    switch (which) {
    case VIRTUAL:
        options->is_virtual = true;
        return 0;
    case IDLE:
        options->until_idle = true;
        return 0;
    case LOCKSTEP:
        options->lockstep = true;
        return 0;
    case HELP:
        fputs(help, stdout);
        return 1;
    case VERSION:
        puts("dahl-loop " DAHL_VERSION);
        return 1;
    default:
        return -1;
    }
}

static int parse_value(options_t *options, int which, const char *value)
{
    switch (which) {
    case ROLE:
        return parse_role(options, value);
    case SECONDS:
        return parse_seconds(options, value);
    case SEED:
        return parse_integer("seed", value, 0, UINT64_MAX, &options->seed);
    case WAIT:
        return parse_uint32("wait-clients", value, 0, 16, &options->wait_clients);
    case NODES:
        return parse_uint32("nodes", value, 1, 16, &options->nodes);
    case PARENT:
        return parse_uint32("with-parent", value, 1, INT32_MAX, &options->parent);
    default:
        return parse_flag(options, which);
    }
}

/* The value of an option that is plain text; NULL for other options. */
static const char **text_of(options_t *options, int which)
{
    switch (which) {
    case BUS:
        return &options->bus;
    case LOG:
        return &options->log;
    case COUNTERS:
        return &options->counters;
    case TRACE:
        return &options->trace;
    default:
        return NULL;
    }
}

static int parse_option(options_t *options, int which, char **argv)
{
    const char **text = text_of(options, which);
    if (which == ':') {
        return log_error("%s needs a value", argv[optind - 1]);
    }
    if (which == '?' && optopt > 0 && optopt < OPTION_FIRST) { /* one letter; its word may have more */
        return log_error("unknown option -%c; see dahl-loop --help", optopt);
    }
    if (which == '?') {
        return log_error("unknown option %s; see dahl-loop --help", argv[optind - 1]);
    }
    if (text != NULL) {
        *text = optarg;
        return 0;
    }
    return parse_value(options, which, optarg);
}

static bool is_socketcand(const options_t *options)
{
    return strncmp(options->bus, SOCKETCAND, strlen(SOCKETCAND)) == 0;
}

static bool is_server(const options_t *options)
{
    return is_socketcand(options) && strchr(options->bus + strlen(SOCKETCAND), ':') == NULL;
}

static int check_virtual(const options_t *options)
{
    if (options->is_virtual && options->lockstep) {
        return log_error("--lockstep is for real time; --virtual always waits for answers");
    }
    if (options->is_virtual && is_socketcand(options) && !is_server(options)) {
        return log_error("--virtual needs a bus whose order this process controls: loopback, socketcan:IF or socketcand:PORT,"
                        " not %s", options->bus);
    }
    return 0;
}

static int check(const options_t *options)
{
    if ((options->wait_clients > 0 || options->until_idle) && !is_server(options)) {
        return log_error("--wait-clients and --until-idle need --bus socketcand:PORT, not %s", options->bus);
    }
    return check_virtual(options);
}

int options_read(options_t *options, int argc, char **argv)
{
    int which;
    *options = (options_t){.bus = "loopback", .run_encoder = true, .run_node = true, .seed = 1, .nodes = 1};
    opterr = 0;
    while ((which = getopt_long(argc, argv, ":", long_options, NULL)) != -1) {
        int result = parse_option(options, which, argv);
        if (result != 0) {
            return result;
        }
    }
    if (optind == argc) {
        return log_error("no RUN_FILE; see dahl-loop --help");
    }
    options->run_file = argv[optind++];
    if (optind < argc) {
        return log_error("unexpected argument %s; see dahl-loop --help", argv[optind]);
    }
    return check(options);
}
