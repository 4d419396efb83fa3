/* SPDX-License-Identifier: MIT */
/* Below 64 ns a bin is 1 ns wide. Above, the 5 bits after the leading one select the bin. */
#include "histogram.h"

enum { OCTAVE_BINS = 32 };

static size_t bin_of(uint64_t ns)
{
    size_t octave = 0;
    while ((ns >> octave) >= 2 * OCTAVE_BINS) {
        octave++;
    }
    return octave * OCTAVE_BINS + (size_t)(ns >> octave);
}

uint64_t histogram_edge(size_t bin)
{
    size_t octave = bin < 2 * OCTAVE_BINS ? 0 : bin / OCTAVE_BINS - 1;
    return ((uint64_t)(bin - octave * OCTAVE_BINS + 1) << octave) - 1;
}

void histogram_add(histogram_t *histogram, uint64_t ns)
{
    histogram->bins[bin_of(ns)]++;
    histogram->count++;
    if (ns > histogram->max) {
        histogram->max = ns;
    }
}

void histogram_merge(histogram_t *histogram, const histogram_t *other)
{
    for (size_t bin = 0; bin < HISTOGRAM_BINS; bin++) {
        histogram->bins[bin] += other->bins[bin];
    }
    histogram->count += other->count;
    histogram->max = other->max > histogram->max ? other->max : histogram->max;
}
