/* SPDX-License-Identifier: MIT */
/* bus_choice: see bus_choice.h. The buses are static: large, and their pages are only touched when used. */
#include "bus_choice.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "complain.h"
#include "loopback/loopback.h"
#include "socketcan/socketcan.h"
#include "socketcand/client.h"
#include "socketcand/server.h"
#include "wire.h"

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
    complain("--bus %s: not loopback, socketcan:IF, socketcand:PORT or socketcand:HOST:PORT", spec);
    return EXIT_BAD_INPUT;
}

static int not_there(const char *spec, const char *hint)
{
    complain("--bus %s: %s%s", spec, strerror(errno), hint);
    return EXIT_RUNTIME;
}

static int open_socketcan(bus_choice_t *choice, const bus_wish_t *wish, const char *interface)
{
    static socketcan_t socketcan;
    if (socketcan_open(&socketcan, interface, wish->clock) != CAN_BUS_OK) {
        return not_there(wish->spec, errno == EAFNOSUPPORT ? " (this kernel has no CAN)" : "");
    }
    if (wish->ids != NULL && socketcan_filter(&socketcan, wish->ids, wish->id_count) != CAN_BUS_OK) {
        return not_there(wish->spec, " (its filters)");
    }
    *choice = (bus_choice_t){.bus = &socketcan.bus, .name = interface};
    return 0;
}

static int serve(bus_choice_t *choice, const char *spec, const char *port_text, can_clock_t clock, bool patient)
{
    static socketcand_server_t server;
    uint16_t port;
    if (!to_port(port_text, &port)) {
        return bad_spec(spec);
    }
    if (socketcand_serve(&server, port, BUS_NAME, clock) != CAN_BUS_OK) {
        return not_there(spec, "");
    }
    server.report = remark;
    server.patience_ms = patient ? PATIENCE_MS : 0;
    printf("socketcand 127.0.0.1:%u %s\n", (unsigned)server.port, BUS_NAME);
    fflush(stdout);
    *choice = (bus_choice_t){.bus = &server.bus, .name = BUS_NAME};
    return 0;
}

static int join(bus_choice_t *choice, const char *spec, const char *host, const char *port_text, can_clock_t clock)
{
    static socketcand_member_t member;
    uint16_t port;
    if (!to_port(port_text, &port) || port == 0 || host[0] == '\0') {
        return bad_spec(spec);
    }
    if (socketcand_join(&member, host, port_text, BUS_NAME, clock) != CAN_BUS_OK) {
        return not_there(spec, errno == EPROTO ? " (no socketcand server with bus " BUS_NAME ")" : "");
    }
    *choice = (bus_choice_t){.bus = &member.bus, .name = BUS_NAME};
    return 0;
}

static int open_socketcand(bus_choice_t *choice, const char *spec, const char *where, can_clock_t clock, bool patient)
{
    char host[128];
    const char *colon = strrchr(where, ':');
    if (colon == NULL) {
        return serve(choice, spec, where, clock, patient);
    }
    if ((size_t)(colon - where) >= sizeof host) {
        return bad_spec(spec);
    }
    snprintf(host, sizeof host, "%.*s", (int)(colon - where), where);
    return join(choice, spec, host, colon + 1, clock);
}

static int open_loopback(bus_choice_t *choice, can_clock_t clock, uint32_t bitrate)
{
    static loopback_t loopback;
    static wire_t wire;
    if (bitrate > 0) {
        wire_open(&wire, bitrate, clock);
    } else {
        loopback_open(&loopback, clock);
    }
    *choice = (bus_choice_t){.bus = bitrate > 0 ? &wire.bus : &loopback.bus, .name = BUS_NAME};
    return 0;
}

int bus_choose(bus_choice_t *choice, const bus_wish_t *wish)
{
    const char *spec = wish->spec;
    if (strcmp(spec, "loopback") == 0) {
        return open_loopback(choice, wish->clock, wish->bitrate);
    }
    if (strncmp(spec, "socketcan:", 10) == 0 && spec[10] != '\0') {
        return open_socketcan(choice, wish, spec + 10);
    }
    if (strncmp(spec, "socketcand:", 11) == 0) {
        return open_socketcand(choice, spec, spec + 11, wish->clock, wish->patient);
    }
    return bad_spec(spec);
}
