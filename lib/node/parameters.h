/* SPDX-License-Identifier: MIT */
/** ParamWrite and ParamReply: read and change the parameters of the node. */
#ifndef DAHL_NODE_PARAMETERS_H
#define DAHL_NODE_PARAMETERS_H

#include <stddef.h>

#include "supervision.h"

static const float SIGMA0_STEP = 0x1p-10f;
static const float FC_STEP = 0x1p-20f;
static const float THETA_STEP = 0x1p-38f;

/** A parameter that is a member of dahl_node_t: member = raw * scale, low <= raw <= high. */
typedef struct {
    size_t offset;
    uint32_t low, high, scale;
} setting_t;

static const setting_t settings[] = {
    [DAHL_FRAMES_PARAM_GAIN] = {offsetof(dahl_node_t, gain), 0, DAHL_NODE_ONE, 1},
    [DAHL_FRAMES_PARAM_LIMIT] = {offsetof(dahl_node_t, limit), 0, DAHL_NODE_ONE, 1},
    [DAHL_FRAMES_PARAM_RAMP] = {offsetof(dahl_node_t, ramp_us), 0, 60000, 1000},
    [DAHL_FRAMES_PARAM_TIMEOUT] = {offsetof(dahl_node_t, timeout_us), 1, 60000, 1000},
    [DAHL_FRAMES_PARAM_STEP] = {offsetof(dahl_node_t, max_step), 0, INT32_MAX, 1},
    [DAHL_FRAMES_PARAM_STATUS] = {offsetof(dahl_node_t, status_us), 0, 60000, 1000},
    [DAHL_FRAMES_PARAM_LOAD] = {offsetof(dahl_node_t, load), 0, DAHL_NODE_ONE, 1},
};

static uint32_t *setting_value(dahl_node_t *node, uint8_t param)
{
    return (uint32_t *)(void *)((char *)node + settings[param].offset);
}

static float *model_param(dahl_params_t *params, uint8_t param, float *unit)
{
    switch (param) {
    case DAHL_FRAMES_PARAM_SIGMA0:
        *unit = SIGMA0_STEP;
        return &params->sigma0;
    case DAHL_FRAMES_PARAM_FC:
        *unit = FC_STEP;
        return &params->Fc;
    default:
        *unit = THETA_STEP;
        return &params->theta_per_count;
    }
}

static uint8_t drop_held(dahl_node_t *node)
{
    node->held = node->params;
    return DAHL_FRAMES_PARAM_OUT_OF_RANGE;
}

/** Apply all held values together. */
static uint8_t apply_held(dahl_node_t *node)
{
    dahl_plan_t plan;
    if (dahl_prepare(&plan, &node->held) != DAHL_OK) {
        return drop_held(node);
    }
    dahl_change_plan(&node->plan, &plan, &node->bearing);
    node->params = node->held;
    node->plan = plan;
    return DAHL_FRAMES_PARAM_DONE;
}

static uint8_t write_model(dahl_node_t *node, const dahl_param_write_t *request)
{
    float unit;
    if (request->value == 0 || request->write > DAHL_FRAMES_PARAM_HOLD || node->model != NULL) {
        return drop_held(node);
    }
    float *value = model_param(&node->held, request->param, &unit);
    *value = (float)request->value * unit;
    return request->write == DAHL_FRAMES_PARAM_HOLD ? DAHL_FRAMES_PARAM_DONE : apply_held(node);
}

static bool follows_load(const dahl_node_t *node)
{
    return node->model != NULL && node->model->kind == DAHL_FRAMES_MODEL_LOADED;
}

static uint8_t write_setting(dahl_node_t *node, const dahl_param_write_t *request)
{
    const setting_t *setting = &settings[request->param];
    if (request->param == DAHL_FRAMES_PARAM_LOAD && !follows_load(node)) {
        return DAHL_FRAMES_PARAM_OUT_OF_RANGE;
    }
    if (request->write != DAHL_FRAMES_PARAM_WRITE || request->value < setting->low || request->value > setting->high) {
        return DAHL_FRAMES_PARAM_OUT_OF_RANGE;
    }
    *setting_value(node, request->param) = request->value * setting->scale;
    return DAHL_FRAMES_PARAM_DONE;
}

static uint8_t write_param(dahl_node_t *node, const dahl_param_write_t *request)
{
    if (request->param > DAHL_FRAMES_PARAM_LOAD) {
        return DAHL_FRAMES_PARAM_UNKNOWN;
    }
    if (request->write == DAHL_FRAMES_PARAM_READ) {
        return DAHL_FRAMES_PARAM_DONE;
    }
    if (request->param == DAHL_FRAMES_PARAM_MODEL) {
        return DAHL_FRAMES_PARAM_OUT_OF_RANGE;
    }
    return request->param <= DAHL_FRAMES_PARAM_THETA ? write_model(node, request) : write_setting(node, request);
}

static uint32_t read_param(dahl_node_t *node, uint8_t param)
{
    float unit;
    if (param == DAHL_FRAMES_PARAM_MODEL) {
        return node->model == NULL ? DAHL_FRAMES_MODEL_DAHL : node->model->kind;
    }
    if (param > DAHL_FRAMES_PARAM_THETA) {
        uint32_t value = *setting_value(node, param), scale = settings[param].scale;
        return value / scale + (value % scale >= scale - value % scale ? 1u : 0u);
    }
    float raw = *model_param(&node->params, param, &unit);
    raw /= unit;
    if (raw >= 0x1p32f) {
        return UINT32_MAX;
    }
    uint32_t whole = (uint32_t)raw;
    return whole + (raw - (float)whole >= 0.5f ? 1u : 0u);
}

static inline bool on_param(dahl_node_t *node, const dahl_can_frame_t *in, dahl_can_frame_t *out)
{
    dahl_param_write_t request;
    if (!is_good(node, dahl_frames_unpack_param_write(in, &request))) {
        return false;
    }
    dahl_param_reply_t reply = {.counter = request.counter, .param = request.param, .result = write_param(node, &request)};
    node->counts.params++;
    if (reply.result == DAHL_FRAMES_PARAM_UNKNOWN) {
        reply.param = DAHL_FRAMES_PARAM_NONE;
        reply.value = request.param;
    } else {
        reply.value = read_param(node, request.param);
    }
    dahl_frames_pack_param_reply(out, node->number, &reply);
    return true;
}

#endif
