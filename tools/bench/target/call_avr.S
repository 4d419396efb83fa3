/* SPDX-License-Identifier: MIT */
/* See call.h. Z holds no argument. */
    .text
    .global bench_call, bench_site, bench_back
    .type bench_call, @function
bench_call:
    lds r30, bench_function
    lds r31, bench_function+1
bench_site:
    eicall
bench_back:
    ret

    .global bench_mark
    .type bench_mark, @function
bench_mark:
    ret

/* By the data sheet 25 instructions, 39 cycles and 4 bytes of stack: 3 cycles, 8 rounds of 3, the last round of 2, push and pop
 * of 2 each, nop of 1, ret of 5. It shows that the counts are right (call_count_known of avr.py). */
    .global bench_known
    .type bench_known, @function
bench_known:
    ldi r24, 9
    nop
    nop
1:  dec r24
    brne 1b
    push r24
    pop r24
    nop
    ret
