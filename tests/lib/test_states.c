/* SPDX-License-Identifier: MIT */
/* Any bits are a safe state. All calls run in random order, with all elements and several plans, on one memory whose bits are
 * spoiled now and then. Each call must keep the contract of its header from any such state. */
#include "plans.h"
#include "models.h"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif
#define HOLDS(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)

#define HASH 0xae9e885403cfc8e2u /* of the results of the first CALLS_HASHED calls, on every core */
enum { CALLS_HASHED = 20000, CALLS = TEST_TICKS < 20000 ? CALLS_HASHED : 2 * TEST_TICKS, SETS = 4, WORK_TICKS = 8 };

typedef struct {
    const model_t *model;
    set_t set;
    any_plan_t plan;
} element_t;

static element_t element, other; /* each call prepares them again, because small cores have little memory */
static any_state_t state;
static uint64_t seed, hash;

/* splitmix64 */
static uint64_t random64(void)
{
    uint64_t z = seed += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

static uint32_t random_below(uint32_t n)
{
    return (uint32_t)((random64() >> 32) * n >> 32);
}

static int32_t random_counts(void)
{
    int32_t any = (int32_t)(uint32_t)random64();
    return random_below(3) != 0 ? any % 12 : any >> random_below(32);
}

static uint32_t random_load(void)
{
    uint32_t any = (uint32_t)random64(), kind = random_below(8);
    return kind == 0 ? 0 : kind < 3 ? ONE_Q30 : any >> random_below(4);
}

static uint32_t bits_of(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static float float_of(uint32_t bits)
{
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static float random_torque(float Fc)
{
    const uint32_t any = (uint32_t)random64(), kind = random_below(8);
    return kind == 0 ? NAN : kind < 3 ? float_of(any) : Fc * 0x1p-30f * (float)(int32_t)any;
}

/* FNV-1a over words */
static void add_to_hash(uint32_t word)
{
    hash = (hash ^ word) * 0x100000001b3u;
}

static void prepare(element_t *e, const model_t *model)
{
    static const double travels[SETS] = {1e-6, 2e-3, 0.3, 9.0};
    static const float more[SETS] = {0.25f, 0.9f, 1.0f, 4.0f}, b[SETS] = {0.1f, 0.5f, 0.9f, 0.99f};
    static const float Fc[SETS] = {1.0f, 0.371f, 1e-3f, 3e4f};
    const uint32_t k = random_below(SETS);
    e->model = model;
    e->set.p = params_for(travels[k], Fc[k]);
    e->set.more = more_for(model, (float)(1 + k), more[k], b[k]);
    HOLDS(model->prepare(&e->plan, &e->set) == DAHL_OK, model->name);
}

static const element_t *dahl_element(element_t *e)
{
    prepare(e, &models[0]);
    return e;
}

/* Flip one bit, replace all bits, or set words to the ends of their type. */
static void spoil(void)
{
    uint32_t words[sizeof state / sizeof(uint32_t)];
    const uint32_t kind = random_below(3);
    memcpy(words, &state, sizeof words);
    if (kind == 0) {
        words[random_below(sizeof words / sizeof words[0])] ^= UINT32_C(1) << random_below(32);
    }
    for (size_t i = 0; kind != 0 && i < sizeof words / sizeof words[0]; i++) {
        words[i] = kind == 1 ? (uint32_t)random64() : 0x80000000u - random_below(2);
    }
    memcpy(&state, words, sizeof words);
}

static void check_limits(const element_t *e, move_t move, float F)
{
    const long double c = e->model->has_load ? load_in_range(move) * 0x1p-30L : 1;
    const long double slack = e->model->ulps * ulp_now(e->model, &e->set, move);
    long double forward = c * whole_of(e->model, &e->set), backward = forward;
    if (e->model->more == MORE_IS_RATIO) {
        forward = e->set.p.Fc;
        backward = asymmetric_params(&e->set).Fc_backward;
    }
    HOLDS(F <= forward + slack && F >= -backward - slack, "the torque stays within the limits of the element");
    HOLDS(e->model->step != dahl_model_step || fabsf(F) <= e->set.p.Fc, "the torque stays within Fc to the bit");
}

static void check_q30(const element_t *e, any_state_t before, move_t move, float F)
{
    const long double whole = whole_of(e->model, &e->set);
    if (e->model->step_q30 == NULL) {
        return;
    }
    const int32_t q30 = e->model->step_q30(&e->plan, &before, move);
    const long double slack = e->model->q30_error * whole + e->model->ulps * ulp_now(e->model, &e->set, move);
    HOLDS(fabsl(q30 * (long double)DAHL_Q30 * whole - F) <= slack, "both forms agree");
    HOLDS(memcmp(&before, &state, sizeof state) == 0, "both forms leave the same state");
    add_to_hash((uint32_t)q30);
}

static void step_any_element(void)
{
    const element_t *e = &element;
    prepare(&element, &models[random_below(MODELS)]);
    const move_t move = {random_counts(), random_load()}, rest = {0, move.load_q30};
    const any_state_t before = state;
    any_state_t at_rest = state;
    const float F0 = e->model->step(&e->plan, &at_rest, &e->set, rest), F = e->model->step(&e->plan, &state, &e->set, move);
    check_limits(e, move, F0);
    check_limits(e, move, F);
    HOLDS(move.counts > 0 ? F >= F0 : move.counts < 0 ? F <= F0 : F == F0, "the torque follows the direction of the move");
    check_q30(e, before, move, F);
    const any_state_t after = state;
    HOLDS(e->model->step(&e->plan, &state, &e->set, rest) == F, "0 counts keep the torque");
    HOLDS(memcmp(&after, &state, sizeof state) == 0, "a call leaves a state in range");
    HOLDS(e->model->prepare != dahl_model_prepare || dahl_state_ok(&state.dahl), "dahl_state_ok() accepts it");
    add_to_hash(bits_of(F));
}

static void set_any_torque(void)
{
    const element_t *e = dahl_element(&element);
    const float Fc = e->set.p.Fc, F = random_torque(Fc), before = dahl_torque(&e->plan.dahl, &state.dahl);
    HOLDS(fabsf(before) <= Fc, "the torque stays within Fc");
    dahl_set_torque(&e->plan.dahl, &state.dahl, F);
    const float now = dahl_torque(&e->plan.dahl, &state.dahl), wanted = fmaxf(-Fc, fminf(F, Fc));
    HOLDS(isnan(F) ? now == before : now == wanted || fabsf(wanted) < 0x1p-36f * Fc, "the torque is set and clamped; NaN is ignored");
    HOLDS(dahl_state_ok(&state.dahl), "the state is in range");
    add_to_hash(bits_of(now));
}

static void change_any_plan(void)
{
    const element_t *from = dahl_element(&element), *to = dahl_element(&other);
    const float before = dahl_torque(&from->plan.dahl, &state.dahl);
    dahl_change_plan(&from->plan.dahl, &to->plan.dahl, &state.dahl);
    const float now = dahl_torque(&to->plan.dahl, &state.dahl);
    HOLDS(fabsf(now) <= to->set.p.Fc && fabsf(now) <= fabsf(before) * (1 + 0x1p-22f), "new parameters do not raise the torque");
    HOLDS(now * before >= 0 && dahl_state_ok(&state.dahl), "the torque keeps its sign, the state is in range");
    add_to_hash(bits_of(now));
}

/* From any bits, a bearing returns at most the energy that its clamped state stores. */
static void work_from_here(void)
{
    const element_t *e = dahl_element(&element);
    const dahl_params_t *p = &e->set.p;
    dahl_state_t by_q30 = state.dahl;
    dahl_work_t work = {{0}, {0}}, work_q30 = {{0}, {0}};
    const long double F0 = dahl_torque(&e->plan.dahl, &state.dahl), energy = (long double)p->Fc * p->Fc / p->sigma0;
    for (int i = 0; i < WORK_TICKS; i++) {
        const int32_t counts = random_counts();
        const float F = dahl_work_step_counts(&e->plan.dahl, &state.dahl, &work, counts), W = dahl_work(p, &work);
        (void)dahl_work_step_counts_q30(&e->plan.dahl, &by_q30, &work_q30, counts);
        HOLDS(W >= -F0 * F0 / (2 * (long double)p->sigma0) - 0x1p-22L * energy, "the bearing returns at most the stored energy");
        HOLDS(fabsf(F) <= p->Fc, "the torque stays within Fc");
        add_to_hash(bits_of(W));
    }
    HOLDS(by_q30.w == state.dahl.w && memcmp(&work, &work_q30, sizeof work) == 0, "both forms leave the same state and work");
}

static void go_to_any_torque(void)
{
    const element_t *e = dahl_element(&element);
    const float F = random_torque(e->set.p.Fc), here = dahl_torque(&e->plan.dahl, &state.dahl);
    const any_state_t before = state;
    int32_t counts = 0;
    const dahl_err_t err = dahl_counts_to_torque(&e->plan.dahl, &state.dahl, F, &counts);
    HOLDS(memcmp(&before, &state, sizeof state) == 0, "the inverse keeps the state");
    HOLDS((err == DAHL_ERR_PARAM) == !isfinite(F), "DAHL_ERR_PARAM if and only if F is not finite");
    if (err == DAHL_OK) {
        const float reached = dahl_step_counts(&e->plan.dahl, &state.dahl, counts);
        HOLDS(F >= here ? reached >= F : reached <= F, "the counts reach the torque");
    }
    add_to_hash((uint32_t)counts);
}

static void test_calls_in_any_order_are_safe_on_any_bits(void)
{
    static void (*const calls[])(void) = {spoil, spoil, set_any_torque, change_any_plan, work_from_here, go_to_any_torque};
    enum { OTHERS = sizeof calls / sizeof calls[0] };
    seed = hash = 1;
    for (int i = 0; i < CALLS; i++) {
        const uint32_t which = random_below(3 * OTHERS);
        if (which < OTHERS) {
            calls[which]();
        } else {
            step_any_element();
        }
        HOLDS(i + 1 != CALLS_HASHED || hash == HASH, "every core has the same results");
    }
}

/* The recipe of dahl.h: store the torque and set it again. An elasto-plastic element uses the plan of its plastic range. */
static void test_a_torque_survives_a_power_cycle(void)
{
    seed = 2;
    for (int i = 0; i < 2000; i++) {
        const int is_plastic = i % 2;
        prepare(&element, is_plastic ? model_with(MORE_IS_BREAKAWAY) : &models[0]);
        const dahl_plan_t *plan = storing_plan(element.model, &element.plan);
        const move_t there = {random_counts(), 0}, and_back = {random_counts(), 0}, rest = {0, 0};
        any_state_t bearing = {{0}}, again;
        (void)element.model->step(&element.plan, &bearing, &element.set, there);
        const float F = element.model->step(&element.plan, &bearing, &element.set, and_back);
        const float stored = dahl_torque(plan, &bearing.dahl);
        again.dahl.w = (int64_t)random64();
        dahl_set_torque(plan, &again.dahl, stored);
        HOLDS(stored == F && element.model->step(&element.plan, &again, &element.set, rest) == F, "the torque is restored");
        dahl_set_torque(plan, &again.dahl, float_of((uint32_t)random64()));
        HOLDS(fabsf(dahl_torque(plan, &again.dahl)) <= element.set.p.Fc, "a bad stored value gives at most Fc");
    }
}

static void test_state_ok_is_the_range_to_the_bit(void)
{
    const int64_t end = ((int64_t)1 << 62) + ((int64_t)1 << 31);
    const struct {
        int64_t w;
        int ok;
    } cases[] = {{0, 1}, {end - 1, 1}, {end, 0}, {-end, 1}, {-end - 1, 0}, {INT64_MAX, 0}, {INT64_MIN, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const dahl_state_t bearing = {cases[i].w};
        TEST_ASSERT_EQUAL_INT(cases[i].ok, dahl_state_ok(&bearing));
    }
}

/* From both ends of the range of states, to the bit: a ratio is at most 2^30, under a load of 1 too. */
static void check_ratios_from(const element_t *e, int64_t w)
{
    static const int32_t counts[] = {0, 1, 8, 9, -1, -9};
    for (size_t k = 0; k < sizeof counts / sizeof counts[0]; k++) {
        const move_t move = {counts[k], ONE_Q30};
        any_state_t at_end = {{0}};
        at_end.dahl.w = w;
        const int32_t q30 = e->model->step_q30(&e->plan, &at_end, move);
        HOLDS(q30 <= (int32_t)ONE_Q30 && q30 >= -(int32_t)ONE_Q30, e->model->name);
    }
}

static void test_ratios_stay_within_2_to_the_30(void)
{
    const int64_t end = ((int64_t)1 << 62) + ((int64_t)1 << 31), starts[] = {end - 1, end, end + 1, 1 - end, -end, -end - 1};
    seed = 3;
    for (uint32_t i = 0; i < 16 * MODELS; i++) {
        prepare(&element, &models[i % MODELS]);
        for (size_t k = 0; k < sizeof starts / sizeof starts[0] && element.model->step_q30 != NULL; k++) {
            check_ratios_from(&element, starts[k]);
        }
    }
}
