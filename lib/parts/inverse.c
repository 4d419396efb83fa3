/* SPDX-License-Identifier: MIT */
/**
 * Counts from a torque, without a logarithm.
 *
 * Let d = Fc - F be the gap in the direction of travel; n counts leave d exp(-n u). The binary digits of n, highest
 * first, are those that leave more than the gap of the target. A real move applies its digits in the opposite order
 * and rounds differently. The digits therefore give a guess, usually right, and real moves decide. They also clamp
 * a state out of range, for which the guess is arbitrary.
 *
 * docs/accuracy.md derives DAHL_INVERSE_ERROR.
 */
#include "../model/bristle_update.h"
#include "../model/torque.h"
#include "dahl_parts.h"
#include "shift.h"

#define COUNTS_MAX UINT32_C(0x7fffffff)
#define TOP_DIGIT 30

/** Start and target. Torques are ordered (order_of) in the direction of travel. */
typedef struct {
    const dahl_plan_t *plan;
    dahl_state_t state;
    int32_t direction; /* 1 or -1 */
    int32_t target;
} dahl_search_t;

/** Map floats to integers in the same order. -F gives the negative. */
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

/** Return the gap of the state, in units of 2^-30 of the last bit of the mantissa of Fc. */
static uint64_t gap_of_state(const dahl_search_t *search)
{
    uint64_t w = (uint64_t)search->state.w, gap = DAHL_ONE_Q62 - (search->direction < 0 ? 0u - w : w);
    return dahl_mul_fraction(search->plan->Fc_mantissa, (uint32_t)(gap >> 32), (uint32_t)gap);
}

/** Return the gap of the least torque that rounds to the target: half-way from the float before. */
static uint64_t gap_of_target(const dahl_search_t *search)
{
    uint32_t before = (uint32_t)(search->target > 0 ? search->target - 1 : -search->target);
    dahl_real_t F = dahl_real_of(before);
    uint64_t Fc = (uint64_t)search->plan->Fc_mantissa << 30;
    uint64_t size = dahl_shift_right((uint64_t)(F.mantissa | 128) << 30, (uint32_t)(search->plan->Fc_exponent - F.exponent));
    return search->target > 0 ? Fc - size : Fc + size;
}

/** Return the fraction of the gap that 2^digit counts close. */
static inline dahl_q64_t g_of_digit(const dahl_plan_t *plan, int digit)
{
    return plan->g[digit < 3 ? 1 << digit : DAHL_DIRECT_COUNTS_MAX - 3 + digit];
}

/** Return the largest number of counts that does not reach the torque, as the digits find it. */
static uint32_t guess_below(const dahl_search_t *search)
{
    const uint64_t target_gap = gap_of_target(search);
    uint64_t gap = gap_of_state(search);
    uint32_t counts = 0;
    for (int digit = TOP_DIGIT; digit >= 0; digit--) {
        dahl_q64_t g = g_of_digit(search->plan, digit);
        uint64_t next = gap - dahl_mul_fraction(dahl_q30(gap), g.hi, g.lo);
        if ((int64_t)next > (int64_t)target_gap) { /* signed: if the gap was rounded up, the product may pass 0 */
            gap = next;
            counts += UINT32_C(1) << digit;
        }
    }
    return counts;
}

static uint32_t limit_step(uint32_t step, uint32_t below, uint32_t above)
{
    uint32_t half = (above - below) / 2;
    return step < half ? step : half;
}

/** Return counts that reach the target although one less does not, or more than COUNTS_MAX. The steps from the
 * guess grow until two moves enclose the result; then they halve the distance. */
static uint32_t search_counts(const dahl_search_t *search, uint32_t guess)
{
    uint32_t below = 0, above = COUNTS_MAX + 1, probe = guess;
    for (uint32_t step = 1; above - below > 1; step = 2 * step + 1) {
        if (reaches(search, probe)) {
            above = probe;
            probe -= limit_step(step, below, above);
        } else {
            below = probe;
            probe += limit_step(step, below, above);
        }
    }
    return above;
}

static int is_beyond_Fc(const dahl_search_t *search)
{
    const dahl_state_t at_Fc = {(int64_t)DAHL_ONE_Q62};
    return search->target > order_of(dahl_torque(search->plan, &at_Fc));
}

dahl_err_t dahl_counts_to_torque(const dahl_plan_t *plan, const dahl_state_t *state, float F, int32_t *dcounts)
{
    int32_t present = order_of(dahl_torque(plan, state)), target = order_of(F), direction = target < present ? -1 : 1;
    const dahl_search_t search = {plan, *state, direction, direction * target};
    uint32_t counts = 0;
    if ((dahl_bits_of(F) & DAHL_BITS_MAGNITUDE) >= DAHL_BITS_INF) {
        return DAHL_ERR_PARAM;
    }
    if (target != present) {
        counts = is_beyond_Fc(&search) ? COUNTS_MAX + 1 : search_counts(&search, guess_below(&search));
    }
    if (counts > COUNTS_MAX) {
        return DAHL_ERR_RANGE;
    }
    *dcounts = direction * (int32_t)counts;
    return DAHL_OK;
}
