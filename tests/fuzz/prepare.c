/* SPDX-License-Identifier: MIT */
/*
 * Any bytes as parameters of each model. They are accepted if and only if they are in range, compared exactly in long double. A
 * refusal leaves the plan unchanged. The entries of a plan are 1 - exp(-u) and increase; a long way in one direction ends at
 * its Fc.
 */
#include "dahl_batch.h"
#include "dahl_float.h"
#include "plans.h"
#include "../lib/properties.h"

enum { ENTRIES = 37, DENSE = 8 };

static const long double PREPARED = 0x1p-32L; /* relative error of an entry, lib/model/prepare.c */

static uint64_t entry_of(const dahl_plan_t *plan, int i)
{
    return (uint64_t)plan->g[i].hi << 32 | plan->g[i].lo;
}

static long double counts_of(int i)
{
    return i <= DENSE ? (long double)i : ldexpl(1.0L, i - DENSE + 3);
}

static void check_entries(const dahl_plan_t *plan, const dahl_params_t *p)
{
    long double travel = fuzz_travel(p, (long double)p->theta_per_count);
    HOLDS(entry_of(plan, 0) == 0, "entry 0 is 0");
    for (int i = 1; i < ENTRIES; i++) {
        long double exact = -expm1l(-travel * counts_of(i)), got = ldexpl((long double)entry_of(plan, i), -64);
        HOLDS(fabsl(got - exact) <= PREPARED * exact, "an entry is 1 - exp(-u) within 2^-32 of itself");
        HOLDS(entry_of(plan, i) >= entry_of(plan, i - 1), "the plan is monotone");
        HOLDS(p->theta_per_count == 0 || i > DENSE || entry_of(plan, i) > entry_of(plan, i - 1) || exact > 0.999L,
              "the dense entries grow strictly until they saturate");
    }
}

static void check_plan(const dahl_plan_t *plan, const dahl_params_t *p)
{
    long double a = (long double)p->sigma0 / (long double)p->Fc * 1.44269504088896340736L;
    int is_far = plan->a_exponent < -0x300000; /* dahl.h: 0x600000 less */
    long double got = ldexpl((long double)plan->a_mantissa, plan->a_exponent + (is_far ? 0x600000 : 0));
    HOLDS(is_far == (a >= 0x1p62L || a < 0x1p-121L), "a plan is far if a/ln 2 is out of 2^-121 .. 2^62");
    HOLDS(plan->a_mantissa >> 31 == 1 && plan->Fc_mantissa >> 31 == 1, "mantissas are normalised");
    HOLDS(fabsl(got - a) <= 0x1p-31L * a, "a/ln 2 within a unit");
    HOLDS(dahl_torque(plan, &(dahl_state_t){(int64_t)1 << 62}) == p->Fc, "w = 1 gives Fc");
    HOLDS(dahl_torque(plan, &(dahl_state_t){-((int64_t)1 << 62)}) == -p->Fc, "w = -1 gives -Fc");
}

typedef struct {
    uint32_t elements;
    dahl_params_t of[DAHL_SLIP_MAX];
    float more; /* breakaway, or a ratio */
} given_t;

static dahl_err_t both(dahl_err_t a, dahl_err_t b)
{
    return a == DAHL_ERR_PARAM || b == DAHL_ERR_PARAM ? DAHL_ERR_PARAM : a == DAHL_OK ? b : a;
}

static dahl_err_t judge(const dahl_params_t *p)
{
    return p->theta_per_count == 0 ? DAHL_ERR_PARAM : fuzz_judge(p);
}

/* Both sides of the limits of a value, and of a travel if the two other values are 1. */
static float edge(fuzz_bytes_t *bytes)
{
    static const float ends[] = {DAHL_TORQUE_MIN, DAHL_TORQUE_MAX, 0x1p-30f, 0x1p20f, 0x1p-29f, 1.0f, 1.0f, 1.0f};
    static const float others[] = {0.0f, 1e-45f, 1e-40f, 1e19f, 0x1.fffffep31f, HUGE_VALF, NAN, 1.0f};
    const uint8_t which = fuzz_u8(bytes);
    const float end = ends[which & 7u], below = nextafterf(end, 0.0f), other = others[which & 7u];
    const float value = (which & 0x18u) == 0x18u ? other : which & 8u ? below : end;
    return which >> 5 == 7 ? -value : value;
}

