/* SPDX-License-Identifier: MIT */
/* The lines of tests/lib/golden_bits.txt, from a small core: without the formats of 64 bits that its printf may lack. */
#include <stdio.h>

#include "../lib/bits_parts.h"

static void print(const char *form, const char *motion, unsigned params, uint64_t hash)
{
    printf("%-7s %-8s %u %08lx%08lx\n", form, motion, params, (unsigned long)(hash >> 32), (unsigned long)(hash & 0xffffffffu));
}

int main(void)
{
    for (unsigned run = 0; run < BITS_RUNS; run++) {
        print(run < BITS_RUNS / 2 ? "counts" : "angle", motions[run / BITS_PARAMS % MOTIONS].name, (unsigned)(run % BITS_PARAMS),
              bits_run(run));
    }
#if !defined(__AVR__) /* the image would pass 64 KiB */
    for (unsigned run = 0; run < BITS_PARTS_RUNS; run++) {
        print(bits_parts[run / BITS_PARAMS].name, "all", (unsigned)(run % BITS_PARAMS), bits_parts_run(run));
    }
#endif
    return 0;
}
