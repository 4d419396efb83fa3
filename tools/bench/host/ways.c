/* SPDX-License-Identifier: MIT */
/* See ways.h. rivals.c is included, so that the compiler can inline each rival into its loop, as in a user program. */
#include "ways.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "rivals.c"

#define RATIOS(name) \
    static void name##_ratios(run_t *r, const int32_t *dcounts, const float *angles, double *w, size_t n)
#define TORQUES(name) \
    static void name##_torques(run_t *r, const int32_t *dcounts, const float *angles, float *F, size_t n)

#define RIVAL(name)                                                                         \
    RATIOS(name)                                                                            \
    {                                                                                       \
        (void)angles;                                                                       \
        for (size_t i = 0; i < n; i++) {                                                    \
            (void)rival_##name(&r->rival_plan, &r->rival_state, dcounts[i]);                \
            w[i] = (double)r->rival_state.w;                                                \
        }                                                                                   \
    }                                                                                       \
    TORQUES(name)                                                                           \
    {                                                                                       \
        rival_state_t state = r->rival_state;                                               \
        (void)angles;                                                                       \
        for (size_t i = 0; i < n; i++) {                                                    \
            F[i] = rival_##name(&r->rival_plan, &state, dcounts[i]);                        \
        }                                                                                   \
        r->rival_state = state;                                                             \
    }

#ifdef HAS_CORE_MATH
float cr_expm1f(float x);

static float rival_core_math(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    return move(plan, state, dcounts, -cr_expm1f(-travel(plan, dcounts)));
}
RIVAL(core_math)
#define CORE_MATH_WAY WAY(core_math, 0),
#else
#define CORE_MATH_WAY
#endif

RIVAL(expm1f)
RIVAL(expf)
RIVAL(exp_double)
RIVAL(expm1_double)
RIVAL(anchored)
RIVAL(direct)
RIVAL(euler)
RIVAL(rk4)
RIVAL(table)
RIVAL(table_counts)
RIVAL(backward_parts)
RIVAL(trapezoid_parts)
RIVAL(euler_parts)
RIVAL(rk4_parts)

/* The best alternative without this library: state and exponential in double. */
static double in_double(run_t *r, int32_t dcounts)
{
    r->w += ((dcounts < 0 ? -1.0 : 1.0) - r->w) * -expm1(-r->a * fabs((double)dcounts));
    return r->w;
}

TORQUES(double_state)
{
    (void)angles;
    for (size_t i = 0; i < n; i++) {
        F[i] = (float)((double)r->params.Fc * in_double(r, dcounts[i]));
    }
}

TORQUES(counts)
{
    (void)angles;
    for (size_t i = 0; i < n; i++) {
        F[i] = dahl_step_counts(&r->plan, &r->state, dcounts[i]);
    }
}

TORQUES(angle)
{
    (void)dcounts;
    for (size_t i = 0; i < n; i++) {
        F[i] = dahl_step(&r->plan, &r->state, angles[i]);
    }
}

TORQUES(batch_counts)
{
    (void)angles;
    dahl_batch_counts(&r->plan, &r->state, dcounts, F, n);
}

static dahl_throughput_params_t params_of(const run_t *r)
{
    dahl_throughput_params_t p = {(double)r->params.sigma0, (double)r->params.Fc, (double)r->params.theta_per_count};
    return p;
}

TORQUES(throughput_counts)
{
    dahl_throughput_params_t p = params_of(r);
    (void)angles;
    (void)dahl_throughput_counts(&p, &r->state, dcounts, F, n);
}

TORQUES(throughput_angle)
{
    dahl_throughput_params_t p = params_of(r);
    (void)dcounts;
    (void)dahl_throughput(&p, &r->state, angles, F, n);
}

TORQUES(counts_q30)
{
    (void)angles;
    for (size_t i = 0; i < n; i++) {
        int32_t q = dahl_step_counts_q30(&r->plan, &r->state, dcounts[i]);
        memcpy(&F[i], &q, 4);
    }
}

