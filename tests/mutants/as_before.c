/* SPDX-License-Identifier: MIT */
/*
 * as_before FILE: one hash for each part of what batches, throughput forms and float form give: torques, states, codes.
 * Where there is no FILE, it is written; else the first hash that differs from it ends the run. So every bit counts of what
 * the tests hold to bounds only, as compiled by one compiler. And so does each call of what a batch asks where its own way
 * would not do: that costs time, which nobody else notices. Each array ends where memory ends: a read or a write beyond
 * is a crash; what an output does not own is part of its hash.
 */
#include <dlfcn.h>
#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#include "../lib/bits.h"

#define PAGES 40
#define PAGE 4096
#define MOST 40000u /* moves of one call */
#define CHANNELS 40u

/* As lib/batch_throughput.h has it: included, that would make each mutant of it one of this program. */
typedef struct {
    double a, Fc;
    uint32_t small, tiny;
} scale_t;
dahl_err_t dahl_throughput_check(const dahl_throughput_params_t *params, _Bool by_counts, scale_t *scale);

static FILE *before;
static int is_new, is_other;
static uint64_t hash;
static motion_t source = MOTION_START;

static uint32_t any(uint32_t below)
{
    return motion_random(&source) % below;
}

static void fold_bytes(const void *bytes, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        hash = (hash ^ ((const unsigned char *)bytes)[i]) * 1099511628211u;
    }
}

/* 0 and -0 are the same to whoever gets them, but not to a compiler; NaN has many bits. */
static void fold_floats(const float *x, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        uint32_t bits = bits_of_float(x[i]);
        hash = (hash ^ (x[i] != x[i] ? 1u : bits)) * 1099511628211u;
        hash ^= hash >> 29;
    }
}

/* Ends a part. */
static int part(void)
{
    uint64_t wanted = hash;
    if (is_new) {
        fprintf(before, "%016" PRIx64 "\n", hash);
    } else if (fscanf(before, "%" SCNx64, &wanted) != 1 || wanted != hash) {
        is_other = 1;
    }
    hash = 14695981039346656037u;
    return !is_other;
}

typedef struct {
    unsigned char *start, *end;
} memory_t;

