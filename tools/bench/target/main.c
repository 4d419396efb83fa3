/* SPDX-License-Identifier: MIT */
/*
 * The image with the counted calls. Each case prints its name on standard output and calls bench_mark for the plugin, so that
 * the n-th name belongs to the n-th section of counts.
 */
#include <string.h>

#include "bench.h"
#include "semihosting.h"

bench_function_t bench_function;

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

void bench_bytes(const char *type, uint32_t bytes)
{
    char digits[11];
    char *first = digits + sizeof digits - 1;
    *first = '\0';
    do {
        *--first = (char)('0' + bytes % 10);
        bytes /= 10;
    } while (bytes != 0);
    say("bytes ");
    say(type);
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

#if defined(__AVR__) /* its RAM has room for these cases only */
int main(void)
{
    bench_library();
    bench_compensator();
    bench_known_code();
    return 0;
}
#else
int main(void)
{
    bench_library();
    bench_parts();
    bench_rivals();
    bench_motions();
    bench_variants();
    bench_energy();
    bench_compensator();
    bench_commission();
    bench_worst();
    bench_any();
    bench_node();
    bench_seldom();
    return 0;
}
#endif