RATIOS(counts_q30)
{
    (void)angles;
    for (size_t i = 0; i < n; i++) {
        w[i] = (double)dahl_step_counts_q30(&r->plan, &r->state, dcounts[i]) * (double)DAHL_Q30;
    }
}

/* Methods that return a float torque: F/Fc of it. */
#define BY_TORQUE(name)                                                                     \
    RATIOS(name)                                                                            \
    {                                                                                       \
        for (size_t i = 0; i < n; i++) {                                                    \
            float F;                                                                        \
            name##_torques(r, dcounts + i, angles + i, &F, 1);                              \
            w[i] = (double)F / (double)r->params.Fc;                                        \
        }                                                                                   \
    }

#define BY_TORQUES(name)                                                                    \
    RATIOS(name)                                                                            \
    {                                                                                       \
        float *F = (float *)w + n; /* the upper half of the room for the result */          \
        name##_torques(r, dcounts, angles, F, n);                                           \
        for (size_t i = 0; i < n; i++) {                                                    \
            float torque;                                                                   \
            memcpy(&torque, (const char *)w + 4 * (n + i), 4);                              \
            w[i] = (double)torque / (double)r->params.Fc;                                   \
        }                                                                                   \
    }

BY_TORQUE(double_state)
BY_TORQUE(counts)
BY_TORQUE(angle)
BY_TORQUES(batch_counts)
BY_TORQUES(throughput_counts)
BY_TORQUES(throughput_angle)

/* Blocks of vector_exp.c. */
#define BY_BLOCKS(name)                                                                     \
    TORQUES(name)                                                                           \
    {                                                                                       \
        double w[VECTOR_BLOCK];                                                             \
        (void)angles;                                                                       \
        for (size_t done = 0; done < n; done += VECTOR_BLOCK) {                             \
            const size_t size = n - done < VECTOR_BLOCK ? n - done : VECTOR_BLOCK;          \
            name##_block(r, dcounts + done, w, size);                                       \
            for (size_t i = 0; i < size; i++) {                                             \
                F[done + i] = (float)((double)r->params.Fc * w[i]);                         \
            }                                                                               \
        }                                                                                   \
    }                                                                                       \
    BY_TORQUES(name)

BY_BLOCKS(vector_exp)
#ifdef HAS_SLEEF
BY_BLOCKS(sleef)
#define SLEEF_WAY WAY(sleef, 0),
#else
#define SLEEF_WAY
#endif

#define WAY(name, by_angle) {#name, name##_ratios, by_angle, name##_torques}

const way_t ways[] = {
    WAY(counts_q30, 0),      WAY(counts, 0),       WAY(angle, 1),          WAY(batch_counts, 0),   WAY(throughput_counts, 0),
    WAY(throughput_angle, 1), WAY(expm1f, 0),      WAY(expf, 0),           WAY(exp_double, 0),     WAY(expm1_double, 0),
    WAY(double_state, 0),    WAY(anchored, 0),     WAY(direct, 0),         WAY(euler, 0),          WAY(rk4, 0),
    WAY(table, 0),           WAY(table_counts, 0), WAY(backward_parts, 0), WAY(trapezoid_parts, 0), WAY(euler_parts, 0),
    WAY(rk4_parts, 0),       WAY(vector_exp, 0),   SLEEF_WAY CORE_MATH_WAY
};

const size_t ways_count = sizeof ways / sizeof ways[0];

const way_t *way_named(const char *name)
{
    for (size_t i = 0; i < ways_count; i++) {
        if (strcmp(ways[i].name, name) == 0) {
            return &ways[i];
        }
    }
    return NULL;
}

void start_run(run_t *run, const dahl_params_t *params, int32_t substeps)
{
    memset(run, 0, sizeof *run);
    run->params = *params;
    if (dahl_prepare(&run->plan, params) != DAHL_OK) {
        abort(); /* the scenarios' parameters are constants */
    }
    rival_prepare(&run->rival_plan, params->sigma0, params->Fc, params->theta_per_count);
    run->rival_plan.substeps = substeps;
    run->a = (double)params->sigma0 / (double)params->Fc * (double)params->theta_per_count;
}
