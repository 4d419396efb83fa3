/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE
#include "setup.h"

#include <math.h>

#include "stderr_messages.h"
#include "timing.h"

static uint32_t to_us(double ms)
{
    return (uint32_t)lround(ms * US_PER_MS);
}

static int create_node(setup_t *s, dahl_node_t *node, uint8_t number)
{
    const run_friction_t *f = &s->run->friction;
    if (models_start(node, &s->models[number], f, number, s->options->run_file) != 0) {
        return -1;
    }
    node->status_us = s->run->has_status ? to_us(s->run->status.period_ms) : 0;
    node->timeout_us = to_us(f->timeout_ms);
    node->gain = (uint32_t)lround(f->gain * DAHL_NODE_ONE);
    node->limit = (uint32_t)lround(f->limit * DAHL_NODE_ONE);
    node->ramp_us = to_us(f->ramp_ms);
    node->max_step = (uint32_t)lround(f->max_step);
    node->gain_now = node->ramp_us == 0 ? node->gain : 0;
    return 0;
}

uint8_t setup_number(const setup_t *s, uint32_t i)
{
    return (uint8_t)((uint32_t)s->run->friction.node + i);
}

static int create_nodes(setup_t *s)
{
    for (uint32_t i = 0; i < s->options->nodes; i++) {
        if (create_node(s, &s->nodes[i], setup_number(s, i)) != 0) {
            return -1;
        }
    }
    return 0;
}

static int create_plant(setup_t *s)
{
    motion_t *reference = s->run->has_control ? &s->motions[0] : NULL;
    if (!plant_open(&s->plant, s->run, reference, &s->encoders[0], s->nodes[0].params.Fc)) {
        return -1;
    }
    s->encoders[0].motion = &s->plant.motion;
    return 0;
}

static int create_encoder(setup_t *s, uint32_t i)
{
    encoder_t *encoder = &s->encoders[i];
    uint64_t seed = s->options->seed + i;
    encoder->motion = &s->motions[i];
    encoder->node = setup_number(s, i);
    if (s->run->has_motion && !motion_open(&s->motions[i], &s->run->motion, s->counts_path, seed)) {
        return -1;
    }
    if (s->run->has_load) {
        encoder->load = &s->run->load;
        encoder->load_sent = DAHL_NODE_ONE;
    }
    if (s->run->has_faults) {
        faults_open(&s->faults[i], s->run->faults, ~seed, to_us(s->run->friction.timeout_ms));
        encoder->faults = &s->faults[i];
    }
    return 0;
}

static int create_encoders(setup_t *s)
{
    s->encoder_count = (uint32_t)s->options->nodes;
    for (uint32_t i = 0; i < s->encoder_count; i++) {
        if (create_encoder(s, i) != 0) {
            return -1;
        }
    }
    return s->run->has_rotor ? create_plant(s) : 0;
}

static int check_numbers(const setup_t *s)
{
    unsigned nodes = (unsigned)s->options->nodes;
    if (setup_number(s, nodes - 1) >= DAHL_FRAMES_NODES) {
        return log_error("--nodes %u: with friction.node = %u, numbers would pass %u", nodes,
                         (unsigned)s->run->friction.node, (unsigned)DAHL_FRAMES_NODES - 1);
    }
    if (nodes > 1 && s->run->has_rotor) {
        return log_error("--nodes %u: a run with a rotor has one", nodes);
    }
    if (s->options->trace != NULL && !s->run->has_rotor) {
        return log_error("--trace %s: %s has no rotor to trace", s->options->trace, s->options->run_file);
    }
    if (s->options->trace != NULL && !s->options->run_encoder) {
        return log_error("--trace %s: --role node runs no rotor to trace", s->options->trace);
    }
    return 0;
}

static int check_roles(const setup_t *s, bool has_node, bool has_encoder)
{
    if (!has_node && !has_encoder) {
        return log_error("%s: has no %s, which this --role must run", s->options->run_file,
                         s->options->run_node ? "friction" : "motion");
    }
    if (!has_encoder && s->options->is_virtual && !(s->options->seconds > 0)) {
        return log_error("--virtual without an encoder never ends: give --seconds");
    }
    return check_numbers(s);
}

int setup_create(setup_t *s)
{
    bool has_node = s->options->run_node && s->run->has_friction;
    bool has_encoder = s->options->run_encoder && (s->run->has_motion || s->run->has_motor);
    int result = check_roles(s, has_node, has_encoder);
    if (result == 0 && s->run->has_friction) { /* an encoder of a shaft needs their Fc */
        result = create_nodes(s);
    }
    s->node_count = has_node ? (uint32_t)s->options->nodes : 0;
    if (result == 0 && has_encoder) {
        result = create_encoders(s);
    }
    return result;
}

void setup_close(setup_t *s)
{
    for (size_t i = 0; i < DAHL_FRAMES_NODES; i++) {
        motion_close(&s->motions[i]);
    }
}
