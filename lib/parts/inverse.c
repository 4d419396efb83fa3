/* SPDX-License-Identifier: MIT */
/*
 * From a torque back to counts, without a logarithm: the digits of the travel, highest first, each taken while it does not
 * reach the torque. A real move takes the digits the other way round, and rounds a little otherwise; so what the digits find is
 * checked by real moves, and corrected by a count where it rounds to the other side.
 */
#include "../model/bristle_update.h"
#include "../model/torque.h"
#include "dahl_parts.h"

#define COUNTS_MOST UINT32_C(0x7fffffff)
#define TOP_DIGIT 27 /* 8 counts times 2^27 */

/* Where to, and from where. Backward everything is mirrored: w is the complement (step_large.c). */
typedef struct {
    const dahl_plan_t *plan;
    uint64_t w;
    uint32_t target; /* as rank() has it */
    int is_backward;
} dahl_search_t;

/* Floats in their order, as unsigned integers; -0 is 0. */
static uint32_t rank(float F)
{
    uint32_t bits = dahl_bits_of(F);
    if ((bits & DAHL_BITS_MAGNITUDE) == 0) {
        return DAHL_TOP_BIT;
    }
    return (bits & DAHL_BITS_SIGN) != 0 ? ~bits : bits | DAHL_TOP_BIT;
}

static int has_reached(const dahl_search_t *search, uint64_t w)
{
    uint32_t here = rank(dahl_torque_of(search->plan, search->is_backward ? ~w : w));
    return search->is_backward ? here <= search->target : here >= search->target;
}

static int reaches(const dahl_search_t *search, uint32_t counts)
{
    dahl_state_t state = {(int64_t)(search->is_backward ? ~search->w : search->w)};
    (void)dahl_step_counts_q30(search->plan, &state, search->is_backward ? -(int32_t)counts : (int32_t)counts);
    return has_reached(search, search->is_backward ? ~(uint64_t)state.w : (uint64_t)state.w);
}

/* The most counts that do not reach the torque, as the digits find them. */
static uint32_t counts_below(const dahl_search_t *search)
{
    uint64_t w = search->w;
    uint32_t counts = 0;
    for (int digit = TOP_DIGIT; digit >= 0; digit--) {
        uint64_t further = dahl_forward(w, search->plan->g[DAHL_DIRECT_COUNTS_MAX + digit]);
        if (!has_reached(search, further)) {
            w = further;
            counts += (uint32_t)DAHL_DIRECT_COUNTS_MAX << digit;
        }
    }
    for (uint32_t low = DAHL_DIRECT_COUNTS_MAX - 1; low > 0; low--) {
        if (!has_reached(search, dahl_forward(w, search->plan->g[low]))) {
            return counts + low;
        }
    }
    return counts;
}

/* The least counts that reach it. What the digits find is at most a count or two off: a float's spacing is far wider than the
 * 2^-61 by which two ways of taking the digits differ. Counts of none never reach, the most ever do. */
static uint32_t least_counts(const dahl_search_t *search)
{
    uint32_t below = counts_below(search);
    while (reaches(search, below)) {
        below--;
    }
    while (!reaches(search, below + 1)) {
        below++;
    }
    return below + 1;
}

dahl_err_t dahl_counts_to_torque(const dahl_plan_t *plan, const dahl_state_t *state, float F, int32_t *dcounts)
{
    uint64_t w = (uint64_t)state->w;
    uint32_t here = rank(dahl_torque_of(plan, w)), target = rank(F);
    dahl_search_t search = {plan, target < here ? ~w : w, target, target < here};
    if ((dahl_bits_of(F) & DAHL_BITS_MAGNITUDE) >= DAHL_BITS_INF) {
        return DAHL_ERR_PARAM;
    }
    if (target != here && !reaches(&search, COUNTS_MOST)) {
        return DAHL_ERR_RANGE;
    }
    uint32_t counts = target == here ? 0 : least_counts(&search);
    *dcounts = search.is_backward ? -(int32_t)counts : (int32_t)counts;
    return DAHL_OK;
}
