/* SPDX-License-Identifier: MIT */
/* Print the lines of golden_bits.txt. */
#include <inttypes.h>
#include <stdio.h>

#include "bits_parts.h"

int main(void)
{
    for (unsigned run = 0; run < BITS_RUNS; run++) {
        printf("%-7s %-8s %u %016" PRIx64 "\n", run < BITS_RUNS / 2 ? "counts" : "angle", motions[run / BITS_PARAMS % MOTIONS].name,
               (unsigned)(run % BITS_PARAMS), bits_run(run));
    }
    for (unsigned run = 0; run < BITS_PARTS_RUNS; run++) {
        printf("%-7s %-8s %u %016" PRIx64 "\n", bits_parts[run / BITS_PARAMS].name, "all", (unsigned)(run % BITS_PARAMS),
               bits_parts_run(run));
    }
    return 0;
}
