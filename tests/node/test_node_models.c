/* SPDX-License-Identifier: MIT */
/* A node with each friction model: parameters, restart, load, bad parameters; the torque of a mix. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "node_talk.h"

static const dahl_params_t bearing = {100.0f, 0.5f, 1e-4f};
static const dahl_node_parallel_params_t mix = {4, 0x6u, 1e-4f, {100.0f, 60.0f, 40.0f, 200.0f}, {0.25f, 0.5f, 1.0f, 0.3f}};

#define ROW(name, NAME, ...) {&kept.name.model, &dahl_model_##name##_q30, DAHL_FRAMES_MODEL_##NAME},
#define KEPT(name, ...) dahl_node_##name##_t name;
static struct {
    DAHL_OTHER_MODELS(KEPT)
} kept; /* of the nodes' models */
static const struct {
    dahl_node_model_t *storage;
    const dahl_model_q30_t *calls;
    uint32_t kind;
} models[] = {DAHL_OTHER_MODELS(ROW)};
enum { MODELS = sizeof models / sizeof models[0], LOADED = DAHL_FRAMES_MODEL_LOADED };

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

/* Three elements, or the Fc forward and backward of `order`. All numbers are exact in units of the bus. */
static dahl_model_params_t params_of(size_t i, int order)
{
    const float first = order == 0 && models[i].calls->Fcs == 2 ? 0.25f : 0.5f, second = order == 0 ? 0.5f : 0.25f;
    const dahl_model_params_t given = {{3, 1e-4f, {100.0f, 60.0f, 40.0f}, {first, second, 1.0f}}, 0x2u, 0.75f};
    return given;
}

static dahl_err_t use(size_t i, int order)
{
    const dahl_model_params_t given = params_of(i, order);
    return dahl_node_use(&node, models[i].storage, models[i].calls, &given);
}

static dahl_err_t use_loaded(void)
{
    return dahl_node_use_loaded(&node, &kept.loaded, &bearing);
}

/* The ratio after a long way forward at 3/4 of the load. */
static int32_t end_of(size_t i, int order)
{
    const bool is_first = models[i].kind != DAHL_FRAMES_MODEL_STRIBECK; /* Stribeck: the second Fc is that of this fast move */
    const int32_t smaller_Fc = models[i].calls->Fcs == 2 && (order == 0) == is_first ? 1 << 29 : 1 << 30;
    return models[i].kind == LOADED ? 3 * (1 << 28) : smaller_Fc;
}

/* A client can read the model, the sum of sigma0, and the sum or the larger Fc. It cannot write or hold them. */
static void check_parameters(size_t i, int order)
{
    const dahl_model_params_t given = params_of(i, order);
    const bool is_sum = models[i].calls->sigma0s == 0;
    const float *Fc = given.each.Fc;
    TEST_ASSERT_EQUAL_UINT32(models[i].kind + (is_sum ? 3 : 0), param_now(DAHL_FRAMES_PARAM_MODEL));
    TEST_ASSERT_EQUAL_UINT32((is_sum ? 200u : 100u) << 10, param_now(DAHL_FRAMES_PARAM_SIGMA0));
    TEST_ASSERT_EQUAL_UINT32((uint32_t)((is_sum ? Fc[0] + Fc[1] + Fc[2] : 0.5f) * 0x1p20f), param_now(DAHL_FRAMES_PARAM_FC));
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

/* tests/python/can/test_node.py compares each torque with that of the model alone. */
static void test_each_model_answers_reports_its_parameters_and_restarts(void)
{
    for (size_t i = 0; i < 2 * MODELS; i++) {
        const size_t model = i / 2;
        const int order = i % 2;
        setUp();
        TEST_ASSERT_EQUAL(DAHL_OK, use(model, order));
        TEST_ASSERT_EQUAL_INT32(0, moved(0));
        check_parameters(model, order);
        TEST_ASSERT_EQUAL(models[model].kind == LOADED, set_param(DAHL_FRAMES_PARAM_LOAD, 3 * (DAHL_NODE_ONE / 4)));
        TEST_ASSERT_TRUE(moved(100000) >= end_of(model, order) - 1);
        (void)reset(DAHL_FRAMES_RESET_RESTART);
        TEST_ASSERT_EQUAL_INT32(0, moved(0));
        TEST_ASSERT_EQUAL_INT32(end_of(model, order), moved(1 << 28)); /* the restart keeps the load */
        TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &bearing, NUMBER));
        TEST_ASSERT_EQUAL(DAHL_FRAMES_MODEL_DAHL, param_now(DAHL_FRAMES_PARAM_MODEL));
    }
}

/* Compare answers in state OK with those of the model alone, from rest. */
static void check_answers(size_t model)
{
    static dahl_any_plan_t plan;
    dahl_any_state_t state;
    const dahl_model_params_t given = params_of(model, 1);
    memset(&state, 0, sizeof state);
    TEST_ASSERT_EQUAL(DAHL_OK, models[model].calls->prepare(&plan, &given));
    for (uint32_t k = 1; k <= 50; k++) {
        const int32_t wanted = models[model].calls->step_q30(&plan, &state, move_at(k), 1u << 30);
        TEST_ASSERT_EQUAL_INT32(wanted, moved(move_at(k)));
        TEST_ASSERT_EQUAL(DAHL_FRAMES_OK, answer.state);
        TEST_ASSERT_EQUAL((counter - 1) % 16, answer.counter);
    }
}

