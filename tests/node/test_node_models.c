/* SPDX-License-Identifier: MIT */
/* A node with each friction model: parameters, restart, load, bad parameters; the torque of a mix. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "node_talk.h"

static const dahl_params_t bearing = {100.0f, 0.5f, 1e-4f};
static const dahl_slip_params_t springs = {3, 1e-4f, {100.0f, 60.0f, 40.0f}, {0.25f, 0.5f, 1.0f}};
static const dahl_node_parallel_params_t mix = {4, 0x6u, 1e-4f, {100.0f, 60.0f, 40.0f, 200.0f}, {0.25f, 0.5f, 1.0f, 0.3f}};

#define KEPT(name, ...) dahl_node_##name##_t name;
static struct {
    DAHL_FRAMES_OTHER_MODELS(KEPT)
} kept; /* of the nodes' models */
static uint32_t counter;
static int32_t place;

void setUp(void)
{
    counter = 0;
    place = 0;
    memset(&kept, 0x25, sizeof kept);
    talk_begin();
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &bearing, NUMBER));
}

void tearDown(void)
{
}

static int32_t moved(int32_t dcounts)
{
    place += dcounts;
    TEST_ASSERT_TRUE(feed(counter++, place));
    return answer.torque_q30;
}

static int32_t move_at(uint32_t i)
{
    return (int32_t)(i * i % 401u) - 200;
}

static dahl_err_t use_slip(void)
{
    return dahl_node_use_slip(&node, &kept.slip, &springs);
}

/* A model with one Fc for each direction, and the same with both exchanged. */
#define DIRECTED(name, ...)                                                                                                    \
    static dahl_err_t use_##name##_of(float Fc_forward, float Fc_backward)                                                     \
    {                                                                                                                          \
        const dahl_##name##_params_t given = {100.0f, Fc_forward, Fc_backward, 1e-4f};                                         \
        return dahl_node_use_##name(&node, &kept.name, &given);                                                                \
    }                                                                                                                          \
    static dahl_err_t use_##name(void)                                                                                         \
    {                                                                                                                          \
        return use_##name##_of(0.3f, 0.5f);                                                                                    \
    }                                                                                                                          \
    static dahl_err_t use_##name##_mirrored(void)                                                                              \
    {                                                                                                                          \
        return use_##name##_of(0.5f, 0.3f);                                                                                    \
    }
DAHL_FRAMES_DIRECTED_MODELS(DIRECTED)

static dahl_err_t use_elastoplastic(void)
{
    return dahl_node_use_elastoplastic(&node, &kept.elastoplastic, &bearing, 0.7f);
}

static dahl_err_t use_loaded(void)
{
    return dahl_node_use_loaded(&node, &kept.loaded, &bearing);
}

static dahl_err_t use_parallel(void)
{
    return dahl_node_use_parallel(&node, &kept.parallel, &mix);
}

