/* SPDX-License-Identifier: MIT */
/**
 * Elements in parallel, in double: Dahl elements by the scan of fast_scan.h, slip elements by another scan. Each
 * adds its torque to those of a block of ticks. The sum is rounded once.
 *
 * @par Scan of slip elements
 * The deflection x, in counts, is clamped to +-L after every tick, with L = Fc/(sigma0 theta_per_count). A tick is
 * a map x -> min(high, max(low, x + d)), and so are several ticks in a row; low and high are the results for x = -L
 * and L. The scan computes the maps of groups of ticks, then x at the start of each group, then x of every tick.
 *
 * @par Error
 * The only error of x is that of L, 2^-52 of L. All of x, low and high are integer multiples of the last bit of L,
 * and so is one count, since L <= 2^30. If a sum of them is inexact, it is beyond L and is clamped. No error
 * accumulates.
 */
#include <string.h>

#include "fast_scan.h"

#define LANES 8

/** Up to LANES slip elements, so that the serial part runs for all of them at once. */
typedef struct {
    dahl_throughput_element_t *element[LANES];
    size_t used;
    double x[LANES], limit[LANES], torque_per_count[LANES];
    double low[LANES][GROUPS], high[LANES][GROUPS], start[LANES][GROUPS]; /* map of each group, and x before it */
} lanes_t;

typedef struct {
    double count[GROUP][GROUPS]; /* move of tick k of group i */
    double d[GROUPS];            /* sum of the moves of each group; back and ahead are the extremes of its partial sums */
    double back[GROUPS], ahead[GROUPS];
    double max_width; /* largest ahead - back of all groups */
    double torque[GROUP][GROUPS];
    scan_t scan; /* scan of a Dahl element */
    lanes_t lanes;
} block_t;

typedef struct {
    dahl_throughput_element_t *elements;
    size_t count;
    const int32_t *dcounts;
    float *F;
    size_t n;
} job_t;

DAHL_INLINE double clamp_between(double x, double low, double high)
{
    double above = x > low ? x : low;
    return above < high ? above : high;
}

/** Compute the maps of the groups for -limit and +limit, tick by tick. */
DAHL_INLINE void follow_limits(const block_t *block, double limit, double *lows, double *highs)
{
    for (size_t i = 0; i < GROUPS; i++) {
        double low = -limit, high = limit;
        DAHL_UNROLL_8
        for (size_t k = 0; k < GROUP; k++) {
            low = clamp_between(low + block->count[k][i], -limit, limit);
            high = clamp_between(high + block->count[k][i], -limit, limit);
        }
        lows[i] = low;
        highs[i] = high;
    }
}

/** The same, if no group is wider than 2 limit and so reaches at most one limit. */
DAHL_INLINE void shift_limits(const block_t *block, double limit, double *lows, double *highs)
{
    for (size_t i = 0; i < GROUPS; i++) {
        lows[i] = block->d[i] - block->back[i] - limit;
        highs[i] = block->d[i] - block->ahead[i] + limit;
    }
}

/** Compute x at the start of each group and at the end of the block, for one lane in a register. */
DAHL_INLINE void join_one(const block_t *block, lanes_t *lanes)
{
    double x = lanes->x[0];
    for (size_t i = 0; i < GROUPS; i++) {
        lanes->start[0][i] = x;
        x = clamp_between(x + block->d[i], lanes->low[0][i], lanes->high[0][i]);
    }
    lanes->x[0] = x;
}

DAHL_INLINE void join_all(const block_t *block, lanes_t *lanes)
{
    for (size_t i = 0; i < GROUPS; i++) {
        for (size_t j = 0; j < lanes->used; j++) {
            double x = lanes->x[j];
            lanes->start[j][i] = x;
            lanes->x[j] = clamp_between(x + block->d[i], lanes->low[j][i], lanes->high[j][i]);
        }
    }
}

DAHL_INLINE void add_slip_torques(block_t *block, double limit, double torque_per_count, const double *start)
{
    for (size_t i = 0; i < GROUPS; i++) {
        double x = start[i];
        DAHL_UNROLL_8
        for (size_t k = 0; k < GROUP; k++) {
            x = clamp_between(x + block->count[k][i], -limit, limit);
            block->torque[k][i] += torque_per_count * x;
        }
    }
}

DAHL_INLINE void end_lanes(block_t *block)
{
    lanes_t *lanes = &block->lanes;
    if (lanes->used == 1) {
        join_one(block, lanes);
    } else {
        join_all(block, lanes);
    }
    for (size_t j = 0; j < lanes->used; j++) {
        add_slip_torques(block, lanes->limit[j], lanes->torque_per_count[j], lanes->start[j]);
        lanes->element[j]->x = lanes->x[j];
    }
    lanes->used = 0;
}