static void check_supervision(void)
{
    const dahl_node_counts_t before = node.counts;
    TEST_ASSERT_FALSE(feed(counter++, place + 2000)); /* further than MaxStep */
    (void)moved(1);
    now_us += node.timeout_us;
    for (uint32_t k = 1; k < DAHL_NODE_REARM; k++) {
        TEST_ASSERT_FALSE(feed(counter++, place));
    }
    (void)moved(0);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_STALE, answer.state);
    TEST_ASSERT_EQUAL_UINT32(before.jump + 1, node.counts.jump);
    TEST_ASSERT_EQUAL_UINT32(before.stale + 1, node.counts.stale);
    TEST_ASSERT_EQUAL_UINT32(before.lost, node.counts.lost);
}

/* The next model starts relaxed at the last count. State, counters, MaxStep and timeout go on. Held parameters are dropped, and
 * the memory of the model before is free. */
static void test_a_model_can_be_changed_between_two_frames(void)
{
    for (size_t i = 0; i < MODELS * MODELS; i++) {
        const size_t first = i / MODELS, next = i % MODELS;
        setUp();
        node.max_step = 1000;
        (void)moved(0);
        (void)ask(DAHL_FRAMES_PARAM_FC, DAHL_FRAMES_PARAM_HOLD, 1u << 18);
        TEST_ASSERT_EQUAL(DAHL_OK, use(first, 1));
        check_answers(first);
        TEST_ASSERT_EQUAL(DAHL_OK, use(next, 1));
        if (first != next) {
            memset(models[first].storage, 0xA5, sizeof(dahl_node_model_t) + models[first].calls->plan_bytes);
        }
        check_answers(next);
        TEST_ASSERT_EQUAL_UINT32(101, node.counts.ok);
        TEST_ASSERT_TRUE(ask(DAHL_FRAMES_PARAM_FC, DAHL_FRAMES_PARAM_WRITE, 1u << 19).result != DAHL_FRAMES_PARAM_DONE);
        check_parameters(next, 1);
        check_supervision();
    }
}

/* A typed call leaves the storage that dahl_node_use() leaves. */
#define CHECK_TYPED(name, call)                                                                                                \
    {                                                                                                                          \
        size_t row = 0;                                                                                                        \
        dahl_node_##name##_t typed;                                                                                            \
        TEST_ASSERT_EQUAL(DAHL_OK, call);                                                                                      \
        memcpy(&typed, &kept.name, sizeof typed);                                                                              \
        memset(&kept.name.plan, 0x25, sizeof kept.name.plan);                                                                  \
        while (models[row].storage != &kept.name.model) {                                                                      \
            row++;                                                                                                             \
        }                                                                                                                      \
        TEST_ASSERT_EQUAL(DAHL_OK, use(row, 1));                                                                               \
        TEST_ASSERT_EQUAL_MEMORY(&typed, &kept.name, sizeof typed);                                                            \
    }

static void test_typed_calls_pass_their_parameters(void)
{
    const dahl_slip_params_t springs = {3, 1e-4f, {100.0f, 60.0f, 40.0f}, {0.5f, 0.25f, 1.0f}};
    const dahl_asymmetric_params_t directed = {100.0f, 0.5f, 0.25f, 1e-4f};
    const dahl_node_parallel_params_t parallel = {3, 0x2u, 1e-4f, {100.0f, 60.0f, 40.0f}, {0.5f, 0.25f, 1.0f}};
    CHECK_TYPED(slip, dahl_node_use_slip(&node, &kept.slip, &springs))
    CHECK_TYPED(parallel, dahl_node_use_parallel(&node, &kept.parallel, &parallel))
    CHECK_TYPED(elastoplastic, dahl_node_use_elastoplastic(&node, &kept.elastoplastic, &bearing, 0.75f))
    CHECK_TYPED(loaded, use_loaded())
    CHECK_TYPED(asymmetric, dahl_node_use_asymmetric(&node, &kept.asymmetric, &directed))
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

static void test_bad_parameters_change_neither_node_nor_memory(void)
{
    static const float bad[] = {0.0f, -1.0f, NAN, INFINITY};
    node_before = node;
    for (size_t i = 0; i < 4 * MODELS; i++) {
        const size_t model = i / 4;
        const dahl_model_q30_t *calls = models[model].calls;
        const uint32_t Fcs = calls->Fcs == 0 ? 3 : calls->Fcs, sigma0s = calls->sigma0s == 0 ? 3 : calls->sigma0s;
        for (uint32_t k = 0; k <= Fcs + sigma0s; k++) {
            dahl_model_params_t given = params_of(model, 0);
            float *changed = k < Fcs ? &given.each.Fc[k] : k < Fcs + sigma0s ? &given.each.sigma0[k - Fcs] : &given.each.theta_per_count;
            *changed = bad[i % 4];
            if (k < Fcs + sigma0s || i % 4 != 0 || models[model].kind != LOADED) { /* it may have no encoder */
                assert_refused(DAHL_ERR_PARAM, dahl_node_use(&node, models[model].storage, calls, &given));
            }
        }
    }
    for (size_t model = 0; model < MODELS; model++) {
        dahl_model_params_t given = params_of(model, 0);
        given.own = 1.0f;
        given.each.elements = 9;
        if (models[model].calls->sigma0s == 0 || &kept.elastoplastic.model == models[model].storage) {
            assert_refused(DAHL_ERR_RANGE, dahl_node_use(&node, models[model].storage, models[model].calls, &given));
        }
        given.each.elements = 0;
        if (models[model].calls->sigma0s == 0) {
            assert_refused(DAHL_ERR_PARAM, dahl_node_use(&node, models[model].storage, models[model].calls, &given));
        }
    }
}
