/* SPDX-License-Identifier: MIT */
/** Torque at the tips of the steady loop of a constant stroke. Each half of the loop closes the fraction g of the
 * gap from one tip to Fc of the other side. Hence tip = -tip + (1 + tip) g, or tip = g/(2 - g) = tanh(u/2), with u
 * the travel of the stroke. */
#include "../model/bristle_update.h"
#include "../model/torque.h"
#include "dahl_parts.h"

/** Return 2 g of any counts, in Q62: the move of w from -1, digit by digit, until it saturates. */
static uint64_t twice_g(const dahl_plan_t *plan, uint32_t counts)
{
    const dahl_q64_t *entry = &plan->g[DAHL_DIRECT_COUNTS_MAX];
    uint64_t w = dahl_forward(0u - DAHL_ONE_Q62, plan->g[counts % DAHL_DIRECT_COUNTS_MAX]);
    for (uint32_t digits = counts / DAHL_DIRECT_COUNTS_MAX; digits != 0 && dahl_q30(w) != DAHL_ONE_Q30; digits >>= 1, entry++) {
        if (digits & 1) {
            w = dahl_forward(w, *entry);
        }
    }
    return w + DAHL_ONE_Q62;
}

/** tip = 2 g/(4 - 2 g). A count travels at least 2^-30, so the upper word of 2 g is 0 only if the stroke is 0. */
float dahl_tip_torque(const dahl_plan_t *plan, uint32_t stroke)
{
    const dahl_real_t Fc = {plan->Fc_mantissa | 1, plan->Fc_exponent};
    uint64_t way = twice_g(plan, stroke), denominator = (0u - way) >> 1;
    uint32_t high = (uint32_t)(way >> 32), low = (uint32_t)way;
    if (high == 0) {
        return 0.0f;
    }
    uint32_t zeros = dahl_leading_zeros(high);
    /* the 32 leading bits of 2 g, times 2^(zeros - 1) */
    uint64_t numerator = (uint64_t)(high << zeros | low >> 1 >> (31 - zeros)) << 31;
    if (numerator >= denominator) {
        numerator >>= 1;
        zeros--;
    }
    return dahl_float_of(dahl_torque_bits(Fc, (uint32_t)dahl_quotient(numerator, denominator, 32), zeros + 2));
}
