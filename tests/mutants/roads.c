/* SPDX-License-Identifier: MIT */
/*
 * roads: which form of each batch is taken on a processor with which features (batch_targets.h), and what it gives. One line
 * for each set of features that this processor has: addresses of all functions that are entered, and a hash of torques and
 * states.
 * With -finstrument-functions for the batches alone, and coverage_cpu.h before them, so that DAHL_CPU says what there is.
 */
#define _POSIX_C_SOURCE 200809L
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dahl.h"

#define TICKS 600
#define CHANNELS 16
#define ALL (TICKS * CHANNELS)

static const char *const features[] = {"avx2", "fma", "avx512bw", "avx512dq", "avx512vl"};
enum { FEATURES = sizeof features / sizeof features[0] };

void __cyg_profile_func_enter(void *function, void *caller);
void __cyg_profile_func_exit(void *function, void *caller);
void __cyg_profile_func_enter(void *function, void *caller)
{
    (void)caller;
    printf(" %" PRIxPTR, (uintptr_t)function);
}
void __cyg_profile_func_exit(void *function, void *caller)
{
    (void)function;
    (void)caller;
}

static int32_t counts[ALL];
static float angles[ALL], F[ALL];

static void print_hash(const dahl_state_t *states)
{
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < sizeof F; i++) {
        hash = (hash ^ ((const unsigned char *)F)[i]) * 1099511628211u;
    }
    for (size_t i = 0; i < CHANNELS * sizeof *states; i++) { /* they tell a product and a sum from both in one */
        hash = (hash ^ ((const unsigned char *)states)[i]) * 1099511628211u;
    }
    printf(" = %016" PRIx64, hash);
}

static void run_all(const dahl_params_t *p)
{
    static dahl_plan_t plans[CHANNELS];
    dahl_throughput_params_t params[CHANNELS];
    dahl_state_t states[CHANNELS] = {{0}};
    for (int c = 0; c < CHANNELS; c++) {
        params[c] = (dahl_throughput_params_t){(double)p->sigma0 * (1 + 0.013 * c), (double)p->Fc, (double)p->theta_per_count};
        (void)dahl_prepare(&plans[c], p);
    }
    (void)dahl_throughput_counts(params, states, counts, F, ALL);
    print_hash(states);
    (void)dahl_throughput(params, states, angles, F, ALL);
    print_hash(states);
    (void)dahl_throughput_counts_channels(params, states, CHANNELS, counts, F, TICKS);
    print_hash(states);
    (void)dahl_throughput_channels(params, states, CHANNELS, angles, F, TICKS);
    print_hash(states);
    dahl_batch_counts_channels(plans, states, CHANNELS, counts, F, TICKS);
    print_hash(states);
}

int main(int argc, char **argv)
{
    const dahl_params_t p = {1.7f, 0.53f, 0x1p-12f};
    uint32_t bits = 1;
    for (int i = 0; i < ALL; i++) {
        bits = bits * 1664525u + 1013904223u;
        counts[i] = (int32_t)(bits >> 22) - 512;
        angles[i] = (float)counts[i] * 1.3e-4f;
    }
    for (unsigned set = 0; set < 1u << FEATURES; set++) {
        char words[64] = "";
        int is_here = 1;
        for (int i = 0; i < FEATURES; i++) {
            if (set >> i & 1u) {
                strcat(strcat(words, features[i]), " ");
                is_here &= argc == 2 && strstr(argv[1], features[i]) != NULL;
            }
        }
        if (is_here) {
            (void)setenv("DAHL_CPU", words, 1);
            printf("%s:", words);
            run_all(&p);
            printf("\n");
        }
    }
    return 0;
}