static float any_value(fuzz_bytes_t *bytes, uint32_t kind)
{
    return kind == 0 ? fuzz_float_of(fuzz_u32(bytes)) : edge(bytes);
}

static given_t any_given(fuzz_bytes_t *bytes)
{
    const uint32_t elements = fuzz_u8(bytes), kind = fuzz_u8(bytes) % 4u; /* noise, edges, or mostly in range */
    given_t given = {.elements = elements == 255u ? UINT32_MAX : elements % 10u};
    for (uint32_t k = 0; k < DAHL_SLIP_MAX; k++) {
        dahl_params_t *one = &given.of[k];
        if (kind < 2) {
            one->sigma0 = any_value(bytes, kind);
            one->Fc = any_value(bytes, kind);
            one->theta_per_count = any_value(bytes, kind);
        } else {
            *one = fuzz_params(bytes);
            const int smaller = kind == 2 ? 0 : fuzz_u8(bytes) % 64, stiffer = kind == 2 ? 0 : fuzz_u8(bytes) % 4;
            one->sigma0 = k == 0 ? one->sigma0 : given.of[0].sigma0 * fuzz_scaled(fuzz_u32(bytes), stiffer - smaller);
            one->Fc = k == 0 ? one->Fc : given.of[0].Fc * fuzz_scaled(fuzz_u32(bytes), -smaller);
        }
        one->theta_per_count = given.of[0].theta_per_count;
    }
    given.more = kind < 2 ? any_value(bytes, kind) : fuzz_scaled(fuzz_u32(bytes), -1 - (int)(fuzz_u8(bytes) % 40u));
    return given;
}

static void check_untouched(const void *plan, size_t size)
{
    const uint8_t *bytes = (const uint8_t *)plan;
    for (size_t i = 0; i < size; i++) {
        HOLDS(bytes[i] == 0xA5, "a refusal leaves the plan unchanged");
    }
}

/* Throughput forms, alone and with a good channel before or after. A refusal changes nothing; good parameters get no rows. */
static void check_fast_forms(const dahl_params_t *p, int bad)
{
    const dahl_params_t without_counts = {p->sigma0, p->Fc, 0.0f};
    const dahl_err_t by_counts = judge(p), by_angle = fuzz_judge(&without_counts);
    const size_t rows = by_counts == DAHL_OK ? 0 : 1, rows_by_angle = by_angle == DAHL_OK ? 0 : 1;
    dahl_throughput_params_t all[2] = {{1, 1, 0.1}, {1, 1, 0.1}};
    all[bad] = (dahl_throughput_params_t){(double)p->sigma0, (double)p->Fc, (double)p->theta_per_count};
    dahl_state_t states[2] = {{77}, {78}};
    float out[2] = {-3.0f, -3.0f};
    HOLDS(dahl_throughput_counts(&all[bad], states, (int32_t[]){5, 6}, out, rows) == by_counts
              && dahl_throughput_counts_channels(all, states, 2, (int32_t[]){5, 6}, out, rows) == by_counts,
          "throughput forms by counts have the same limits");
    HOLDS(dahl_throughput(&all[bad], states, (float[]){0.5f, 0.6f}, out, rows_by_angle) == by_angle
              && dahl_throughput_channels(all, states, 2, (float[]){0.5f, 0.6f}, out, rows_by_angle) == by_angle,
          "throughput forms by angle have the same limits");
    HOLDS(states[0].w == 77 && states[1].w == 78 && out[0] == -3.0f && out[1] == -3.0f, "a refusal changes no state");
}

