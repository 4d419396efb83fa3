/* SPDX-License-Identifier: MIT */
/*
 * Any parameters and moves for each model of tests/lib/models.h. Parameters are accepted if and only if they are in range,
 * compared exactly in long double. A refusal leaves the plan unchanged. An accepted plan keeps the contract of
 * tests/lib/laws.h, and the entries of Dahl's plan are 1 - exp(-u). tests/lib has the laws of single models.
 */
#include "dahl_batch.h"
#include "dahl_float.h"
#include "plans.h"
#define HOLDS(condition, words) LAW(condition, words)
#include "../lib/laws.h"

enum { ENTRIES = 37, DENSE = 8, MOVES_MAX = 12 };

static const long double PREPARED = 0x1p-32L; /* relative error of an entry, lib/model/prepare.c */

/* --- parameters --------------------------------------------------------------------------------------------------- */

static dahl_err_t both(dahl_err_t a, dahl_err_t b)
{
    return a == DAHL_ERR_PARAM || b == DAHL_ERR_PARAM ? DAHL_ERR_PARAM : a == DAHL_OK ? b : a;
}

static dahl_err_t judge_moving(dahl_params_t p)
{
    return p.theta_per_count == 0 ? DAHL_ERR_PARAM : fuzz_judge(&p);
}

static dahl_err_t judge_slip(const set_t *set)
{
    const dahl_slip_params_t params = slip_params(set);
    dahl_err_t wanted = params.elements == 0 ? DAHL_ERR_PARAM : params.elements > DAHL_SLIP_MAX ? DAHL_ERR_RANGE : DAHL_OK;
    for (uint32_t k = 0; k < params.elements && params.elements <= DAHL_SLIP_MAX; k++) {
        const dahl_params_t one = {params.sigma0[k], params.Fc[k], params.theta_per_count};
        wanted = both(wanted, judge_moving(one));
    }
    return wanted;
}

static dahl_err_t judge_breakaway(float b)
{
    return !(b > 0) || !isfinite(b) ? DAHL_ERR_PARAM : b < 1 ? DAHL_OK : DAHL_ERR_RANGE;
}

/* The result that prepare must return. Only Dahl's element accepts a theta_per_count of 0. */
static dahl_err_t judge(const model_t *model, const set_t *set)
{
    const dahl_params_t p = set->p, backward = {p.sigma0, p.Fc * set->more, p.theta_per_count};
    const dahl_params_t element = {p.sigma0, p.Fc, model->by_angle ? 0 : p.theta_per_count};
    switch (model->more) {
    case MORE_IS_ELEMENTS: return judge_slip(set);
    case MORE_IS_RATIO: return both(judge_moving(p), judge_moving(backward));
    case MORE_IS_BREAKAWAY: return both(judge_moving(p), judge_breakaway(set->more));
    default: return fuzz_judge(&element);
    }
}

static void check_refusal(const model_t *model, const set_t *set)
{
    any_plan_t plan, untouched;
    memset(&plan, 0xA5, sizeof plan);
    untouched = plan;
    dahl_err_t wanted = judge(model, set);
    LAW(model->prepare(&plan, set) == wanted, "parameters are accepted if and only if they are in range");
    LAW(wanted == DAHL_OK || memcmp(&plan, &untouched, sizeof plan) == 0, "a refusal leaves the plan unchanged");
}

/* The other forms of Dahl's element have the same limits. */
static void check_forms(const dahl_params_t *p)
{
    const dahl_throughput_params_t wide = {(double)p->sigma0, (double)p->Fc, (double)p->theta_per_count};
    const dahl_err_t wanted = fuzz_judge(p);
    dahl_float_plan_t literal;
    dahl_state_t state = {0};
    LAW(dahl_float_prepare(&literal, p) == wanted, "the literal form has the same limits");
    LAW(p->theta_per_count == 0 || dahl_throughput_counts(&wide, &state, NULL, NULL, 0) == wanted, "the throughput form has the same limits");
}

static long double counts_of(int i)
{
    return i <= DENSE ? (long double)i : ldexpl(1.0L, i - DENSE + 3);
}

static void check_entries(const dahl_params_t *p)
{
    dahl_plan_t plan;
    uint64_t last = 0;
    if (dahl_prepare(&plan, p) != DAHL_OK) {
        return;
    }
    LAW(plan.g[0].hi == 0 && plan.g[0].lo == 0, "entry 0 is 0");
    for (int i = 1; i < ENTRIES; i++) {
        uint64_t entry = (uint64_t)plan.g[i].hi << 32 | plan.g[i].lo;
        long double exact = -expm1l(-fuzz_travel(p, (long double)p->theta_per_count) * counts_of(i));
        LAW(fabsl(ldexpl((long double)entry, -64) - exact) <= PREPARED * exact, "an entry is 1 - exp(-u) within 2^-32 of itself");
        LAW(entry >= last, "the plan is monotone");
        last = entry;
    }
}

/* --- a walk ------------------------------------------------------------------------------------------------------- */

static size_t any_moves(fuzz_bytes_t *bytes, move_t moves[MOVES_MAX])
{
    size_t count = 0;
    for (; count < MOVES_MAX && bytes->left > 0; count++) {
        uint32_t size = fuzz_u8(bytes) % 3u, value = fuzz_u32(bytes);
        moves[count].counts = size == 0 ? (int32_t)(value % 17u) - 8 : (int32_t)value >> (size == 1 ? 18 : 0);
        moves[count].load_q30 = fuzz_u32(bytes) >> (fuzz_u8(bytes) % 4u);
    }
    return count;
}

/* Without the mirrored walk, which may differ at ties. */
static void check_contract(model_t model, const set_t *set, const move_t *moves, size_t count)
{
    static subject_t subject;
    model.is_odd = model.is_split;
    if (subject_begin(&subject, &model, set)) {
        check_walk(&subject, moves, count);
        check_ends(&subject);
    }
}

static dahl_params_t any_params(fuzz_bytes_t *bytes, int is_noise)
{
    if (!is_noise) {
        return fuzz_params(bytes);
    }
    const uint32_t sigma0 = fuzz_u32(bytes), Fc = fuzz_u32(bytes), theta = fuzz_u32(bytes);
    return (dahl_params_t){fuzz_float_of(sigma0), fuzz_float_of(Fc), fuzz_float_of(theta)};
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_bytes_t bytes = {data, size};
    const uint32_t what = fuzz_u32(&bytes), is_noise = what % 4u == 0, value = fuzz_u32(&bytes);
    const dahl_params_t p = any_params(&bytes, is_noise);
    const float elements = (float)(what >> 2 & 15u), ratio = is_noise ? fuzz_float_of(value) : fuzz_scaled(value, (int)(what >> 24) % 9 - 5);
    const float breakaway = is_noise ? ratio : fuzz_scaled(value, -1 - (int)(what >> 16 & 31u));
    move_t moves[MOVES_MAX];
    const size_t count = any_moves(&bytes, moves);
    check_forms(&p);
    check_entries(&p);
    for (size_t i = 0; i < MODELS; i++) {
        const set_t set = {p, more_for(&models[i], elements, ratio, breakaway)};
        if (models[i].prepare != mix_prepare) { /* two calls */
            check_refusal(&models[i], &set);
        }
        if (judge_moving(p) == DAHL_OK && judge(&models[i], &set) == DAHL_OK) {
            check_contract(models[i], &set, moves, count);
        }
    }
    return 0;
}
