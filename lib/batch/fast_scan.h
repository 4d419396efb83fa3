/* SPDX-License-Identifier: MIT */
/**
 * One long trajectory of a Dahl element by a scan. A tick is the affine map d -> e d + c, and so are several ticks
 * in a row. For one tick, e = 1 - g and c = (s - w0) g. For a block of ticks:
 * -# Compute e and c of every tick, and from them the map of each group of 8 ticks.
 * -# Compute d at the start of each group: the only serial part, one product for 8 ticks.
 * -# Compute d of every tick, and the torque. The users of this file do this.
 *
 * The compiler vectorizes steps 1 and 3.
 */
#ifndef DAHL_BATCH_FAST_SCAN_H
#define DAHL_BATCH_FAST_SCAN_H

#include "fast.h"

#define GROUP 8
#define GROUPS 64
#define BLOCK (GROUP * GROUPS)

typedef struct {
    double e[GROUP][GROUPS], c[GROUP][GROUPS]; /* tick k of group i */
    double group_e[GROUPS], group_c[GROUPS];
    double d[GROUPS]; /* d at the start of each group */
} scan_t;

DAHL_INLINE uint32_t largest(const void *moves, size_t n, dahl_measure_t measure)
{
    uint32_t most = measure(moves, n);
    for (size_t left = BLOCK; left != 0; left--) {
        uint32_t size = measure(moves, n + BLOCK - left);
        most = size > most ? size : most;
    }
    return most;
}

DAHL_INLINE void make_maps(scan_t *scan, const void *moves, size_t n, double a, double w0, dahl_value_t value, dahl_g_t g_of)
{
    for (size_t i = 0; i < GROUPS; i++) {
        double group_e = 1.0, group_c = 0.0;
        DAHL_UNROLL_8
        for (size_t k = 0; k < GROUP; k++) {
            double g = g_of(a * value(moves, n + GROUP * i + k));
            double e = 1.0 - fabs(g), c = g - w0 * fabs(g);
            scan->e[k][i] = e;
            scan->c[k][i] = c;
            group_c = e * group_c + c;
            group_e *= e;
        }
        scan->group_e[i] = group_e;
        scan->group_c[i] = group_c;
    }
}

DAHL_INLINE double join_groups(scan_t *scan)
{
    double d = 0.0;
    for (int i = 0; i < GROUPS; i++) {
        scan->d[i] = d;
        d = scan->group_e[i] * d + scan->group_c[i];
    }
    return d;
}

DAHL_INLINE void scan_block(scan_t *scan, const dahl_throughput_scale_t *scale, double w0, const void *moves, size_t n,
                            dahl_value_t value, dahl_value_t number, dahl_measure_t measure)
{
    double a = scale->a;
    uint32_t most = largest(moves, n, measure);
    if (most > scale->small) {
        make_maps(scan, moves, n, a, w0, value, dahl_g_any);
    } else if (most <= scale->tiny) {
        make_maps(scan, moves, n, a, w0, number, dahl_g_tiny);
    } else {
        make_maps(scan, moves, n, a, w0, number, dahl_g_small);
    }
}

#endif
