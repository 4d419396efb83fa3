/* SPDX-License-Identifier: MIT */
/* bus_open: see bus_open.h. The buses are static: large, and their pages are only touched when used. */
#include "bus_open.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "messages.h"
#include "loopback/loopback.h"
#include "socketcan/socketcan.h"
#include "socketcand/client.h"
#include "socketcand/server.h"
#include "timed_loopback/timed_loopback.h"

enum { PATIENCE_MS = 10000 };

static bool to_port(const char *text, uint16_t *port)
{
    char *end;
    unsigned long value = strtoul(text, &end, 10);
    *port = (uint16_t)value;
    return text[0] >= '0' && text[0] <= '9' && *end == '\0' && value <= 65535;
}

static int bad_spec(const char *spec)
{
    log_error("--bus %s: not loopback, socketcan:IF, socketcand:PORT or socketcand:HOST:PORT", spec);
    return EXIT_BAD_INPUT;
}

static int not_there(const char *spec, const char *hint)
{
    log_error("--bus %s: %s%s", spec, strerror(errno), hint);
    return EXIT_RUNTIME;
}

static int open_socketcan(open_bus_t *opened, const bus_wish_t *wish, const char *interface)
{
    static socketcan_t socketcan;
    if (socketcan_open(&socketcan, interface, wish->clock) != DAHL_CAN_BUS_OK) {
        return not_there(wish->spec, errno == EAFNOSUPPORT ? " (this kernel has no CAN)" : "");
    }
    if (wish->ids != NULL && socketcan_filter(&socketcan, wish->ids, wish->id_count) != DAHL_CAN_BUS_OK) {
        return not_there(wish->spec, " (its filters)");
    }
    *opened = (open_bus_t){.bus = &socketcan.bus, .name = interface};
    return 0;
}

static int serve(open_bus_t *opened, const char *spec, const char *port_text, dahl_can_clock_t clock, bool patient)
{
    static socketcand_server_t server;
    uint16_t port;
    if (!to_port(port_text, &port)) {
        return bad_spec(spec);
    }
    if (socketcand_serve(&server, port, BUS_NAME, clock) != DAHL_CAN_BUS_OK) {
        return not_there(spec, "");
    }
    server.report = log_warning;
    server.patience_ms = patient ? PATIENCE_MS : 0;
    printf("socketcand 127.0.0.1:%u %s\n", (unsigned)server.port, BUS_NAME);
    fflush(stdout);
    *opened = (open_bus_t){.bus = &server.bus, .name = BUS_NAME};
    return 0;
}

static int join(open_bus_t *opened, const char *spec, const char *host, const char *port_text, dahl_can_clock_t clock)
{
    static socketcand_member_t member;
    uint16_t port;
    if (!to_port(port_text, &port) || port == 0 || host[0] == '\0') {
        return bad_spec(spec);
    }
    if (socketcand_join(&member, host, port_text, BUS_NAME, clock) != DAHL_CAN_BUS_OK) {
        return not_there(spec, errno == EPROTO ? " (no socketcand server with bus " BUS_NAME ")" : "");
    }
    *opened = (open_bus_t){.bus = &member.bus, .name = BUS_NAME};
    return 0;
}

static int open_socketcand(open_bus_t *opened, const char *spec, const char *where, dahl_can_clock_t clock, bool patient)
{
    char host[128];
    const char *colon = strrchr(where, ':');
    if (colon == NULL) {
        return serve(opened, spec, where, clock, patient);
    }
    if ((size_t)(colon - where) >= sizeof host) {
        return bad_spec(spec);
    }
    snprintf(host, sizeof host, "%.*s", (int)(colon - where), where);
    return join(opened, spec, host, colon + 1, clock);
}

static int open_loopback(open_bus_t *opened, dahl_can_clock_t clock, uint32_t bitrate)
{
    static loopback_t loopback;
    static timed_loopback_t timed;
    if (bitrate > 0) {
        timed_loopback_open(&timed, bitrate, clock);
    } else {
        loopback_open(&loopback, clock);
    }
    *opened = (open_bus_t){.bus = bitrate > 0 ? &timed.bus : &loopback.bus, .name = BUS_NAME};
    return 0;
}

int bus_open(open_bus_t *opened, const bus_wish_t *wish)
{
    const char *spec = wish->spec;
    if (strcmp(spec, "loopback") == 0) {
        return open_loopback(opened, wish->clock, wish->bitrate);
    }
    if (strncmp(spec, "socketcan:", 10) == 0 && spec[10] != '\0') {
        return open_socketcan(opened, wish, spec + 10);
    }
    if (strncmp(spec, "socketcand:", 11) == 0) {
        return open_socketcand(opened, spec, spec + 11, wish->clock, wish->patient);
    }
    return bad_spec(spec);
}
