/* SPDX-License-Identifier: MIT */
/* Every non-negative float through the kernel, about 3 minutes: build/host/tests/lib/kernel_all */
#include <stdio.h>

#include "kernel_check.h"

int main(void)
{
    kernel_worst_t worst = {0, 0};
    for (uint32_t part = 0; part < 0x7f8u; part++) {
        kernel_worst_t here = kernel_check(part << 20, (part + 1) << 20, 1);
        worst = here.error > worst.error ? here : worst;
        if (part % 64 == 0) {
            (void)fprintf(stderr, "\r%3u %% of all floats", part * 100u / 0x7f8u);
        }
    }
    (void)fprintf(stderr, "\r");
    printf("kernel: worst relative error %.3e = 2^%.3f at u = %a, bound %.3e\n", worst.error, log2(worst.error), (double)worst.u,
           DAHL_KERNEL_ERROR);
    return worst.error <= DAHL_KERNEL_ERROR ? 0 : 1;
}
