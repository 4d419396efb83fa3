/* SPDX-License-Identifier: MIT */
/*
 * The tips of a loop that goes to and fro by the same stroke for ever: each half of it takes g of the way from one tip to the
 * other side's Fc, so tip = -tip + (1 + tip) g, tip = g/(2 - g) = tanh(u/2), u the travel of the whole stroke.
 */
#include "../model/bristle_update.h"
#include "../model/torque.h"
#include "dahl_parts.h"

/* g of any counts, in Q64: what each digit takes of what is left. */
static uint64_t g_of(const dahl_plan_t *plan, uint32_t counts)
{
    const dahl_q64_t *entry = &plan->g[DAHL_DIRECT_COUNTS_MAX];
    const dahl_q64_t *low = &plan->g[counts % DAHL_DIRECT_COUNTS_MAX];
    uint64_t g = (uint64_t)low->hi << 32 | low->lo;
    for (uint32_t digits = counts / DAHL_DIRECT_COUNTS_MAX; digits != 0; digits >>= 1, entry++) {
        if (digits & 1) {
            g += dahl_mulhi64(~g, (uint64_t)entry->hi << 32 | entry->lo);
        }
    }
    return g;
}

float dahl_tip_torque(const dahl_plan_t *plan, uint32_t stroke)
{
    uint64_t g = g_of(plan, stroke);
    if (g == 0) {
        return 0.0f;
    }
    dahl_wide_t numerator = dahl_normalise(g, 0);                            /* g = mantissa 2^(exponent - 64) */
    uint32_t denominator = DAHL_TOP_BIT | (uint32_t)(~g >> 33);              /* (2 - g) 2^31 */
    uint64_t quotient = dahl_quotient_q63((uint32_t)(numerator.mantissa >> 32), denominator);
    return dahl_torque_of(plan, quotient >> (2 - numerator.exponent));       /* Q62 */
}