/* Memory with nothing after it. */
static memory_t new_memory(void)
{
    memory_t m;
    m.start = mmap(NULL, (PAGES + 2) * PAGE, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    (void)mprotect(m.start + PAGE, PAGES * PAGE, PROT_READ | PROT_WRITE);
    m.end = m.start + (PAGES + 1) * PAGE;
    m.start += PAGE;
    return m;
}

static memory_t moves_memory, F_memory, plans_memory, params_memory, states_memory;

static int32_t *counts_for(size_t n) { return (int32_t *)(void *)moves_memory.end - n; }
static float *angles_for(size_t n) { return (float *)(void *)moves_memory.end - n; }

/* Torques with a few before them that nobody may write. */
static float *F_for(size_t n)
{
    memset(F_memory.start, 0x5a, PAGES * PAGE);
    return (float *)(void *)F_memory.end - n;
}

static dahl_plan_t *plans_for(size_t n) { return (dahl_plan_t *)(void *)plans_memory.end - n; }
static dahl_state_t *states_for(size_t n) { return (dahl_state_t *)(void *)states_memory.end - n; }
static dahl_throughput_params_t *params_in_double(size_t n) { return (dahl_throughput_params_t *)(void *)params_memory.end - n; }

static void fold_F(const float *F, size_t n)
{
    fold_bytes(F - 8, 8 * sizeof *F);
    fold_floats(F, n);
}

/* Stands between the library and its own: how often a batch asks for the exact torque. */
float dahl_torque_of(const dahl_plan_t *plan, uint64_t w);
float dahl_torque_of(const dahl_plan_t *plan, uint64_t w)
{
    static float (*own)(const dahl_plan_t *, uint64_t);
    if (own == NULL) {
        void *found = dlsym(RTLD_NEXT, "dahl_torque_of");
        memcpy(&own, &found, sizeof own);
    }
    hash = hash * 31u + 7u;
    return own(plan, w);
}

/* ---------------------------------------------------------------- questions */

/* Travel of a count. */
static float travel_of(uint32_t k)
{
    static const float travels[] = {1e-8f, 3e-6f, 1e-4f, 5e-3f, 0.03f, 0.3f, 0.6931472f, 1.7f, 20.0f, 3000.0f};
    return travels[k % (sizeof travels / sizeof travels[0])];
}

static dahl_params_t params_of(uint32_t k)
{
    static const float Fcs[] = {1.0f, 2.739f, 0x1.fffffep+0f, 1e-9f, 0.37f, 1.5e+10f};
    dahl_params_t p = {0, Fcs[k / 3 % 6], 0x1.8e757ap-12f};
    p.sigma0 = travel_of(k) * p.Fc / p.theta_per_count;
    return p;
}

static dahl_throughput_params_t in_double(const dahl_params_t *p)
{
    dahl_throughput_params_t q = {(double)p->sigma0 * (1 + 1e-9), (double)p->Fc * (1 - 1e-10), (double)p->theta_per_count};
    return q;
}

static int64_t any_w(void)
{
    int64_t w = (int64_t)((uint64_t)any(UINT32_MAX) << 32 | any(UINT32_MAX)) >> (1 + any(20) * any(4));
    int64_t most = ((int64_t)1 << 62) + ((int64_t)1 << 31) - 1;
    return any(9) == 0 ? (any(2) ? most : -most) : w > most ? most : w < -most ? -most : w;
}

/* A move: of one of several sizes, or just at `edge`. */
static int32_t any_move(uint32_t kind, uint32_t edge)
{
    uint32_t size = kind == 0 ? any(17) : kind == 1 ? any(UINT32_MAX) >> any(32) : kind == 2 ? any(3) : any(edge) + (any(9) == 0);
    size = kind == 4 && any(40) == 0 ? edge + any(3) - 1 : size;
    uint32_t move = any(2) ? size : 0u - size;
    int32_t as = 0;
    memcpy(&as, &move, 4);
    return kind == 1 && any(50) == 0 ? INT32_MIN : as;
}

static float any_angle(uint32_t kind, float edge)
{
    uint32_t bits = any(UINT32_MAX) ^ any(2) << 31;
    float x = edge * ((float)(any(20001)) - 10000.0f) / 10000.0f, odd;
    if (kind == 1 && any(4) == 0) {
        static const uint32_t special[] = {0, 0x80000000u, 0x7f800000u, 0xff800000u, 0x7fc00000u, 0xffc00001u, 0x7f800001u, 1, 0x7f7fffffu};
        bits = any(2) ? special[any(9)] : bits;
        memcpy(&odd, &bits, 4);
        return odd;
    }
    if (kind == 4 && any(40) == 0) {
        memcpy(&bits, &edge, 4);
        bits += any(3) - 1;
        memcpy(&x, &bits, 4);
        return any(2) ? x : -x;
    }
    return kind == 2 && any(2) ? 0.0f : kind == 3 ? x * 1e-4f : x;
}

static uint32_t count_at(double travel, double a)
{
    double n = travel / a;
    return n < 2 ? 2 : n > 2e9 ? 2000000000u : (uint32_t)n;
}

static void fill_counts(int32_t *d, size_t n, double a)
{
    uint32_t kind = any(6), edge = count_at(any(2) ? 0.6931471805599453 : 0.6931471805599453 / 128, a);
    for (size_t i = 0; i < n; i++) {
        d[i] = any_move(kind == 5 ? any(5) : kind, edge);
    }
}

static void fill_angles(float *d, size_t n, double a)
{
    uint32_t kind = any(6);
    float edge = (float)((any(2) ? 0.6931471805599453 : 0.6931471805599453 / 128) / a) * (any(5) ? 1.0f : 30.0f);
    for (size_t i = 0; i < n; i++) {
        d[i] = any_angle(kind == 5 ? any(5) : kind, edge);
    }
}

/* Lengths about the blocks' and up to a few of them. */
static size_t any_length(void)
{
    static const size_t near[] = {0, 1, 2, 7, 8, 9, 15, 16, 17, 127, 128, 129, 511, 512, 513, 1024, 1025};
    return any(2) ? near[any(sizeof near / sizeof near[0])] : any(1500);
}

static dahl_plan_t plan_of(const dahl_params_t *p)
{
    dahl_plan_t plan;
    memset(&plan, 0, sizeof plan);
    (void)dahl_prepare(&plan, p);
    return plan;
}

/* ---------------------------------------------------------------- one trajectory */

static void one_bitwise(uint32_t k)
{
    dahl_params_t p = params_of(k);
    dahl_plan_t *plan = plans_for(1);
    dahl_state_t *state = states_for(1);
    size_t n = any_length();
    *plan = plan_of(&p);
    state->w = any_w();
    fill_counts(counts_for(n), n, (double)travel_of(k));
    float *F = F_for(n);
    dahl_batch_counts(plan, state, counts_for(n), F, n);
    fold_F(F, n);
    fold_bytes(state, sizeof *state);
    fill_angles(angles_for(n), n, (double)p.sigma0 / (double)p.Fc);
    F = F_for(n);
    dahl_batch(plan, state, angles_for(n), F, n);
    fold_F(F, n);
    fold_bytes(state, sizeof *state);
}

static void one_throughput(uint32_t k)
{
    dahl_params_t p = params_of(k);
    dahl_throughput_params_t *q = params_in_double(1);
    dahl_state_t *state = states_for(1);
    size_t n = any(3) ? any_length() : 1 + any(3);
    *q = in_double(&p);
    state->w = any_w();
    fill_counts(counts_for(n), n, (double)travel_of(k));
    float *F = F_for(n);
    hash += (uint64_t)(int64_t)dahl_throughput_counts(q, state, counts_for(n), F, n);
    fold_F(F, n);
    fold_bytes(state, sizeof *state);
    fill_angles(angles_for(n), n, q->sigma0 / q->Fc);
    F = F_for(n);
    hash += (uint64_t)(int64_t)dahl_throughput(q, state, angles_for(n), F, n);
    fold_F(F, n);
    fold_bytes(state, sizeof *state);
}

/* ---------------------------------------------------------------- channels */

static void channels(uint32_t k)
{
    size_t count = any(3) ? any(CHANNELS) : 16 * any(3), rows = any(3) ? any(40) : any_length() % 300;
    size_t n = count * rows;
    dahl_plan_t *plans = plans_for(count);
    dahl_throughput_params_t *params = params_in_double(count);
    dahl_state_t *states = states_for(count);
    uint32_t others = any(2) ? 0 : 1 + any(3);
    double a = 0;
    for (size_t c = 0; c < count; c++) {
        dahl_params_t p = params_of(k + others * (uint32_t)c);
        plans[c] = plan_of(&p);
        params[c] = in_double(&p);
        states[c].w = any_w();
        double of = params[c].sigma0 / params[c].Fc;
        a = a < of || any(6) == 0 ? of : a;
    }
    fill_counts(counts_for(n), n, a * params_of(k).theta_per_count);
    float *F = F_for(n);
    dahl_batch_counts_channels(plans, states, count, counts_for(n), F, rows);
    fold_F(F, n);
    fold_bytes(states, count * sizeof *states);
    F = F_for(n);
    hash += (uint64_t)(int64_t)dahl_throughput_counts_channels(params, states, count, counts_for(n), F, rows);
    fold_F(F, n);
    fold_bytes(states, count * sizeof *states);
    fill_angles(angles_for(n), n, a);
    F = F_for(n);
    dahl_batch_channels(plans, states, count, angles_for(n), F, rows);
    fold_F(F, n);
    F = F_for(n);
    hash += (uint64_t)(int64_t)dahl_throughput_channels(params, states, count, angles_for(n), F, rows);
    fold_F(F, n);
    fold_bytes(states, count * sizeof *states);
}

/* ---------------------------------------------------------------- ties */

/* Torques near the middle between two floats, in one channel of three: the first 32 bits of w times the mantissa of Fc. */
static void ties(uint32_t k)
{
    static const float Fcs[] = {0x1.000002p+0f, 1.5f, 2.739f, 1e-9f, 1.8e+19f};
    const dahl_params_t p = {1.0f, Fcs[k % 5], 0.0f};
    const uint64_t half = (uint64_t)1 << (38 + k / 5 % 2);
    dahl_plan_t *plans = plans_for(3);
    dahl_state_t *states = states_for(3);
    plans[0] = plans[1] = plans[2] = plan_of(&p);
    uint64_t mantissa = plans[0].Fc_mantissa, inverse = mantissa;
    for (int i = 0; i < 5; i++) {
        inverse *= 2u - mantissa * inverse;
    }
    memset(counts_for(3), 0, 3 * sizeof(int32_t));
    for (uint32_t i = 0; i <= 28000; i++) {
        uint64_t t = (half + i - 14000u) * inverse & (2 * half - 1);
        if (t >> 31 == 1) {
            states[0].w = states[1].w = any_w();
            uint32_t more = any(3) ? any(31) : 21 + any(2) * 9; /* 53 and 62 bits in all */
            states[2].w = (int64_t)(any(2) ? t << more : ((t + 1) << more) - 1);
            float *F = F_for(3);
            dahl_batch_counts(plans, states + 2, counts_for(1), F + 2, 1);
            fold_F(F, 3);
            dahl_batch_counts_channels(plans, states, 3, counts_for(3), F, 1);
            fold_F(F, 3);
        }
    }
}

/* ---------------------------------------------------------------- limits */

/* Each limit, each neighbour of it, and what is no number, in each place. */
static void limits(void)
{
    static const double edges[] = {0.0,  -1.0, 1.0,     0x1p-64, 0x1p+64, 0x1p-30, 0x1p+20, 0x1p-65, 0x1p-128, 0x1p+128, 1e300, 1e-300,
                                   5e-324, 0.6931471805599453, 0x1.62e42fefa39efp-33, 0x1.62e42fefa39efp-40, DBL_MAX, 100.0};
    enum { EDGES = sizeof edges / sizeof edges[0], ALL = 3 * EDGES + 2 };
    double values[ALL];
    for (int i = 0; i < EDGES; i++) {
        values[3 * i] = edges[i];
        values[3 * i + 1] = nextafter(edges[i], 0.0);
        values[3 * i + 2] = nextafter(edges[i], HUGE_VAL);
    }
    values[ALL - 2] = HUGE_VAL;
    values[ALL - 1] = NAN;
    for (int i = 0; i < ALL * ALL * 3; i++) {
        double x = values[i % ALL], y = values[i / ALL % ALL];
        dahl_throughput_params_t p = {i / ALL / ALL == 2 ? 1.0 : x, i / ALL / ALL == 1 ? 1.0 : y, i / ALL / ALL == 0 ? 1.0 : i / ALL / ALL == 1 ? y : x};
        for (int by_counts = 0; by_counts < 2; by_counts++) {
            scale_t scale = {0, 0, 0, 0};
            hash += (uint64_t)(int64_t)dahl_throughput_check(&p, by_counts, &scale);
            fold_bytes(&scale.a, sizeof scale.a);
            fold_bytes(&scale.Fc, sizeof scale.Fc);
            fold_bytes(&scale.small, 4);
            fold_bytes(&scale.tiny, 4);
        }
    }
}

/* What goes wrong in one channel, or with one trajectory, by what each form returns and touches. */
static void refusals(uint32_t k)
{
    static const dahl_throughput_params_t bad[] = {
        {-1.0, 1.0, 1.0}, {1.0, 1e30, 1.0}, {1.0, 1.0, -1.0}, {1.0, 1.0, 1e-12}, {1.0, 1.0, 1e12}, {1.0, 1.0, 0.1}};
    size_t count = 1 + any(CHANNELS - 1), rows = any(4), at = any(3) ? any((uint32_t)count) : (any(2) ? count - 1 : 0), n = count * rows;
    dahl_throughput_params_t *params = params_in_double(count);
    dahl_state_t *states = states_for(count);
    for (size_t c = 0; c < count; c++) {
        dahl_params_t p = params_of(k);
        params[c] = c == at || any(9) == 0 ? bad[any(6)] : in_double(&p);
        states[c].w = any_w();
    }
    for (int form = 0; form < 4; form++) {
        float *F = F_for(n);
        fill_counts(counts_for(n), n, 0.1);
        dahl_err_t err = DAHL_OK;
        switch (form) {
        case 0: err = dahl_throughput_counts_channels(params, states, count, counts_for(n), F, rows); break;
        case 1: err = dahl_throughput_counts(params, states, counts_for(n), F, n); break;
        default: fill_angles(angles_for(n), n, 0.1);
        }
        err = form == 2 ? dahl_throughput_channels(params, states, count, angles_for(n), F, rows) : err;
        err = form == 3 ? dahl_throughput(params, states, angles_for(n), F, n) : err;
        hash = (hash ^ (uint64_t)(int64_t)err) * 1099511628211u;
        fold_F(F, n);
        fold_bytes(states, count * sizeof *states);
    }
}

/* ---------------------------------------------------------------- float form */

static void float_form(uint32_t k)
{
    dahl_params_t p = params_of(k);
    dahl_float_plan_t plan = {0, 0, 0};
    dahl_float_state_t state = {0, 0, 0, 0};
    hash += (uint64_t)(int64_t)dahl_float_prepare(&plan, &p);
    fold_floats(&plan.Fc, 1);
    fold_floats(&plan.a, 1);
    fold_floats(&plan.a_per_count, 1);
    uint32_t kind = any(6), edge = count_at(1.0, (double)travel_of(k));
    for (int t = 0; t < 400; t++) {
        int by_counts = k % 2 ? (int)any(2) : k % 4 == 0;
        float F = by_counts ? dahl_float_step_counts(&plan, &state, any_move(kind == 5 ? any(5) : kind, edge))
                            : dahl_float_step(&plan, &state, any_angle(kind == 5 ? any(5) : kind, 1.0f / plan.a));
        fold_floats(&F, 1);
        fold_floats(&state.w_reversal, 1);
        fold_floats(&state.travel, 1);
        fold_bytes(&state.counts, 4);
        fold_bytes(&state.direction, 4);
    }
}

static int each(void (*ask)(uint32_t), uint32_t times)
{
    for (uint32_t k = 0; k < times; k++) {
        ask(k);
        if (k % 8 == 7 && !part()) {
            return 0;
        }
    }
    return part();
}

int main(int argc, char **argv)
{
    before = argc == 2 ? fopen(argv[1], "r") : NULL;
    is_new = before == NULL;
    before = is_new && argc == 2 ? fopen(argv[1], "w") : before;
    if (before == NULL) {
        fputs("error: as_before FILE: cannot be read or written\n", stderr);
        return 2;
    }
    moves_memory = new_memory();
    F_memory = new_memory();
    plans_memory = new_memory();
    params_memory = new_memory();
    states_memory = new_memory();
    hash = 14695981039346656037u;
    limits();
    int same = part() && each(ties, 20) && each(one_bitwise, 800) && each(one_throughput, 2000) && each(channels, 500) && each(refusals, 400)
               && each(float_form, 400);
    return fclose(before) == 0 && same ? 0 : 1;
}
