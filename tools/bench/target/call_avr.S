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

/* Each kind of instruction, with its cycles by the data sheet: together 82 cycles, 41 instructions and 6 bytes of stack. The test
 * compares them with the counts. */
    .global bench_known
    .type bench_known, @function
bench_known:
    rcall 4f                    /* 4, and ret 5 */
    ldi r24, 9                  /* 1 */
1:  dec r24                     /* 9 x 1 */
    brne 1b                     /* 8 x 2, 1 */
    push r24                    /* 2 */
    pop r24                     /* 2 */
    lds r24, bench_function     /* 2 */
    sts bench_function, r24     /* 2 */
    movw r24, r30               /* 1 */
    adiw r24, 1                 /* 2 */
    mul r24, r25                /* 2 */
    clr r1                      /* 1 */
    ldi r26, lo8(bench_function) /* 1 */
    ldi r27, hi8(bench_function) /* 1 */
    ld r24, X                   /* 2 */
    st X, r24                   /* 2 */
    sbrc r1, 0                  /* 3, as it skips two words */
    lds r24, bench_function
    cpse r1, r1                 /* 2, as it skips a word */
    nop
    sbrs r1, 0                  /* 1 */
    rjmp 2f                     /* 2 */
2:  lpm r24, Z                  /* 3 */
    call 4f                     /* 5, and ret 5 */
    ret                         /* 5 */
4:  ret