DAHL_INLINE void add_slip(block_t *block, dahl_throughput_element_t *element, const dahl_throughput_scale_t *scale)
{
    lanes_t *lanes = &block->lanes;
    const size_t j = lanes->used++;
    const double limit = 1.0 / scale->a;
    lanes->element[j] = element;
    lanes->limit[j] = limit;
    lanes->torque_per_count[j] = scale->Fc * scale->a;
    lanes->x[j] = clamp_between(element->x, -limit, limit);
    if (block->max_width > 2.0 * limit) {
        follow_limits(block, limit, lanes->low[j], lanes->high[j]);
    } else {
        shift_limits(block, limit, lanes->low[j], lanes->high[j]);
    }
    if (lanes->used == LANES) {
        end_lanes(block);
    }
}

DAHL_INLINE void add_dahl(block_t *block, dahl_throughput_element_t *element, const dahl_throughput_scale_t *scale,
                          const int32_t *dcounts)
{
    dahl_clamp_state(&element->state);
    double w0 = dahl_w_of(&element->state);
    scan_block(&block->scan, scale, w0, dcounts, 0, dahl_value_of_count, dahl_value_of_count, dahl_measure_of_count);
    dahl_carry(&element->state, join_groups(&block->scan));
    for (size_t i = 0; i < GROUPS; i++) {
        double d = block->scan.d[i];
        DAHL_UNROLL_8
        for (size_t k = 0; k < GROUP; k++) {
            d = block->scan.e[k][i] * d + block->scan.c[k][i];
            block->torque[k][i] += scale->Fc * (w0 + d);
        }
    }
}

DAHL_INLINE void start_group(block_t *block, size_t i, const int32_t *dcounts)
{
    double d = 0.0, back = 0.0, ahead = 0.0;
    DAHL_UNROLL_8
    for (size_t k = 0; k < GROUP; k++) {
        double count = (double)dcounts[k];
        block->count[k][i] = count;
        block->torque[k][i] = 0.0;
        d += count;
        back = d < back ? d : back;
        ahead = d > ahead ? d : ahead;
    }
    block->d[i] = d;
    block->back[i] = back;
    block->ahead[i] = ahead;
}

DAHL_INLINE void start_block(block_t *block, const int32_t *dcounts)
{
    double max_width = 0.0;
    for (size_t i = 0; i < GROUPS; i++) {
        start_group(block, i, &dcounts[GROUP * i]);
    }
    for (size_t i = 0; i < GROUPS; i++) {
        double width = block->ahead[i] - block->back[i];
        max_width = width > max_width ? width : max_width;
    }
    block->max_width = max_width;
}

DAHL_INLINE void end_block(const block_t *block, float *F)
{
    for (size_t i = 0; i < GROUPS; i++) {
        DAHL_UNROLL_8
        for (size_t k = 0; k < GROUP; k++) {
            F[GROUP * i + k] = (float)block->torque[k][i];
        }
    }
}

DAHL_INLINE void run_block(block_t *block, const job_t *job, const int32_t *dcounts, float *F)
{
    start_block(block, dcounts);
    for (size_t j = 0; j < job->count; j++) {
        dahl_throughput_element_t *element = &job->elements[j];
        dahl_throughput_scale_t scale;
        (void)dahl_throughput_check(&element->params, true, &scale); /* checked at the start of the call */
        if (element->slips != 0) {
            add_slip(block, element, &scale);
        } else {
            add_dahl(block, element, &scale, dcounts);
        }
    }
    if (block->lanes.used != 0) {
        end_lanes(block);
    }
    end_block(block, F);
}

DAHL_INLINE void run_elements(const job_t *job)
{
    block_t block = {0};
    for (size_t done = 0; done < job->n; done += BLOCK) {
        size_t ticks = job->n - done < BLOCK ? job->n - done : BLOCK;
        int32_t dcounts[BLOCK] = {0};
        float F[BLOCK];
        (void)memcpy(dcounts, job->dcounts + done, ticks * sizeof *dcounts);
        run_block(&block, job, dcounts, F);
        (void)memcpy(job->F + done, F, ticks * sizeof *F);
    }
}
DAHL_VARIANTS(run, job_t, run_elements)

dahl_err_t dahl_throughput_parallel_counts(dahl_throughput_element_t *elements, size_t count, const int32_t *dcounts, float *F,
                                           size_t n)
{
    int32_t err = DAHL_OK;
    for (size_t j = 0; j < count; j++) {
        dahl_throughput_scale_t scale;
        err |= dahl_throughput_check(&elements[j].params, true, &scale);
    }
    if (err == DAHL_OK) {
        job_t job = {elements, count, dcounts, F, n};
        run(&job);
    }
    return (dahl_err_t)err;
}
