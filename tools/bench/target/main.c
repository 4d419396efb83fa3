/* SPDX-License-Identifier: MIT */
/*
 * The image with the counted calls. Each case prints its name on standard output and calls bench_mark for the plugin, so that
 * the n-th name belongs to the n-th section of counts.
 */
#include <string.h>

#include "bench.h"
#include "semihosting.h"

bench_function_t bench_function;
uint32_t bench_sp;

static void say(const char *text)
{
    semihosting_write(text, (uint32_t)strlen(text));
}

void bench_case(const char *name)
{
    say("case ");
    say(name);
    say("\n");
    bench_mark();
}

void bench_number(const char *name, uint32_t value)
{
    char digits[11];
    char *first = digits + sizeof digits - 1;
    *first = '\0';
    do {
        *--first = (char)('0' + value % 10);
        value /= 10;
    } while (value != 0);
    say("number ");
    say(name);
    say(" ");
    say(first);
    say("\n");
}

/* Write the low hexadecimal digits of a value at `text`, and return the end. */
static char *write_hex(char *text, uint64_t value, int digits)
{
    for (int i = digits - 1; i >= 0; i--) {
        *text++ = "0123456789abcdef"[value >> 4 * i & 15];
    }
    return text;
}

void bench_input(uint32_t setting, uint64_t state, uint32_t move)
{
    char line[48] = "input ";
    char *end = write_hex(line + strlen(line), setting, 8);
    *end++ = ' ';
    end = write_hex(end, state, 16);
    *end++ = ' ';
    end = write_hex(end, move, 8);
    *end++ = '\n';
    *end = '\0';
    say(line);
}

uint32_t bench_depth(void)
{
    const uint32_t *word = (const uint32_t *)(uintptr_t)(bench_sp - BENCH_STACK_BYTES);
    uint32_t bytes = BENCH_STACK_BYTES;
    while (bytes > 0 && *word == BENCH_STACK_WORD) {
        word++;
        bytes -= 4;
    }
    return bytes;
}

int main(void)
{
    bench_library();
    bench_parts();
    bench_rivals();
    bench_motions();
    bench_variants();
    bench_energy();
    bench_compensator();
    bench_worst();
    return 0;
}
