/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE
#include "options.h"

#include <errno.h>
#include <getopt.h>
#include <stddef.h>
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

typedef enum { TEXT, SECONDS, INTEGER, ROLE, FLAG, HELP, VERSION } kind_t; /* those before FLAG have a value */

typedef struct {
    const char *name;
    kind_t kind;
    size_t offset;      /* of its member in options_t */
    uint64_t low, high; /* of an integer, both allowed */
} row_t;

#define MEMBER(name) offsetof(options_t, name)
static const row_t rows[] = {
    {"bus", TEXT, MEMBER(bus), 0, 0},
    {"nodes", INTEGER, MEMBER(nodes), 1, 16},
    {"role", ROLE, 0, 0, 0},
    {"virtual", FLAG, MEMBER(is_virtual), 0, 0},
    {"lockstep", FLAG, MEMBER(lockstep), 0, 0},
    {"seconds", SECONDS, MEMBER(seconds), 0, 0},
    {"seed", INTEGER, MEMBER(seed), 0, UINT64_MAX},
    {"log", TEXT, MEMBER(log), 0, 0},
    {"trace", TEXT, MEMBER(trace), 0, 0},
    {"counters", TEXT, MEMBER(counters), 0, 0},
    {"wait-clients", INTEGER, MEMBER(wait_clients), 0, 16},
    {"until-idle", FLAG, MEMBER(until_idle), 0, 0},
    {"with-parent", INTEGER, MEMBER(parent), 1, INT32_MAX},
    {"help", HELP, 0, 0, 0},
    {"version", VERSION, 0, 0, 0},
};

enum { ROWS = sizeof rows / sizeof rows[0], FIRST = 256 }; /* FIRST + i is option i; below are letters */

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

static int parse_seconds(const char *text, double *to)
{
    char *end;
    *to = strtod(text, &end);
    if (end == text || *end != '\0' || !(*to >= 0.001) || *to > 1e9) {
        return log_error("--seconds %s: not a number from 0.001 to 1e9", text);
    }
    return 0;
}

static int parse_integer(const row_t *row, const char *text, uint64_t *to)
{
    char *end;
    errno = 0;
    *to = strtoull(text, &end, 10);
    if (text[0] < '0' || text[0] > '9' || *end != '\0' || errno != 0 || *to < row->low || *to > row->high) {
        return log_error("--%s %s: not an integer from %llu to %llu", row->name, text, (unsigned long long)row->low,
                        (unsigned long long)row->high);
    }
    return 0;
}

static int parse_option(options_t *options, const row_t *row, const char *value)
{
    void *to = (char *)options + row->offset;
    switch (row->kind) {
    case TEXT: *(const char **)to = value; return 0;
    case SECONDS: return parse_seconds(value, (double *)to);
    case INTEGER: return parse_integer(row, value, (uint64_t *)to);
    case ROLE: return parse_role(options, value);
    case FLAG: *(bool *)to = true; return 0;
    case HELP: fputs(help, stdout); return 1;
    default: puts("dahl-loop " DAHL_VERSION); return 1;
    }
}

/* which: the result of getopt_long() for a word that is no option, or has no value. */
static int report_unknown(int which, const char *word)
{
    if (which == ':') {
        return log_error("%s needs a value", word);
    }
    if (optopt > 0 && optopt < FIRST) { /* one letter; its word may have more */
        return log_error("unknown option -%c; see dahl-loop --help", optopt);
    }
    return log_error("unknown option %s; see dahl-loop --help", word);
}

static int parse_all(options_t *options, int argc, char **argv)
{
    struct option known[ROWS + 1] = {{0}};
    int which, result = 0;
    for (int i = 0; i < ROWS; i++) {
        known[i] = (struct option){rows[i].name, rows[i].kind < FLAG ? required_argument : no_argument, NULL, FIRST + i};
    }
    opterr = 0;
    while (result == 0 && (which = getopt_long(argc, argv, ":", known, NULL)) != -1) {
        result = which < FIRST ? report_unknown(which, argv[optind - 1]) : parse_option(options, &rows[which - FIRST], optarg);
    }
    return result;
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
    *options = (options_t){.bus = "loopback", .run_encoder = true, .run_node = true, .seed = 1, .nodes = 1};
    int result = parse_all(options, argc, argv);
    if (result != 0) {
        return result;
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
