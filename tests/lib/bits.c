/* SPDX-License-Identifier: MIT */
/* Print the lines of golden_bits.txt. The printf of a small core may lack formats of 64 bits. */
#include <stdio.h>

#include "bits_parts.h"

#ifndef BITS_STRIDE /* a slow core prints every third line, which has each motion, each set and both forms */
#define BITS_STRIDE 1
#endif

static void print(const char *form, const char *motion, unsigned params, uint64_t hash)
{
    printf("%-7s %-8s %u %08lx%08lx\n", form, motion, params, (unsigned long)(hash >> 32), (unsigned long)(hash & 0xffffffffu));
}

/* An AVR image is limited to 64 KiB, so each part is an image, named by BITS_PART. */
#if defined(BITS_PART)
#define JOINED(a, b) a##b
#define FOLD_OF(part) JOINED(bits_, part)
#define QUOTED(word) #word
#define NAME_OF(part) QUOTED(part)
int main(void)
{
    for (unsigned set = 0; set < BITS_PARAMS; set++) {
        print(NAME_OF(BITS_PART), "all", set, bits_of_part(FOLD_OF(BITS_PART), set));
    }
    return 0;
}
#else
int main(void)
{
    for (unsigned run = 0; run < BITS_RUNS; run += BITS_STRIDE) {
        print(run < BITS_RUNS / 2 ? "counts" : "angle", motions[run / BITS_PARAMS % MOTIONS].name, (unsigned)(run % BITS_PARAMS),
              bits_run(run));
    }
#if !defined(__AVR__)
    for (unsigned run = 0; run < BITS_PARTS_RUNS; run++) {
        print(bits_parts[run / BITS_PARAMS].name, "all", (unsigned)(run % BITS_PARAMS), bits_parts_run(run));
    }
#endif
    return 0;
}
#endif
