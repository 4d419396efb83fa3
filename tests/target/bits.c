/* SPDX-License-Identifier: MIT */
/* The lines of tests/lib/golden_bits.txt, from a small core: without the formats of 64 bits that its printf may lack. */
#include <stdio.h>

#include "../lib/bits.h"

int main(void)
{
    for (unsigned run = 0; run < BITS_RUNS; run++) {
        uint64_t hash = bits_run(run);
        printf("%-7s %-8s %u %08lx%08lx\n", run < BITS_RUNS / 2 ? "counts" : "angle",
               motions[run / BITS_PARAMS % MOTIONS].name, (unsigned)(run % BITS_PARAMS), (unsigned long)(hash >> 32),
               (unsigned long)(hash & 0xffffffffu));
    }
    return 0;
}