/* All forms of Dahl's element. Only dahl_prepare and the literal form accept a theta_per_count of 0. */
static void check_element(const dahl_params_t *p)
{
    const dahl_err_t wanted = fuzz_judge(p);
    dahl_float_plan_t literal;
    dahl_plan_t plan;
    memset(&plan, 0xA5, sizeof plan);
    memset(&literal, 0xA5, sizeof literal);
    HOLDS(dahl_prepare(&plan, p) == wanted, "the error code of dahl_prepare is right");
    HOLDS(dahl_float_prepare(&literal, p) == wanted, "the literal form has the same limits");
    if (wanted == DAHL_OK) {
        check_entries(&plan, p);
        check_plan(&plan, p);
    } else {
        check_untouched(&plan, sizeof plan);
        check_untouched(&literal, sizeof literal);
    }
}

static void check_model(dahl_err_t (*prepare)(any_plan_t *, const set_t *), const set_t *set, dahl_err_t wanted)
{
    static subject_t subject;
    any_plan_t plan;
    memset(&plan, 0xA5, sizeof plan);
    HOLDS(prepare(&plan, set) == wanted, "the error code of the model is right");
    if (wanted != DAHL_OK) {
        check_untouched(&plan, sizeof plan);
        return;
    }
    for (size_t i = 0; i < MODELS; i++) {
        if (models[i].prepare == prepare && subject_begin(&subject, &models[i], set)) {
            check_ends(&subject);
        }
    }
}

static dahl_err_t judge_breakaway(float b)
{
    return !(b > 0) || !isfinite(b) ? DAHL_ERR_PARAM : b < 1 ? DAHL_OK : DAHL_ERR_RANGE;
}

/* Both results keep their bounds on leaps. Then both ends are the sum of Fc, with a ratio of 1. */
static void check_slip(const dahl_slip_plan_t *plan, const dahl_slip_params_t *params)
{
    const long double sum = slip_reference_Fc(params);
    slip_reference_t exact = slip_reference(params);
    dahl_slip_state_t state = {{0}}, q30 = {{0}};
    motion_t motion = MOTION_START;
    for (int t = 0; t < 8; t++) {
        const int32_t d = motion_leap(&motion) / 4;
        const long double F = slip_reference_move(&exact, d);
        const long double ratio = dahl_slip_step_counts_q30(plan, &q30, d) * (long double)DAHL_Q30;
        HOLDS(fabsl((long double)dahl_slip_step_counts(plan, &state, d) - F) <= (long double)DAHL_ULP_PARTS * ulp_of_sum(sum),
              "slip: the torque is exact");
        HOLDS(fabsl(ratio - F / sum) <= (long double)DAHL_SLIP_ERROR_Q30, "slip: the ratio is exact");
    }
    for (int way = 1; way >= -1; way -= 2) {
        const int32_t far = way > 0 ? INT32_MAX : -INT32_MAX;
        (void)dahl_slip_step_counts(plan, &state, far);
        const float F = dahl_slip_step_counts(plan, &state, far);
        const long double slack = (float)sum == sum ? 0 : 0.55L * ulp_of_sum(sum);
        HOLDS(fabsl((long double)F - (long double)way * sum) <= slack, "slip: both ends are the sum of Fc");
        HOLDS(dahl_slip_step_counts_q30(plan, &state, 0) == way * (1 << 30), "slip: both ends are a ratio of 1");
    }
}

static void prepare_slip(const given_t *given)
{
    dahl_slip_params_t params = {given->elements, given->of[0].theta_per_count, {0}, {0}};
    dahl_slip_plan_t plan;
    dahl_err_t wanted = given->elements == 0 ? DAHL_ERR_PARAM : given->elements > DAHL_SLIP_MAX ? DAHL_ERR_RANGE : DAHL_OK;
    for (uint32_t k = 0; k < DAHL_SLIP_MAX; k++) {
        params.sigma0[k] = given->of[k].sigma0;
        params.Fc[k] = given->of[k].Fc;
        if (wanted != DAHL_ERR_PARAM && k < given->elements && given->elements <= DAHL_SLIP_MAX) {
            wanted = both(wanted, judge(&given->of[k]));
        }
    }
    memset(&plan, 0xA5, sizeof plan);
    HOLDS(dahl_slip_prepare(&plan, &params) == wanted, "slip: the error code is right");
    if (wanted != DAHL_OK) {
        check_untouched(&plan, sizeof plan);
    } else {
        check_slip(&plan, &params);
    }
}

