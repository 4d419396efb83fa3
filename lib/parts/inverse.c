/* SPDX-License-Identifier: MIT */
/*
 * From a torque back to counts, without a logarithm. In the direction of travel let d = Fc - F be what the torque lacks of Fc: n
 * counts leave d exp(-n u) of it. So n has the binary digits, highest first, that leave more than the wanted torque lacks.
 * A real move takes its digits the other way round and rounds a little otherwise: what the digits find is a guess, mostly right,
 * and real moves decide. (They clamp a state out of range, for which the digits find any counts.)
 * Two moves from one state err by E = 2^-31 + 2^-62/u <= 7e-10 of Fc each (docs/accuracy.md), so the exact torque of a shorter
 * one is below that of a longer one, and the returned torque below it but for 2 E: DAHL_INVERSE_ERROR.
 */
#include "../model/bristle_update.h"
#include "../model/torque.h"
#include "dahl_parts.h"
#include "shift.h"

#define COUNTS_MOST UINT32_C(0x7fffffff)
#define TOP_DIGIT 30

/* From where and to where: torques by their order, in the direction of travel. */
typedef struct {
    const dahl_plan_t *plan;
    dahl_state_t state;
    int32_t direction; /* 1 or -1 */
    int32_t target;
} dahl_search_t;

/* Floats in their order, as integers: one more is the next float, and the negative is that of -F. */
static int32_t order_of(float F)
{
    uint32_t bits = dahl_bits_of(F), magnitude = bits & DAHL_BITS_MAGNITUDE;
    return (bits & DAHL_BITS_SIGN) != 0 ? -(int32_t)magnitude : (int32_t)magnitude;
}

static int reaches(const dahl_search_t *search, uint32_t counts)
{
    dahl_state_t state = search->state;
    float F = dahl_step_counts(search->plan, &state, search->direction * (int32_t)counts);
    return search->direction * order_of(F) >= search->target;
}

/* What the torque of the state lacks of Fc, in units of 2^-30 of the last bit of Fc's mantissa. */
static uint64_t lacks(const dahl_search_t *search)
{
    uint64_t w = (uint64_t)search->state.w, gap = DAHL_ONE_Q62 - (search->direction < 0 ? 0u - w : w);
    return dahl_mul_fraction(search->plan->Fc_mantissa, (uint32_t)(gap >> 32), (uint32_t)gap);
}

/* The same of the least torque that is rounded to the target: half-way to it from the float before. */
static uint64_t target_lacks(const dahl_search_t *search)
{
    uint32_t before = (uint32_t)(search->target > 0 ? search->target - 1 : -search->target);
    dahl_real_t F = dahl_real_of(before);
    uint64_t Fc = (uint64_t)search->plan->Fc_mantissa << 30;
    uint64_t size = dahl_shifted_right((uint64_t)(F.mantissa | 128) << 30, (uint32_t)(search->plan->Fc_exponent - F.exponent));
    return search->target > 0 ? Fc - size : Fc + size;
}

/* What a power of two counts takes of what is lacking. */
static inline dahl_q64_t taken_by_digit(const dahl_plan_t *plan, int digit)
{
    return plan->g[digit < 3 ? 1 << digit : DAHL_DIRECT_COUNTS_MAX - 3 + digit];
}

/* The most counts that do not reach the torque, as the digits find them. */
static uint32_t counts_below(const dahl_search_t *search)
{
    const uint64_t wanted = target_lacks(search);
    uint64_t left = lacks(search);
    uint32_t counts = 0;
    for (int digit = TOP_DIGIT; digit >= 0; digit--) {
        dahl_q64_t g = taken_by_digit(search->plan, digit);
        uint64_t further = left - dahl_mul_fraction(dahl_q30(left), g.hi, g.lo);
        if ((int64_t)further > (int64_t)wanted) { /* a product of a gap that was rounded up may pass 0 */
            left = further;
            counts += UINT32_C(1) << digit;
        }
    }
    return counts;
}

/* A step from one of two moves to between them, half-way at most. */
static uint32_t between(uint32_t step, uint32_t below, uint32_t reached)
{
    uint32_t half = (reached - below) / 2;
    return step < half ? step : half;
}

/* Counts that reach it if one count less does not, or more than COUNTS_MOST. From a guess the search makes growing steps until
 * the result is between two moves, then halves the distance. */
static uint32_t first_counts(const dahl_search_t *search, uint32_t guess)
{
    uint32_t below = 0, reached = COUNTS_MOST + 1, probe = guess;
    for (uint32_t step = 1; reached - below > 1; step = 2 * step + 1) {
        if (reaches(search, probe)) {
            reached = probe;
            probe -= between(step, below, reached);
        } else {
            below = probe;
            probe += between(step, below, reached);
        }
    }
    return reached;
}

static int is_beyond_Fc(const dahl_search_t *search)
{
    const dahl_state_t at_Fc = {(int64_t)DAHL_ONE_Q62};
    return search->target > order_of(dahl_torque(search->plan, &at_Fc));
}

dahl_err_t dahl_counts_to_torque(const dahl_plan_t *plan, const dahl_state_t *state, float F, int32_t *dcounts)
{
    int32_t here = order_of(dahl_torque(plan, state)), target = order_of(F), direction = target < here ? -1 : 1;
    const dahl_search_t search = {plan, *state, direction, direction * target};
    uint32_t counts = 0;
    if ((dahl_bits_of(F) & DAHL_BITS_MAGNITUDE) >= DAHL_BITS_INF) {
        return DAHL_ERR_PARAM;
    }
    if (target != here) {
        counts = is_beyond_Fc(&search) ? COUNTS_MOST + 1 : first_counts(&search, counts_below(&search));
    }
    if (counts > COUNTS_MOST) {
        return DAHL_ERR_RANGE;
    }
    *dcounts = direction * (int32_t)counts;
    return DAHL_OK;
}
