/* SPDX-License-Identifier: MIT */
/* Every non-negative float through the kernel, a minute or three: build/host/tests/lib/kernel_all */
#include <stdio.h>

#include "kernel_check.h"

int main(void)
{
    kernel_worst_t worst = {0, 0, 0, 0};
    for (uint32_t part = 0; part < 0x7f8u; part++) {
        kernel_check(&worst, part << 20, (part + 1) << 20, 1);
        if (part % 64 == 0) {
            (void)fprintf(stderr, "\r%3u %% of all floats", part * 100u / 0x7f8u);
        }
    }
    (void)fprintf(stderr, "\r");
    printf("kernel: worst relative error %.3e = 2^%.3f at u = %a, bound %.3e; falls %d times\n", worst.error, log2(worst.error),
           (double)worst.u, DAHL_KERNEL_ERROR, worst.falls);
    return worst.error <= DAHL_KERNEL_ERROR && worst.falls == 0 ? 0 : 1;
}
