/* SPDX-License-Identifier: MIT */
/*
 * Any bytes as parameters of the parts: accepted iff in range, by exact comparisons in long double; what is refused leaves the
 * plan untouched; and all the way in one direction is that direction's Fc.
 */
#include "dahl_parts.h"
#include "plans.h"

enum { FAR = 32 }; /* moves of INT32_MAX: 64 presliding lengths at least */

typedef struct {
    uint32_t elements;
    dahl_params_t of[DAHL_SLIP_MAX];
    float theta_per_count; /* of all */
    float last;            /* breakaway */
} given_t;

static dahl_err_t both(dahl_err_t a, dahl_err_t b)
{
    return a == DAHL_ERR_PARAM || b == DAHL_ERR_PARAM ? DAHL_ERR_PARAM : a == DAHL_OK ? b : a;
}

/* Parts move by counts only. */
static dahl_err_t judge(const dahl_params_t *p)
{
    return p->theta_per_count == 0 ? DAHL_ERR_PARAM : fuzz_judge(p);
}

/* Noise, or numbers that are seldom out of range. */
static given_t any_given(fuzz_bytes_t *bytes)
{
    given_t given = {.elements = fuzz_u8(bytes) % 10u};
    int is_noise = fuzz_u8(bytes) % 4u == 0;
    for (uint32_t k = 0; k < DAHL_SLIP_MAX; k++) {
        dahl_params_t *one = &given.of[k];
        if (is_noise) {
            one->sigma0 = fuzz_float_of(fuzz_u32(bytes));
            one->Fc = fuzz_float_of(fuzz_u32(bytes));
            one->theta_per_count = fuzz_float_of(fuzz_u32(bytes));
        } else {
            *one = fuzz_params(bytes);
            one->sigma0 = k == 0 ? one->sigma0 : given.of[0].sigma0 * fuzz_scaled(fuzz_u32(bytes), 0);
            one->Fc = k == 0 ? one->Fc : given.of[0].Fc * fuzz_scaled(fuzz_u32(bytes), 0);
        }
        one->theta_per_count = given.of[0].theta_per_count;
    }
    given.theta_per_count = given.of[0].theta_per_count;
    given.last = is_noise ? fuzz_float_of(fuzz_u32(bytes)) : fuzz_scaled(fuzz_u32(bytes), -1 - (int)(fuzz_u8(bytes) % 40u));
    return given;
}

static void check_untouched(const void *plan, size_t size)
{
    const uint8_t *bytes = (const uint8_t *)plan;
    for (size_t i = 0; i < size; i++) {
        LAW(bytes[i] == 0xA5, "what is refused leaves the plan untouched");
    }
}

/* Within 0.55 ulp of Fc, whatever its sign. */
static void check_end(float F, long double Fc)
{
    long double ulp = ldexpl(1.0L, ilogbl(Fc) - 23);
    LAW(fabsl((long double)F - Fc) <= 0.55L * ulp, "all the way is Fc");
}

static void prepare_slip(const given_t *given)
{
    dahl_slip_params_t params = {given->elements, given->theta_per_count, {0}, {0}};
    dahl_slip_plan_t plan;
    dahl_slip_state_t state = {{0}};
    dahl_err_t wanted = given->elements == 0 ? DAHL_ERR_PARAM : given->elements > DAHL_SLIP_MAX ? DAHL_ERR_RANGE : DAHL_OK;
    long double sum = 0;
    for (uint32_t k = 0; k < DAHL_SLIP_MAX; k++) {
        params.sigma0[k] = given->of[k].sigma0;
        params.Fc[k] = given->of[k].Fc;
        if (wanted != DAHL_ERR_PARAM && k < given->elements && given->elements <= DAHL_SLIP_MAX) {
            wanted = both(wanted, judge(&given->of[k]));
            sum += (long double)given->of[k].Fc;
        }
    }
    memset(&plan, 0xA5, sizeof plan);
    LAW(dahl_slip_prepare(&plan, &params) == wanted, "slip: accepts iff in range, and says why not");
    if (wanted != DAHL_OK) {
        check_untouched(&plan, sizeof plan);
        return;
    }
    check_end(dahl_slip_step_counts(&plan, &state, INT32_MAX), sum);
    check_end(dahl_slip_step_counts(&plan, &state, INT32_MIN), -sum);
}

