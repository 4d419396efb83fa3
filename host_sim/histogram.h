/* SPDX-License-Identifier: MIT */
/*
 * histogram: durations in fixed memory, for runs of any length. Each octave has 32 bins, so the error of a quantile is below
 * 3.2 %, from 1 ns to centuries. The maximum is exact.
 */
#ifndef HISTOGRAM_H
#define HISTOGRAM_H

#include <stddef.h>
#include <stdint.h>

#define HISTOGRAM_BINS ((size_t)60 * 32)

/* All zeros: empty. */
typedef struct {
    uint64_t count;
    uint64_t max;
    uint64_t bins[HISTOGRAM_BINS];
} histogram_t;

void histogram_add(histogram_t *histogram, uint64_t ns);

/* Add the counts of another histogram. */
void histogram_merge(histogram_t *histogram, const histogram_t *other);

/* Upper edge of a bin, in ns. */
uint64_t histogram_edge(size_t bin);

#endif
