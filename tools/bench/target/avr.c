/* SPDX-License-Identifier: MIT */
/* Output of an AVR in simavr (../simavr.c), and a call whose cost the data sheet gives. */
#include <avr/io.h>

#include "bench.h"
#include "semihosting.h"

void call_known(void) __asm__("bench_call");
void bench_known(void); /* call_avr.S */

void semihosting_write(const char *text, uint32_t length)
{
    for (uint32_t i = 0; i < length; i++) {
        GPIOR0 = (uint8_t)text[i];
    }
}

void bench_known_code(void)
{
    bench_case("known");
    bench_function = bench_known;
    call_known();
}