static void prepare_asymmetric(const given_t *given)
{
    const dahl_params_t *forward = &given->of[0];
    const dahl_params_t backward = {forward->sigma0, given->of[1].Fc, given->theta_per_count};
    const dahl_asymmetric_params_t params = {forward->sigma0, forward->Fc, backward.Fc, given->theta_per_count};
    dahl_asymmetric_plan_t plan;
    dahl_state_t state = {0};
    dahl_err_t wanted = both(judge(forward), judge(&backward));
    memset(&plan, 0xA5, sizeof plan);
    LAW(dahl_asymmetric_prepare(&plan, &params) == wanted, "asymmetric: accepts iff in range, and says why not");
    if (wanted != DAHL_OK) {
        check_untouched(&plan, sizeof plan);
        return;
    }
    float larger = fmaxf(forward->Fc, backward.Fc), F = 0;
    for (int i = 0; i < FAR; i++) {
        F = dahl_asymmetric_step_counts(&plan, &state, INT32_MAX);
    }
    LAW(fabsl((long double)F - (long double)forward->Fc) <= 0x1p-23L * (long double)larger, "forward ends at Fc_forward");
    for (int i = 0; i < FAR; i++) {
        F = dahl_asymmetric_step_counts(&plan, &state, -INT32_MAX);
    }
    LAW(fabsl((long double)F + (long double)backward.Fc) <= 0x1p-23L * (long double)larger, "backward ends at -Fc_backward");
}

static dahl_err_t judge_breakaway(float b)
{
    return !(b > 0) || !isfinite(b) ? DAHL_ERR_PARAM : b < 1 ? DAHL_OK : DAHL_ERR_RANGE;
}

static void prepare_elastoplastic(const given_t *given)
{
    dahl_elastoplastic_plan_t plan;
    dahl_state_t state = {0};
    dahl_err_t wanted = both(judge(&given->of[0]), judge_breakaway(given->last));
    float F = 0;
    memset(&plan, 0xA5, sizeof plan);
    LAW(dahl_elastoplastic_prepare(&plan, &given->of[0], given->last) == wanted, "elasto-plastic: accepts iff in range");
    if (wanted != DAHL_OK) {
        check_untouched(&plan, sizeof plan);
        return;
    }
    for (int i = 0; i < FAR; i++) {
        F = dahl_elastoplastic_step_counts(&plan, &state, -INT32_MAX);
    }
    check_end(F, -(long double)given->of[0].Fc);
}

static int is_table_value(float x)
{
    return x == 0 || (fabsf(x) >= DAHL_TORQUE_MIN && fabsf(x) < DAHL_TORQUE_MAX);
}

static void check_table(const dahl_velocity_plan_t *plan, const dahl_velocity_params_t *params, long double largest)
{
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        int32_t counts = (int32_t)((uint32_t)(k + 1) << params->segment_bits);
        float F = dahl_velocity_torque(plan, counts);
        LAW(fabsl((long double)F - (long double)params->torque[k]) <= (0x1p-31L + 0x1p-24L) * largest, "a value of the table");
        LAW(dahl_velocity_torque(plan, -counts) == -F, "a table is odd");
    }
    LAW(dahl_velocity_torque(plan, 0) == 0, "rest has none");
}

static void prepare_velocity(const given_t *given)
{
    dahl_velocity_params_t params = {given->elements * 3, {0}};
    dahl_velocity_plan_t plan;
    dahl_err_t wanted = params.segment_bits > 24 ? DAHL_ERR_RANGE : DAHL_OK;
    long double largest = 0;
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        float x = k % 2 ? -given->of[k / 2].sigma0 : given->of[k / 2].Fc;
        params.torque[k] = x;
        wanted = both(wanted, !isfinite(x) ? DAHL_ERR_PARAM : is_table_value(x) ? DAHL_OK : DAHL_ERR_RANGE);
        largest = fmaxl(largest, fabsl((long double)x));
    }
    memset(&plan, 0xA5, sizeof plan);
    LAW(dahl_velocity_prepare(&plan, &params) == wanted, "table: accepts iff in range, and says why not");
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
    prepare_slip(&given);
    prepare_asymmetric(&given);
    prepare_elastoplastic(&given);
    prepare_velocity(&given);
    return 0;
}
