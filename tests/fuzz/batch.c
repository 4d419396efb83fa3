/* SPDX-License-Identifier: MIT */
/*
 * Whole arrays through every batch: the bitwise forms give the bits of single steps, the throughput forms the same torques
 * within the bounds of both. One to four channels; moves repeated so that short inputs fill a block.
 */
#include "dahl_batch.h"
#include "plans.h"

enum { CHANNELS_MAX = 4, TICKS_MAX = 40, CELLS = CHANNELS_MAX * TICKS_MAX };

typedef struct {
    size_t channels, ticks;
    fuzz_plan_t plans[CHANNELS_MAX];
    dahl_plan_t only_plans[CHANNELS_MAX];
    dahl_throughput_params_t wide[CHANNELS_MAX];
    dahl_state_t start[CHANNELS_MAX];
    int32_t counts[CELLS];
    float angles[CELLS];
} job_t;

static int32_t any_counts(uint32_t value)
{
    static const uint32_t shifts[4] = {30, 26, 16, 0};
    return (int32_t)value >> shifts[value & 3u];
}

/* Moves of 2^-29 to 2^4 presliding lengths, and sometimes any float but a subnormal: which forms count those differs. */
static float any_angle(const fuzz_plan_t *plan, uint32_t value)
{
    int exponent = (int)((value >> 23 & 255u) % 34u) - 29 - ilogbf(plan->params.sigma0) + ilogbf(plan->params.Fc);
    float scaled = fuzz_scaled(value, exponent);
    float any = (value & 31u) == 0 ? fuzz_float_of(value) : value >> 31 ? -scaled : scaled;
    return fabsf(any) < 0x1p-126f ? 0.0f : any;
}

static int take_plans(job_t *job, fuzz_bytes_t *bytes)
{
    for (size_t c = 0; c < job->channels; c++) {
        fuzz_plan_t *plan = &job->plans[c];
        plan->good = 0;
        plan->params = fuzz_params(bytes);
        plan->good = dahl_prepare(&plan->plan, &plan->params) == DAHL_OK;
        if (!plan->good) {
            return 0;
        }
        job->only_plans[c] = plan->plan;
        job->wide[c] = (dahl_throughput_params_t){(double)plan->params.sigma0, (double)plan->params.Fc,
                                                  (double)plan->params.theta_per_count};
        job->start[c].w = (int64_t)(fuzz_u32(bytes)) * (1 << 30) - ((int64_t)1 << 61);
    }
    return 1;
}

static void take_moves(job_t *job, fuzz_bytes_t *bytes)
{
    uint32_t value = 1;
    for (size_t i = 0; i < job->channels * job->ticks; i++) {
        value = bytes->left > 0 ? fuzz_u32(bytes) : value * 1664525u + 1013904223u;
        job->counts[i] = any_counts(value);
        job->angles[i] = any_angle(&job->plans[i % job->channels], value);
    }
}

static float ulp_of(float Fc)
{
    return nextafterf(Fc, INFINITY) - Fc;
}

/* single: F of single steps, channel by channel in the order of the batches. */
static void run_singles(const job_t *job, int by_counts, float *single, dahl_state_t *states)
{
    memcpy(states, job->start, sizeof job->start);
    for (size_t i = 0; i < job->channels * job->ticks; i++) {
        size_t c = i % job->channels;
        single[i] = by_counts ? dahl_step_counts(&job->only_plans[c], &states[c], job->counts[i])
                              : dahl_step(&job->only_plans[c], &states[c], job->angles[i]);
    }
}

static void check_bitwise(const job_t *job, int by_counts, const float *single, const dahl_state_t *ends)
{
    float F[CELLS];
    dahl_state_t states[CHANNELS_MAX];
    size_t cells = job->channels * job->ticks;
    memcpy(states, job->start, sizeof states);
    if (by_counts) {
        dahl_batch_counts_channels(job->only_plans, states, job->channels, job->counts, F, job->ticks);
    } else {
        dahl_batch_channels(job->only_plans, states, job->channels, job->angles, F, job->ticks);
    }
    LAW(memcmp(F, single, cells * sizeof F[0]) == 0, "channels return the bits of single steps");
    LAW(memcmp(states, ends, job->channels * sizeof states[0]) == 0, "channels leave the states of single steps");
    if (job->channels == 1) {
        states[0] = job->start[0];
        by_counts ? dahl_batch_counts(job->only_plans, states, job->counts, F, cells)
                  : dahl_batch(job->only_plans, states, job->angles, F, cells);
        LAW(memcmp(F, single, cells * sizeof F[0]) == 0, "a batch returns the bits of single steps");
        LAW(states[0].w == ends[0].w, "a batch leaves the state of single steps");
    }
}

static dahl_err_t run_throughput(const job_t *job, int by_counts, dahl_state_t *states, float *F)
{
    if (job->channels == 1) {
        return by_counts ? dahl_throughput_counts(job->wide, states, job->counts, F, job->ticks)
                         : dahl_throughput(job->wide, states, job->angles, F, job->ticks);
    }
    return by_counts ? dahl_throughput_counts_channels(job->wide, states, job->channels, job->counts, F, job->ticks)
                     : dahl_throughput_channels(job->wide, states, job->channels, job->angles, F, job->ticks);
}

static void check_throughput(const job_t *job, int by_counts, const float *single)
{
    float F[CELLS];
    dahl_state_t states[CHANNELS_MAX];
    memcpy(states, job->start, sizeof states);
    for (size_t c = 0; by_counts && c < job->channels; c++) {
        if (job->plans[c].params.theta_per_count == 0) {
            return;
        }
    }
    if (run_throughput(job, by_counts, states, F) != DAHL_OK) {
        return; /* the travel of a count is a limit to the last bit: prepare.c has that law */
    }
    for (size_t i = 0; i < job->channels * job->ticks; i++) {
        float Fc = job->plans[i % job->channels].params.Fc;
        LAW(F[i] <= Fc && F[i] >= -Fc, "|F| <= Fc");
        LAW(fabsf(F[i] - single[i]) <= 1.5f * ulp_of(Fc), "throughput agrees with single steps within both bounds");
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static job_t job;
    float single[CELLS];
    dahl_state_t ends[CHANNELS_MAX];
    fuzz_bytes_t bytes = {data, size};
    uint8_t shape = fuzz_u8(&bytes);
    job.channels = 1u + (shape & 3u);
    job.ticks = (size_t)(shape >> 2) % (TICKS_MAX + 1u);
    int by_counts = fuzz_u8(&bytes) & 1;
    if (take_plans(&job, &bytes)) {
        take_moves(&job, &bytes);
        run_singles(&job, by_counts, single, ends);
        check_bitwise(&job, by_counts, single, ends);
        check_throughput(&job, by_counts, single);
    }
    return 0;
}
