/* SPDX-License-Identifier: MIT */
/* Common code of the fuzzers. Each is one LLVMFuzzerTestOneInput (libFuzzer) without state, so an input alone repeats a
 * failure. Bytes beyond the end of the input read as 0. */
#ifndef FUZZ_H
#define FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

typedef struct {
    const uint8_t *at;
    size_t left;
} fuzz_bytes_t;

static inline uint8_t fuzz_u8(fuzz_bytes_t *bytes)
{
    if (bytes->left == 0) {
        return 0;
    }
    bytes->left--;
    return *bytes->at++;
}

static inline uint32_t fuzz_u32(fuzz_bytes_t *bytes)
{
    uint32_t value = 0;
    for (int i = 0; i < 4; i++) {
        value |= (uint32_t)fuzz_u8(bytes) << (8 * i);
    }
    return value;
}

static inline uint64_t fuzz_u64(fuzz_bytes_t *bytes)
{
    uint64_t low = fuzz_u32(bytes);
    return (uint64_t)fuzz_u32(bytes) << 32 | low;
}

static inline float fuzz_float_of(uint32_t bits)
{
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

#ifdef UNITY_FRAMEWORK_H /* a unit test includes the fuzzer */
#define HOLDS(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)
#else
static inline void fuzz_broken(const char *property, const char *file, int line)
{
    dprintf(2, "%s:%d: property broken: %s\n", file, line, property);
    abort();
}
#define HOLDS(condition, words) ((condition) ? (void)0 : fuzz_broken(words, __FILE__, __LINE__))
#endif

/* The same properties without libFuzzer, for random inputs. Every other input has many small bytes. */
static inline void fuzz_at_random(uint32_t inputs, size_t length)
{
    uint8_t input[512];
    uint64_t seed = 88172645463325252u;
    for (uint32_t n = 0; n < inputs; n++) {
        for (size_t i = 0; i < length && i < sizeof input; i++) {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            input[i] = (uint8_t)(seed >> 32) & (n % 2 != 0 && seed >> 63 != 0 ? 0x17u : 0xFFu);
        }
        (void)LLVMFuzzerTestOneInput(input, length);
    }
}

#endif
