/* SPDX-License-Identifier: MIT */
/* parts: see parts.h. */
#define _GNU_SOURCE
#include "parts.h"

#include <math.h>

#include "messages.h"

static uint32_t to_us(double ms)
{
    return (uint32_t)lround(ms * 1000);
}

static uint32_t timeout_us(const parts_t *p)
{
    double given = p->scene->friction.timeout_ms;
    return given > 0 ? to_us(given) : DAHL_NODE_TIMEOUT_US;
}

static int prepare_node(parts_t *p, dahl_node_t *node, uint8_t number)
{
    const scene_friction_t *f = &p->scene->friction;
    dahl_params_t params = {(float)f->sigma0, (float)f->Fc, (float)f->theta_per_count};
    dahl_err_t result = dahl_node_init(node, &params, number);
    if (result == DAHL_OK) {
        result = models_use(node, &p->models[number], f);
    }
    if (result != DAHL_OK) {
        return log_error("%s: [friction] sigma0 = %.9g, Fc = %.9g, theta_per_count = %.9g: dahl_prepare refuses (%d)",
                        p->options->scene, f->sigma0, f->Fc, f->theta_per_count, (int)result);
    }
    node->status_us = p->scene->has_status ? to_us(p->scene->status_period_ms) : 0;
    node->timeout_us = timeout_us(p);
    node->gain = (uint32_t)lround(f->gain * DAHL_NODE_ONE);
    node->limit = (uint32_t)lround(f->limit * DAHL_NODE_ONE);
    node->ramp_us = to_us(f->ramp_ms);
    node->max_step = (uint32_t)lround(f->max_step);
    node->gain_now = node->ramp_us == 0 ? node->gain : 0;
    return 0;
}

uint8_t parts_number(const parts_t *p, uint32_t i)
{
    return (uint8_t)((uint32_t)p->scene->friction.node + i);
}

static int prepare_nodes(parts_t *p)
{
    p->node_count = p->options->nodes;
    for (uint32_t i = 0; i < p->options->nodes; i++) {
        if (prepare_node(p, &p->nodes[i], parts_number(p, i)) != 0) {
            return -1;
        }
    }
    return 0;
}

static int prepare_plant(parts_t *p)
{
    motion_t *reference = p->scene->has_control ? &p->motions[0] : NULL;
    if (!plant_open(&p->plant, p->scene, reference, &p->encoders[0])) {
        return -1;
    }
    p->encoders[0].motion = &p->plant.motion;
    return 0;
}

static int prepare_encoder(parts_t *p, uint32_t i)
{
    encoder_t *encoder = &p->encoders[i];
    uint64_t seed = p->options->seed + i;
    encoder->motion = &p->motions[i];
    encoder->node = parts_number(p, i);
    if (p->scene->has_motion && !motion_open(&p->motions[i], &p->scene->motion, p->log_path, p->scene->load.column, seed)) {
        return -1;
    }
    if (p->scene->has_load) {
        encoder->load = &p->scene->load;
        encoder->load_told = DAHL_NODE_ONE;
    }
    if (p->scene->has_faults) {
        faults_open(&p->faults[i], p->scene->faults, ~seed, timeout_us(p));
        encoder->faults = &p->faults[i];
    }
    return 0;
}

static int prepare_encoders(parts_t *p)
{
    p->encoder_count = p->options->nodes;
    for (uint32_t i = 0; i < p->options->nodes; i++) {
        if (prepare_encoder(p, i) != 0) {
            return -1;
        }
    }
    return p->scene->has_rotor ? prepare_plant(p) : 0;
}

static int check_numbers(const parts_t *p)
{
    unsigned nodes = p->options->nodes;
    if (parts_number(p, nodes - 1) >= DAHL_FRAMES_NODES) {
        return log_error("--nodes %u: with the scene's first node %u, numbers would pass 15", nodes,
                        (unsigned)p->scene->friction.node);
    }
    if (nodes > 1 && p->scene->has_rotor) {
        return log_error("--nodes %u: a scene with a [rotor] has one", nodes);
    }
    if (p->options->trace != NULL && !p->scene->has_rotor) {
        return log_error("--trace %s: %s has no [rotor] to trace", p->options->trace, p->options->scene);
    }
    if (p->options->trace != NULL && !p->options->run_encoder) {
        return log_error("--trace %s: --role node runs no [rotor] to trace", p->options->trace);
    }
    return 0;
}

static int check_parts(const parts_t *p, bool node, bool encoder)
{
    if (!node && !encoder) {
        return log_error("%s: names no [%s], so there is nothing to run for this --role", p->options->scene,
                        p->options->run_node ? "friction" : "motion");
    }
    if (!encoder && p->options->is_virtual && !(p->options->seconds > 0)) {
        return log_error("--virtual without an encoder never ends: give --seconds");
    }
    return check_numbers(p);
}

int parts_prepare(parts_t *p)
{
    bool node = p->options->run_node && p->scene->has_friction;
    bool encoder = p->options->run_encoder && (p->scene->has_motion || p->scene->has_motor);
    int result = check_parts(p, node, encoder);
    if (result == 0 && node) {
        result = prepare_nodes(p);
    }
    if (result == 0 && encoder) {
        result = prepare_encoders(p);
    }
    return result;
}

void parts_close(parts_t *p)
{
    for (size_t i = 0; i < DAHL_FRAMES_NODES; i++) {
        motion_close(&p->motions[i]);
    }
}
