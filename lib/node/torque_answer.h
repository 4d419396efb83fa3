/* SPDX-License-Identifier: MIT */
/** Torque answer: a step of the model, then gain, ramp and limit. */
#ifndef DAHL_NODE_TORQUE_ANSWER_H
#define DAHL_NODE_TORQUE_ANSWER_H

#include "../arith/scale.h"
#include "model_storage.h"

static uint32_t gain_to_reach(const dahl_node_t *node)
{
    return dahl_least(node->gain, DAHL_NODE_ONE);
}

/** Time [us] since the last accepted count; 0 if the clock went back. */
static uint32_t elapsed_us(const dahl_node_t *node, uint32_t now_us)
{
    uint32_t elapsed = now_us - node->good_us;
    return elapsed <= INT32_MAX ? elapsed : 0;
}

/** Return the step of the gain in `elapsed` us. Answers have no fixed period, so it cannot be prepared as the fades of
 * the compensator are. Without the remainder in gain_rest, frequent calls would slow down a long ramp. */
static uint32_t ramp_step(dahl_node_t *node, uint32_t elapsed)
{
    uint32_t whole = DAHL_NODE_ONE * dahl_least(elapsed, DAHL_NODE_ONE - 1);
    uint32_t step = whole / node->ramp_us, rest = whole % node->ramp_us;
    uint32_t to_next_step = node->ramp_us - rest;
    if (node->gain_rest < to_next_step) {
        node->gain_rest += rest;
        return step;
    }
    node->gain_rest = dahl_least(node->gain_rest - to_next_step, node->ramp_us - 1); /* in case the ramp was shortened */
    return step + 1;
}

/** Ramp gain_now towards gain. Called once for each answer. */
static void ramp(dahl_node_t *node, uint32_t elapsed)
{
    uint32_t step = node->ramp_us > 0 ? ramp_step(node, elapsed) : DAHL_NODE_ONE;
    node->gain_now = (uint32_t)dahl_approach((int32_t)node->gain_now, (int32_t)gain_to_reach(node), step);
}

/** Scale the magnitude, so that the opposite torque has the opposite answer. */
static int32_t output(const dahl_node_t *node, int32_t torque_q30)
{
    int32_t part = dahl_scale_q16((int32_t)dahl_magnitude(torque_q30), node->gain_now);
    return dahl_limit(torque_q30 < 0 ? -part : part, (int32_t)(dahl_least(node->limit, DAHL_NODE_ONE) << 14));
}

static bool answer_encoder(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us, int32_t torque_q30,
                           dahl_can_frame_t *out)
{
    ramp(node, node->primed ? elapsed_us(node, now_us) : 0);
    node->count = (uint32_t)encoder->count;
    node->counter = encoder->counter;
    node->good_us = now_us;
    node->primed = true;
    node->good_in_a_row = 0;
    node->bus_off_count = 0;
    dahl_friction_torque_t torque = {
        .torque_q30 = output(node, torque_q30),
        .counter = node->torque_counter,
        .state = node->state,
        .echo = encoder->counter,
    };
    node->torque_counter = (node->torque_counter + 1) & 0x0F;
    dahl_frames_pack_torque(out, node->number, &torque);
    return true;
}

static int32_t step_model(dahl_node_t *node, int32_t dcounts)
{
    if (node->model == NULL) {
        return dahl_step_counts_q30(&node->plan, &node->bearing, dcounts);
    }
    return node->model->calls->step_q30(dahl_node_plan(node->model), dahl_node_state(node->model), dcounts,
                                         dahl_least(node->load, DAHL_NODE_ONE) << 14);
}

static inline int32_t travel(const dahl_node_t *node, const dahl_encoder_state_t *encoder)
{
    return dahl_counts_between(node->count, (uint32_t)encoder->count, 0);
}

static inline bool prime(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us, dahl_can_frame_t *out)
{
    return answer_encoder(node, encoder, now_us, step_model(node, 0), out);
}

static inline bool answer_move(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us, dahl_can_frame_t *out)
{
    node->counts.ok++;
    return answer_encoder(node, encoder, now_us, step_model(node, travel(node, encoder)), out);
}

#endif