#define RATIO_OF_3_TO_5 644245120
#define DIRECTED_ROWS(name, NAME, ...)                                                                                         \
    {use_##name, DAHL_FRAMES_MODEL_##NAME, 100u << 10, 1u << 19, RATIO_OF_3_TO_5},                                             \
    {use_##name##_mirrored, DAHL_FRAMES_MODEL_##NAME, 100u << 10, 1u << 19, 1 << 30},

/* sigma0 and Fc are raw values. tests/python/can/test_node.py compares each torque with that of the model alone. */
static const struct {
    dahl_err_t (*use)(void);
    uint32_t kind, sigma0, Fc;
    int32_t end; /* ratio after a long way forward, at 3/4 of the load */
} models[] = {{use_slip, DAHL_FRAMES_MODEL_SLIP + 3, 200u << 10, 7u << 18, 1 << 30},
              DAHL_FRAMES_DIRECTED_MODELS(DIRECTED_ROWS)
              {use_elastoplastic, DAHL_FRAMES_MODEL_ELASTOPLASTIC, 100u << 10, 1u << 19, 1 << 30},
              {use_loaded, DAHL_FRAMES_MODEL_LOADED, 100u << 10, 1u << 19, 3 * (1 << 28)},
              {use_parallel, DAHL_FRAMES_MODEL_PARALLEL + 4, 400u << 10, 2149581u /* 2.05 2^20 */, 1 << 30}};
#define MODELS (sizeof models / sizeof models[0])

/* A client can read the model, the sum of sigma0, and the sum or the larger Fc. It cannot write or hold them. */
static void check_parameters(size_t i)
{
    TEST_ASSERT_EQUAL_UINT32(models[i].kind, param_now(DAHL_FRAMES_PARAM_MODEL));
    TEST_ASSERT_EQUAL_UINT32(models[i].sigma0, param_now(DAHL_FRAMES_PARAM_SIGMA0));
    TEST_ASSERT_EQUAL_UINT32(models[i].Fc, param_now(DAHL_FRAMES_PARAM_FC));
    TEST_ASSERT_EQUAL_UINT32((uint32_t)(1e-4f * 0x1p38f), param_now(DAHL_FRAMES_PARAM_THETA));
    for (uint8_t k = 0; k < 4; k++) {
        const uint8_t param = k < 3 ? k : DAHL_FRAMES_PARAM_MODEL;
        const uint32_t before = param_now(param);
        for (uint8_t write = DAHL_FRAMES_PARAM_WRITE; write <= DAHL_FRAMES_PARAM_HOLD; write++) {
            TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, ask(param, write, 1u << 19).result);
        }
        TEST_ASSERT_EQUAL_UINT32(before, param_now(param));
    }
}

static void test_each_model_answers_reports_its_parameters_and_restarts(void)
{
    for (size_t i = 0; i < MODELS; i++) {
        setUp();
        TEST_ASSERT_EQUAL(DAHL_OK, models[i].use());
        TEST_ASSERT_EQUAL_INT32(0, moved(0));
        check_parameters(i);
        TEST_ASSERT_EQUAL(models[i].use == use_loaded, set_param(DAHL_FRAMES_PARAM_LOAD, 3 * (DAHL_NODE_ONE / 4)));
        TEST_ASSERT_TRUE(moved(100000) >= models[i].end - 1);
        (void)reset(DAHL_FRAMES_RESET_RESTART);
        TEST_ASSERT_EQUAL_INT32(0, moved(0));
        TEST_ASSERT_EQUAL_INT32(models[i].end, moved(1 << 28)); /* the restart keeps the load */
        TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &bearing, NUMBER));
        TEST_ASSERT_EQUAL(DAHL_FRAMES_MODEL_DAHL, param_now(DAHL_FRAMES_PARAM_MODEL));
    }
}

/* Only the loaded model accepts a load. A load of 0 relaxes the bristle. */
static void test_a_load_is_0_to_1(void)
{
    TEST_ASSERT_FALSE(set_param(DAHL_FRAMES_PARAM_LOAD, 1));
    TEST_ASSERT_EQUAL_UINT32(DAHL_NODE_ONE, param_now(DAHL_FRAMES_PARAM_LOAD));
    TEST_ASSERT_EQUAL(DAHL_OK, use_loaded());
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_LOAD, 0) && !set_param(DAHL_FRAMES_PARAM_LOAD, DAHL_NODE_ONE + 1));
    TEST_ASSERT_EQUAL_UINT32(0, param_now(DAHL_FRAMES_PARAM_LOAD));
    TEST_ASSERT_EQUAL_INT32(0, moved(0));
    TEST_ASSERT_EQUAL_INT32(0, moved(1 << 28));
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_LOAD, DAHL_NODE_ONE));
    TEST_ASSERT_EQUAL_INT32(0, moved(0));
    node.load = 4 * DAHL_NODE_ONE; /* written by firmware */
    TEST_ASSERT_EQUAL_INT32(1 << 30, moved(1 << 28));
}

/* Compare with the sum of the single elements in double; a slip element errs by 1.5e-9. */
static void check_mix(const dahl_node_parallel_params_t *of)
{
    dahl_plan_t plans[8];
    dahl_slip_plan_t slips[8];
    dahl_state_t states[8] = {{0}};
    dahl_slip_state_t slip_states[8] = {{{0}}};
    double sum = 0;
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_parallel(&node, &kept.parallel, of));
    for (uint32_t k = 0; k < of->elements; k++) {
        const dahl_params_t one = {of->sigma0[k], of->Fc[k], of->theta_per_count};
        const dahl_slip_params_t slip = {1, of->theta_per_count, {of->sigma0[k]}, {of->Fc[k]}};
        TEST_ASSERT_TRUE(dahl_prepare(&plans[k], &one) == DAHL_OK && dahl_slip_prepare(&slips[k], &slip) == DAHL_OK);
        sum += (double)of->Fc[k];
    }
    TEST_ASSERT_EQUAL_INT32(0, moved(0));
    for (uint32_t i = 1; i < 3000; i++) {
        double F = 0;
        for (uint32_t k = 0; k < of->elements; k++) {
            int64_t w = (of->slips >> k & 1u) != 0 ? dahl_slip_part_move(&slips[k], &slip_states[k], move_at(i))
                                                   : dahl_part_move(&plans[k], &states[k], move_at(i));
            F += (double)of->Fc[k] * (double)w;
        }
        TEST_ASSERT_TRUE(fabs(ldexp(moved(move_at(i)), -30) - F / sum * 0x1p-62) <= 3e-9);
    }
    TEST_ASSERT_EQUAL_INT32(1 << 30, moved(1 << 28));
    TEST_ASSERT_EQUAL_INT32(-(1 << 30), moved(-(1 << 29)));
}

