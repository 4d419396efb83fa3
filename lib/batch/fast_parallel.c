/* SPDX-License-Identifier: MIT */
/*
 * Elements in parallel, in double: any mix of Dahl elements, by the scan of fast_scan.h, and of slip elements, by one of their
 * own. Each adds its torque to those of a block of ticks; the sum is rounded once.
 *   A slip element's deflection x, in counts, is cut to +-L after every tick, L = Fc/(sigma0 theta_per_count). A tick is a map
 *   x -> min(high, max(low, x + d)), and so are several in a row; low and high are where +-L end. So as there: the maps of
 *   groups of ticks, x at the start of each group, x of every tick.
 * Error of x: none but that of L, 2^-52 of it, and a deflection errs by no more than its limit does. All of x, low and high are
 * whole multiples of the last bit of L, which a count is too (L <= 2^30), and a sum of them that is not exact is beyond L and
 * is cut. So nothing adds up over any number of ticks.
 */
#include <string.h>

#include "fast_scan.h"

#define LANES 8

/* Slip elements, up to LANES of them, so that the serial part is done for all at once. */
typedef struct {
    dahl_throughput_element_t *element[LANES];
    size_t used;
    double x[LANES], limit[LANES], torque_per_count[LANES];
    double low[LANES][GROUPS], high[LANES][GROUPS], start[LANES][GROUPS]; /* the map of each group, and x before it */
} lanes_t;

typedef struct {
    double count[GROUP][GROUPS]; /* of tick k of group i */
    double d[GROUPS];            /* counts of each group, and how far they lead from its start at most, either way */
    double back[GROUPS], ahead[GROUPS];
    double widest; /* the largest way from the farthest back to the farthest ahead */
    double torque[GROUP][GROUPS];
    scan_t scan; /* of a Dahl element */
    lanes_t lanes;
} block_t;

typedef struct {
    dahl_throughput_element_t *elements;
    size_t count;
    const int32_t *dcounts;
    float *F;
    size_t n;
} job_t;

DAHL_INLINE double cut(double x, double low, double high)
{
    double above = x > low ? x : low;
    return above < high ? above : high;
}

/* Where +-limit end, by the ticks of each group one after the other. */
DAHL_INLINE void follow_limits(const block_t *block, double limit, double *lows, double *highs)
{
    for (size_t i = 0; i < GROUPS; i++) {
        double low = -limit, high = limit;
        DAHL_UNROLL_8
        for (size_t k = 0; k < GROUP; k++) {
            low = cut(low + block->count[k][i], -limit, limit);
            high = cut(high + block->count[k][i], -limit, limit);
        }
        lows[i] = low;
        highs[i] = high;
    }
}

/* The same where no group is wider than 2 limit, so that it meets one limit at most: from -limit up, what it goes back is lost,
 * from limit what it goes ahead. */
DAHL_INLINE void shift_limits(const block_t *block, double limit, double *lows, double *highs)
{
    for (size_t i = 0; i < GROUPS; i++) {
        lows[i] = block->d[i] - block->back[i] - limit;
        highs[i] = block->d[i] - block->ahead[i] + limit;
    }
}

/* x at the start of each group, and at the end of the block: one lane, whose x stays in a register, */
DAHL_INLINE void join_one(const block_t *block, lanes_t *lanes)
{
    double x = lanes->x[0];
    for (size_t i = 0; i < GROUPS; i++) {
        lanes->start[0][i] = x;
        x = cut(x + block->d[i], lanes->low[0][i], lanes->high[0][i]);
    }
    lanes->x[0] = x;
}

/* or all of them side by side, so that none waits for its own last step. */
DAHL_INLINE void join_all(const block_t *block, lanes_t *lanes)
{
    for (size_t i = 0; i < GROUPS; i++) {
        for (size_t j = 0; j < lanes->used; j++) {
            double x = lanes->x[j];
            lanes->start[j][i] = x;
            lanes->x[j] = cut(x + block->d[i], lanes->low[j][i], lanes->high[j][i]);
        }
    }
}

DAHL_INLINE void add_slip_torques(block_t *block, double limit, double torque_per_count, const double *start)
{
    for (size_t i = 0; i < GROUPS; i++) {
        double x = start[i];
        DAHL_UNROLL_8
        for (size_t k = 0; k < GROUP; k++) {
            x = cut(x + block->count[k][i], -limit, limit);
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
    lanes->x[j] = cut(element->x, -limit, limit);
    if (block->widest > 2.0 * limit) {
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

/* The counts of a group, its way as a whole, and how far back and ahead it goes. */
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
    double widest = 0.0;
    for (size_t i = 0; i < GROUPS; i++) {
        start_group(block, i, &dcounts[GROUP * i]);
    }
    for (size_t i = 0; i < GROUPS; i++) {
        double width = block->ahead[i] - block->back[i];
        widest = width > widest ? width : widest;
    }
    block->widest = widest;
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
        (void)dahl_throughput_check(&element->params, true, &scale); /* was good when the call began */
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

/* The last ticks are filled up to a block with ticks that do not move. */
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