static int is_table_value(float x)
{
    return x == 0 || (fabsf(x) >= DAHL_TORQUE_MIN && fabsf(x) < DAHL_TORQUE_MAX);
}

/* Straight lines between the values, constant beyond the last one. */
static long double table_torque(const dahl_velocity_params_t *p, int32_t dcounts)
{
    const long double end = DAHL_VELOCITY_SEGMENTS, segment = (long double)(1u << p->segment_bits);
    const long double x = fminl(fabsl((long double)dcounts) / segment, end);
    const int k = x < end ? (int)x : DAHL_VELOCITY_SEGMENTS - 1;
    const long double from = k == 0 ? 0 : (long double)p->torque[k - 1], to = (long double)p->torque[k];
    return (dcounts < 0 ? -1 : 1) * (from + (to - from) * (x - k));
}

static void check_table_at(const dahl_velocity_plan_t *plan, const dahl_velocity_params_t *params, long double largest,
                           int32_t dcounts)
{
    const long double exact = table_torque(params, dcounts), unit = 0x1p-30L * largest;
    const float F = dahl_velocity_torque(plan, dcounts);
    HOLDS(fabsl((long double)F - exact) <= 1.5L * unit + 0.51L * ulp_of(fabsf((float)exact)),
          "table: the torque is linear between the values");
    HOLDS(fabsl(dahl_velocity_torque_q30(plan, dcounts) * unit - exact) <= 1.5L * unit, "table: both forms agree");
    HOLDS(dcounts == INT32_MIN || dahl_velocity_torque(plan, -dcounts) == -F, "table: the torque is odd");
}

static void check_table(const dahl_velocity_plan_t *plan, const dahl_velocity_params_t *params, long double largest)
{
    motion_t motion = MOTION_START;
    for (uint32_t k = 0; k <= DAHL_VELOCITY_SEGMENTS + 1; k++) {
        check_table_at(plan, params, largest, (int32_t)(k << params->segment_bits));
        check_table_at(plan, params, largest, motion_leap(&motion)); /* the first one is INT32_MIN */
        check_table_at(plan, params, largest, (int32_t)(motion_random(&motion) % (17u << params->segment_bits)));
    }
    HOLDS(dahl_velocity_torque(plan, 0) == 0, "table: rest has no torque");
}

static void prepare_velocity(const given_t *given)
{
    dahl_velocity_params_t params = {given->elements < 5 ? 3 * given->elements : 17 + given->elements, {0}}; /* 0 .. 26 */
    dahl_velocity_plan_t plan;
    dahl_err_t wanted = params.segment_bits > 24 ? DAHL_ERR_RANGE : DAHL_OK;
    long double largest = 0;
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        float x = k % 2 ? -given->of[k / 2].sigma0 : given->of[k / 2].Fc;
        x = given->elements == 4 ? 0.0f : x; /* a table of zeros is valid */
        params.torque[k] = x;
        wanted = both(wanted, !isfinite(x) ? DAHL_ERR_PARAM : is_table_value(x) ? DAHL_OK : DAHL_ERR_RANGE);
        largest = fmaxl(largest, fabsl((long double)x));
    }
    memset(&plan, 0xA5, sizeof plan);
    HOLDS(dahl_velocity_prepare(&plan, &params) == wanted, "table: the error code is right");
    if (wanted != DAHL_OK) {
        check_untouched(&plan, sizeof plan);
    } else {
        check_table(&plan, &params, largest);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_bytes_t bytes = {data, size};
    const given_t given = any_given(&bytes);
    const dahl_params_t *one = &given.of[0];
    const set_t set = {*one, given.more};
    const dahl_params_t backward = {one->sigma0, one->Fc * given.more, one->theta_per_count};
    check_element(one);
    check_fast_forms(one, (int)(given.elements % 2u));
    check_model(model_with(MORE_IS_RATIO)->prepare, &set, both(judge(one), judge(&backward)));
    check_model(model_with(MORE_IS_BREAKAWAY)->prepare, &set, both(judge(one), judge_breakaway(given.more)));
    prepare_slip(&given);
    prepare_velocity(&given);
    return 0;
}