static void test_a_mix_answers_the_sum(void)
{
    dahl_node_parallel_params_t all[] = {mix,
                                         {2, 0, 1e-4f, {1e-4f, 6e-5f}, {2.5e-7f, 5.1e-6f}},
                                         {1, 1, 1e-4f, {100.0f}, {0.25f}},
                                         {3, 2, 1e-4f, {1e9f, 1e-9f, 1.0f}, {1e7f, 1e-11f, 0.1f}}, /* far apart */
                                         {8, 0x55u, 1e-4f, {0}, {0}}};
    for (uint32_t k = 0; k < 8; k++) {
        all[4].sigma0[k] = 100.0f * (float)(k + 1);
        all[4].Fc[k] = 0.1f + 0.37f * (float)k;
    }
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++) {
        setUp();
        check_mix(&all[i]);
    }
}

static dahl_node_t node_before;

static void assert_refused(dahl_err_t wanted, dahl_err_t got)
{
    TEST_ASSERT_EQUAL_INT(wanted, got);
    TEST_ASSERT_EQUAL_MEMORY(&node_before, &node, sizeof node);
    TEST_ASSERT_EACH_EQUAL_HEX8(0x25, &kept, sizeof kept);
}

#define REFUSE(name, ...) assert_refused(DAHL_ERR_PARAM, use_##name##_of(0.3f, bad[i]));

static void test_bad_parameters_change_neither_node_nor_memory(void)
{
    static const float bad[] = {0.0f, -1.0f, NAN, INFINITY};
    dahl_node_parallel_params_t parallel = mix;
    dahl_slip_params_t slip = springs;
    node_before = node;
    for (size_t i = 0; i < 4; i++) {
        const dahl_params_t one = {100.0f, bad[i], 1e-4f};
        parallel = mix;
        parallel.Fc[0] = bad[i]; /* one of Dahl's */
        assert_refused(DAHL_ERR_PARAM, dahl_node_use_parallel(&node, &kept.parallel, &parallel));
        parallel = mix;
        parallel.sigma0[2] = bad[i]; /* one that slips */
        assert_refused(DAHL_ERR_PARAM, dahl_node_use_parallel(&node, &kept.parallel, &parallel));
        parallel = mix;
        parallel.theta_per_count = bad[i];
        assert_refused(DAHL_ERR_PARAM, dahl_node_use_parallel(&node, &kept.parallel, &parallel));
        slip.Fc[2] = bad[i];
        assert_refused(DAHL_ERR_PARAM, dahl_node_use_slip(&node, &kept.slip, &slip));
        DAHL_FRAMES_DIRECTED_MODELS(REFUSE)
        assert_refused(DAHL_ERR_PARAM, dahl_node_use_loaded(&node, &kept.loaded, &one));
        assert_refused(DAHL_ERR_PARAM, dahl_node_use_elastoplastic(&node, &kept.elastoplastic, &one, 0.5f));
    }
    parallel = mix;
    slip = springs;
    parallel.elements = 0;
    assert_refused(DAHL_ERR_PARAM, dahl_node_use_parallel(&node, &kept.parallel, &parallel));
    parallel.elements = slip.elements = 9;
    assert_refused(DAHL_ERR_RANGE, dahl_node_use_parallel(&node, &kept.parallel, &parallel));
    assert_refused(DAHL_ERR_RANGE, dahl_node_use_slip(&node, &kept.slip, &slip));
    assert_refused(DAHL_ERR_RANGE, dahl_node_use_elastoplastic(&node, &kept.elastoplastic, &bearing, 1.0f));
}
