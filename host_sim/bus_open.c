/* SPDX-License-Identifier: MIT */
/* The buses are large and static; the kernel allocates only pages that are used. */
#include "bus_open.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stderr_messages.h"
#include "loopback/loopback.h"
#include "socketcan/socketcan.h"
#include "socketcand/client.h"
#include "socketcand/server.h"

enum {
    PATIENCE_MS = 10000, /* of a server in virtual time with a slow client */
    HOST_MAX = 127,      /* bytes of a host name */
    CHANNEL_MAX = 31     /* bytes of the name of a bus; longer than any interface of Linux */
};

/* address: the text after the scheme's colon; NULL if the spec has no colon. Returns as bus_open does. */
typedef int open_t(open_bus_t *opened, const bus_config_t *config, const char *address);

static open_t open_loopback, open_socketcan, open_socketcand;

static const struct {
    const char *name;
    open_t *open;
    const char *usage;
} schemes[] = {
    {"loopback", open_loopback, "loopback"},
    {"socketcan", open_socketcan, "socketcan:IF"},
    {"socketcand", open_socketcand, "socketcand:PORT, socketcand:HOST:PORT[/CHANNEL]"},
};

enum { SCHEMES = sizeof schemes / sizeof schemes[0] };

static int bad_spec(const char *spec)
{
    char known[160] = "";
    for (size_t i = 0, used = 0; i < SCHEMES && used < sizeof known; i++) {
        used += (size_t)snprintf(known + used, sizeof known - used, "%s%s", i > 0 ? ", " : "", schemes[i].usage);
    }
    log_error("--bus %.200s: not one of %s", spec, known);
    return EXIT_BAD_INPUT;
}

static int cannot_open(const char *spec, const char *hint)
{
    log_error("--bus %.200s: %s%s", spec, strerror(errno), hint);
    return EXIT_RUNTIME;
}

/* Name the way out if the kernel has no CAN or no such interface. */
static const char *socketcan_hint(int why)
{
    switch (why) {
    case EAFNOSUPPORT:
    case EPROTONOSUPPORT: return " (this kernel has no CAN; serve a bus with --bus socketcand:PORT, or use tools/vm.sh)";
    case ENODEV: return " (create it as root with ip link add NAME type vcan, or serve a bus with --bus socketcand:PORT)";
    default: return "";
    }
}

static bool to_port(const char *text, uint16_t *port)
{
    char *end;
    unsigned long value = strtoul(text, &end, 10);
    *port = (uint16_t)value;
    return text[0] >= '0' && text[0] <= '9' && *end == '\0' && value <= UINT16_MAX;
}

static int open_loopback(open_bus_t *opened, const bus_config_t *config, const char *address)
{
    static loopback_t loopback;
    if (address != NULL) {
        return bad_spec(config->spec);
    }
    loopback_open(&loopback, config->clock);
    *opened = (open_bus_t){.bus = &loopback.bus, .name = BUS_NAME};
    return 0;
}

static int open_socketcan(open_bus_t *opened, const bus_config_t *config, const char *address)
{
    static socketcan_t socketcan;
    if (address == NULL || address[0] == '\0') {
        return bad_spec(config->spec);
    }
    if (socketcan_open(&socketcan, address, config->clock) != DAHL_CAN_BUS_OK) {
        return cannot_open(config->spec, socketcan_hint(errno));
    }
    if (config->ids != NULL && socketcan_filter(&socketcan, config->ids, config->id_count) != DAHL_CAN_BUS_OK) {
        return cannot_open(config->spec, " (its filters)");
    }
    *opened = (open_bus_t){.bus = &socketcan.bus, .name = address};
    return 0;
}

static int serve(open_bus_t *opened, const bus_config_t *config, const char *port_text)
{
    static socketcand_server_t server;
    uint16_t port;
    if (!to_port(port_text, &port)) {
        return bad_spec(config->spec);
    }
    if (socketcand_serve(&server, port, BUS_NAME, config->clock) != DAHL_CAN_BUS_OK) {
        return cannot_open(config->spec, "");
    }
    server.report = log_warning;
    server.patience_ms = config->is_patient ? PATIENCE_MS : 0;
    printf("socketcand 127.0.0.1:%u %s\n", (unsigned)server.port, BUS_NAME);
    fflush(stdout);
    *opened = (open_bus_t){.bus = &server.bus, .name = BUS_NAME};
    return 0;
}

/* One word of the protocol. */
static bool is_channel(const char *name)
{
    size_t length = strlen(name);
    for (size_t i = 0; i < length; i++) {
        if (name[i] <= ' ' || name[i] > '~' || name[i] == '<' || name[i] == '>') {
            return false;
        }
    }
    return length > 0 && length <= CHANNEL_MAX;
}

static int join(open_bus_t *opened, const bus_config_t *config, const char *host, const char *port_text, const char *channel)
{
    static socketcand_member_t member;
    uint16_t port;
    if (!to_port(port_text, &port) || port == 0 || host[0] == '\0') {
        return bad_spec(config->spec);
    }
    if (!is_channel(channel)) {
        log_error("--bus %s: channel \"%s\": 1 to %d characters without blanks, < and > were expected", config->spec, channel,
                  CHANNEL_MAX);
        return EXIT_BAD_INPUT;
    }
    if (socketcand_join(&member, host, port_text, channel, config->clock) != DAHL_CAN_BUS_OK) {
        char hint[80];
        snprintf(hint, sizeof hint, " (no socketcand server with bus %s)", channel);
        return cannot_open(config->spec, errno == EPROTO ? hint : "");
    }
    *opened = (open_bus_t){.bus = &member.bus, .name = channel};
    return 0;
}

/* PORT serves a bus, HOST:PORT and HOST:PORT/CHANNEL join one. */
static int open_socketcand(open_bus_t *opened, const bus_config_t *config, const char *address)
{
    char host[HOST_MAX + sizeof ":65535"];
    size_t length = address != NULL ? strcspn(address, "/") : 0;
    if (address == NULL || length >= sizeof host) {
        return bad_spec(config->spec);
    }
    snprintf(host, sizeof host, "%.*s", (int)length, address);
    char *colon = strrchr(host, ':');
    if (colon == NULL) {
        return serve(opened, config, address);
    }
    if (colon - host > HOST_MAX) {
        return bad_spec(config->spec);
    }
    *colon = '\0';
    return join(opened, config, host, colon + 1, address[length] == '/' ? address + length + 1 : BUS_NAME);
}

int bus_open(open_bus_t *opened, const bus_config_t *config)
{
    const char *colon = strchr(config->spec, ':');
    size_t length = colon != NULL ? (size_t)(colon - config->spec) : strlen(config->spec);
    for (size_t i = 0; i < SCHEMES; i++) {
        if (strlen(schemes[i].name) == length && strncmp(schemes[i].name, config->spec, length) == 0) {
            return schemes[i].open(opened, config, colon != NULL ? colon + 1 : NULL);
        }
    }
    return bad_spec(config->spec);
}
