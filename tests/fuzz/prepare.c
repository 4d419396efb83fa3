/* SPDX-License-Identifier: MIT */
/*
 * Any 12 bytes as parameters: accepted iff in range, by an exact comparison in long double (products of two mantissas of
 * 24 bits fit), and a plan whose entries are 1 - exp(-u) and grow.
 */
#include "dahl_batch.h"
#include "dahl_float.h"
#include "plans.h"

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
    LAW(entry_of(plan, 0) == 0, "no counts, no travel");
    for (int i = 1; i < ENTRIES; i++) {
        long double exact = -expm1l(-travel * counts_of(i)), got = ldexpl((long double)entry_of(plan, i), -64);
        LAW(fabsl(got - exact) <= PREPARED * exact, "an entry is 1 - exp(-u) within 2^-32 of itself");
        LAW(entry_of(plan, i) >= entry_of(plan, i - 1), "the plan is monotone");
        LAW(p->theta_per_count == 0 || i > DENSE || entry_of(plan, i) > entry_of(plan, i - 1) || exact > 0.999L,
            "more counts, more travel, while there is any left");
    }
}

static void check_plan(const dahl_plan_t *plan, const dahl_params_t *p)
{
    long double a = (long double)p->sigma0 / (long double)p->Fc * 1.44269504088896340736L;
    long double got = ldexpl((long double)plan->a_mantissa, plan->a_exponent);
    LAW(plan->a_mantissa >> 31 == 1 && plan->Fc_mantissa >> 31 == 1, "mantissas have their top bit set");
    LAW(fabsl(got - a) <= 0x1p-31L * a, "a/ln 2 within a unit");
    LAW(dahl_torque(plan, &(dahl_state_t){(int64_t)1 << 62}) == p->Fc, "all of w is Fc");
    LAW(dahl_torque(plan, &(dahl_state_t){-((int64_t)1 << 62)}) == -p->Fc, "all of -w is -Fc");
}

/* The other forms take and refuse the same. Counts of none are for dahl_prepare only. */
static void check_others(const dahl_params_t *p, dahl_err_t err)
{
    dahl_float_plan_t literal;
    dahl_state_t state = {0};
    const dahl_throughput_params_t wide = {(double)p->sigma0, (double)p->Fc, (double)p->theta_per_count};
    LAW(dahl_float_prepare(&literal, p) == err, "the literal form has the same limits");
    if (p->theta_per_count != 0) {
        LAW(dahl_throughput_counts(&wide, &state, NULL, NULL, 0) == err, "the throughput form has the same limits");
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_bytes_t bytes = {data, size};
    dahl_params_t params;
    dahl_plan_t plan, untouched;
    uint32_t words[3] = {fuzz_u32(&bytes), fuzz_u32(&bytes), fuzz_u32(&bytes)};
    memcpy(&params, words, sizeof params);
    if (fuzz_u8(&bytes) & 1u) { /* noise is seldom in range */
        params = fuzz_params(&(fuzz_bytes_t){data, size});
    }
    memset(&untouched, 0xA5, sizeof untouched);
    plan = untouched;
    dahl_err_t err = dahl_prepare(&plan, &params);
    LAW(err == fuzz_judge(&params), "accepts iff in range, and says why not");
    if (err == DAHL_OK) {
        check_entries(&plan, &params);
        check_plan(&plan, &params);
    } else {
        LAW(memcmp(&plan, &untouched, sizeof plan) == 0, "what is refused leaves the plan untouched");
    }
    check_others(&params, err);
    return 0;
}
