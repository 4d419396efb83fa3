/* SPDX-License-Identifier: MIT */
/*
 * golden FILE: the hashes of tests/lib/bits.h against those in the file, up to the first that differs. Each motion has
 * forty times the processor time that it needs: what takes longer is an endless loop, and SIGPROF ends it.
 */
#include <inttypes.h>
#include <stdio.h>
#include <sys/time.h>

#include "../lib/bits.h"

int main(int argc, char **argv)
{
    FILE *golden = argc == 2 ? fopen(argv[1], "r") : NULL;
    if (golden == NULL) {
        fputs("error: golden FILE: cannot be read\n", stderr);
        return 2;
    }
    const struct itimerval most = {.it_value = {.tv_usec = 250000}};
    for (unsigned run = 0; run < BITS_RUNS; run++) {
        uint64_t wanted = 0;
        (void)setitimer(ITIMER_PROF, &most, NULL);
        if (fscanf(golden, "%*s %*s %*u %" SCNx64, &wanted) != 1 || bits_run(run) != wanted) {
            return 1;
        }
    }
    return 0;
}
