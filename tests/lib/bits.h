/* SPDX-License-Identifier: MIT */
/*
 * Golden bits: for each hard motion, by counts and by angle, a 64-bit hash (FNV-1a) of each plan word, torque, Q30 value and
 * state over 1e5 ticks. Every compiler, flag and core must print the lines of golden_bits.txt. Floats pass through memory, so
 * that no flag changes the input.
 */
#ifndef BITS_H
#define BITS_H

#include "dahl.h"
#include "motions.h"

#ifndef BITS_TICKS /* of golden_bits.txt */
#define BITS_TICKS 100000
#endif

/* sigma0, Fc, theta_per_count: travel of one count near 1e-8, 1e-4, 0.3, 20. */
static const dahl_params_t bits_params[] = {
    {0x1.08p-20f, 0x1.2fd8aep-5f, 0x1.8e757ap-12f},
    {0x1.8p-1f, 0x1.5e978ep+1f, 0x1.8e757ap-12f},
    {0x1.ap+10f, 0x1.5e978ep+1f, 0x1.8e757ap-11f},
    {0x1.d4c000p+16f, 0x1.5e978ep+1f, 0x1.d8e75ap-12f},
};

#define BITS_PARAMS (sizeof bits_params / sizeof bits_params[0])
#define BITS_RUNS (BITS_PARAMS * MOTIONS * 2)

static inline uint64_t bits_fold(uint64_t hash, uint64_t word)
{
    for (int byte = 0; byte < 8; byte++) {
        hash = (hash ^ (word & 0xffu)) * 1099511628211u;
        word >>= 8;
    }
    return hash;
}

static inline uint32_t bits_of_float(float x)
{
    union {
        float f;
        uint32_t u;
    } both;
    both.f = x;
    return both.u;
}

static inline uint64_t bits_fold_plan(uint64_t hash, const dahl_plan_t *plan)
{
    for (unsigned n = 0; n < sizeof plan->g / sizeof plan->g[0]; n++) {
        hash = bits_fold(hash, (uint64_t)plan->g[n].hi << 32 | plan->g[n].lo);
    }
    /* The hashes fold these words in another form than the plan has. */
    uint32_t a_shift = (uint32_t)(94 - plan->a_exponent), Fc_scale = (uint32_t)(plan->Fc_exponent + 159) << 24 | 1u;
    hash = bits_fold(hash, (uint64_t)plan->a_mantissa << 32 | plan->Fc_mantissa | 1u);
    return bits_fold(hash, (uint64_t)a_shift << 32 | Fc_scale);
}

static inline uint64_t bits_by_counts(uint64_t hash, const dahl_plan_t *plan, motion_fn next)
{
    dahl_state_t torque = {0}, q30 = {0};
    motion_t motion = MOTION_START;
    for (int32_t t = 0; t < BITS_TICKS; t++) {
        int32_t d = next(&motion);
        hash = bits_fold(hash, bits_of_float(dahl_step_counts(plan, &torque, d)));
        hash = bits_fold(hash, (uint32_t)dahl_step_counts_q30(plan, &q30, d));
        hash = bits_fold(hash, (uint64_t)q30.w);
    }
    return hash;
}

static inline uint64_t bits_by_angle(uint64_t hash, const dahl_plan_t *plan, float theta, motion_fn next)
{
    dahl_state_t state = {0};
    motion_t motion = MOTION_START;
    for (int32_t t = 0; t < BITS_TICKS; t++) {
        volatile float counts = (float)next(&motion);
        volatile float dtheta = counts * theta;
        hash = bits_fold(hash, bits_of_float(dahl_step(plan, &state, dtheta)));
        hash = bits_fold(hash, (uint64_t)state.w);
    }
    return hash;
}

static inline uint64_t bits_run(unsigned run)
{
    const dahl_params_t *params = &bits_params[run % BITS_PARAMS];
    motion_fn next = motions[run / BITS_PARAMS % MOTIONS].next;
    dahl_plan_t plan;
    if (dahl_prepare(&plan, params) != DAHL_OK) {
        return 0;
    }
    uint64_t hash = bits_fold_plan(14695981039346656037u, &plan);
    return run < BITS_RUNS / 2 ? bits_by_counts(hash, &plan, next) : bits_by_angle(hash, &plan, params->theta_per_count, next);
}

#endif
