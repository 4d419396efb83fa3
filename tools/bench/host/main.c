/* SPDX-License-Identifier: MIT */
/*
 * Benchmarks of the host. tools/bench/host.py runs this program and stores the results. Each line is one JSON object.
 *   host_bench errors TICKS            worst and RMS error of F/Fc: each method on each scenario
 *   host_bench parts RATE TARGET       fewest parts of a tick (a power of 2) for which each solver's error is at most TARGET,
 *                                      on a sine of a A = 20 at 1 Hz, sampled RATE times a second
 *   host_bench growth SCENARIO TICKS   worst error up to each power of ten of ticks
 *   host_bench speed TICKS             nanoseconds a tick, and of a plain copy
 *   host_bench batches SCENARIO TICKS  each throughput form once, for callgrind (tests/python/library/test_batch_cost.py)
 *   host_bench moves SCENARIO TICKS    the moves in counts and the exact F/Fc, as text, for rivals in Python
 */
#define _POSIX_C_SOURCE 199309L /* clock_gettime */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "reference.h"
#include "scenarios.h"
#include "ways.h"

enum { BLOCK = 4096, CHANNELS = 16 };

static int32_t moves[BLOCK];
static float angles[BLOCK];
static double exact[BLOCK], exact_angle[BLOCK]; /* rounded to 1e-16, far below the errors compared */
static double ratios[BLOCK];

typedef struct {
    double worst, squares;
    uint64_t ticks;
} tally_t;

static dahl_params_t params_of(const scenario_t *s)
{
    dahl_params_t p = {SCENARIO_SIGMA0, SCENARIO_FC, scenario_theta(s)};
    return p;
}

static const scenario_t *scenario_named(const char *name)
{
    for (size_t i = 0; i < SCENARIOS; i++) {
        if (strcmp(scenarios[i].name, name) == 0) {
            return &scenarios[i];
        }
    }
    fprintf(stderr, "error: no scenario '%s'\n", name);
    exit(2);
}

static double to_double(long double x)
{
    return (double)x;
}

static void add_errors(tally_t *e, const double *wanted, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        double error = fabs(ratios[i] - wanted[i]);
        if (!(error <= e->worst)) { /* NaN too */
            e->worst = error;
        }
        e->squares += error * error;
    }
    e->ticks += n;
}

static void next_block(const scenario_t *s, motion_t *motion, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        moves[i] = s->next(motion);
        angles[i] = (float)moves[i] * scenario_theta(s);
    }
}

static void errors_on(const scenario_t *s, uint64_t ticks)
{
    static run_t runs[64];
    static tally_t errors[64];
    dahl_params_t p = params_of(s);
    reference_t by_counts = reference_by_counts(&p), by_angle = reference_by_angle(&p);
    motion_t motion = MOTION_START;
    memset(errors, 0, sizeof errors);
    for (size_t k = 0; k < ways_count; k++) {
        start_run(&runs[k], &p, 1);
    }
    for (uint64_t t = 0; t < ticks; t += BLOCK) {
        next_block(s, &motion, BLOCK);
        for (size_t i = 0; i < BLOCK; i++) {
            exact[i] = to_double(reference_move(&by_counts, moves[i]));
            exact_angle[i] = to_double(reference_move(&by_angle, (long double)angles[i]));
        }
        for (size_t k = 0; k < ways_count; k++) {
            ways[k].ratios(&runs[k], moves, angles, ratios, BLOCK);
            add_errors(&errors[k], ways[k].by_angle ? exact_angle : exact, BLOCK);
        }
    }
    for (size_t k = 0; k < ways_count; k++) {
        printf("{\"scenario\": \"%s\", \"way\": \"%s\", \"worst\": \"%.3e\", \"rms\": \"%.3e\"}\n", s->name, ways[k].name, errors[k].worst,
               sqrt(errors[k].squares / (double)errors[k].ticks));
    }
    fflush(stdout);
}

/* Position in counts of a 14-bit encoder on the sine. */
static int32_t sampled(uint32_t k, double rate)
{
    return (int32_t)lround(16384.0 / 6.283185307179586 * 0.1 * sin(6.283185307179586 * k / rate));
}

static double sine_error(const way_t *way, double rate, int32_t parts)
{
    dahl_params_t p = {SCENARIO_SIGMA0, SCENARIO_FC, (float)(6.283185307179586 / 16384.0)};
    run_t run;
    tally_t e = {0, 0, 0};
    reference_t reference = reference_by_counts(&p);
    start_run(&run, &p, parts);
    for (uint32_t k = 0; k < 2.0 * rate; k++) {
        moves[0] = sampled(k + 1, rate) - sampled(k, rate);
        exact[0] = to_double(reference_move(&reference, moves[0]));
        way->ratios(&run, moves, angles, ratios, 1);
        add_errors(&e, exact, 1);
    }
    return e.worst;
}

/* At most 2^14 parts; 0 if these are too few. */
static void find_parts(double rate, double target)
{
    static const char *const names[] = {"euler_parts", "rk4_parts", "backward_parts", "trapezoid_parts"};
    for (size_t k = 0; k < 4; k++) {
        int32_t parts = 1;
        double error = sine_error(way_named(names[k]), rate, 1);
        while (!(error <= target) && parts < 16384) {
            parts *= 2;
            error = sine_error(way_named(names[k]), rate, parts);
        }
        printf("{\"rate\": %.0f, \"target\": %.0e, \"way\": \"%s\", \"parts\": %d, \"worst\": \"%.3e\"}\n", rate, target, names[k],
               error <= target ? parts : 0, error);
    }
}

/* One solver with this number of parts on one scenario. */
static void parts_error(const char *name, int32_t parts, const scenario_t *s, uint64_t ticks)
{
    dahl_params_t p = params_of(s);
    run_t run;
    tally_t e = {0, 0, 0};
    reference_t reference = reference_by_counts(&p);
    motion_t motion = MOTION_START;
    start_run(&run, &p, parts);
    for (uint64_t t = 0; t < ticks; t += BLOCK) {
        next_block(s, &motion, BLOCK);
        for (size_t i = 0; i < BLOCK; i++) {
            exact[i] = to_double(reference_move(&reference, moves[i]));
        }
        way_named(name)->ratios(&run, moves, angles, ratios, BLOCK);
        add_errors(&e, exact, BLOCK);
    }
    printf("{\"scenario\": \"%s\", \"way\": \"%s\", \"parts\": %d, \"worst\": \"%.3e\", \"rms\": \"%.3e\"}\n", s->name, name, parts, e.worst,
           sqrt(e.squares / (double)e.ticks));
}

static const char *const grown[] = {"counts", "throughput_counts", "expm1f", "expf", "anchored", "table_counts"};
enum { GROWN = sizeof grown / sizeof grown[0] };

/* For 1e9 ticks the recursion in long double, g of short moves computed once: its error is at most 2^-64/g, below 1e-12. */
typedef struct {
    long double a, w, g[65];
} long_t;

static void start_long(long_t *r, const dahl_params_t *p)
{
    r->a = reference_by_counts(p).a;
    r->w = 0;
    for (int n = 0; n <= 64; n++) {
        r->g[n] = -expm1l(-r->a * n);
    }
}

static double move_long(long_t *r, int32_t move)
{
    int64_t n = move < 0 ? -(int64_t)move : move;
    long double g = n <= 64 ? r->g[n] : -expm1l(-r->a * (long double)n);
    r->w += ((move < 0 ? -1 : 1) - r->w) * g;
    return to_double(r->w);
}

static uint64_t block_end(uint64_t t, uint64_t next)
{
    return t + BLOCK < next ? t + BLOCK : next;
}

static void growth(const scenario_t *s, uint64_t ticks)
{
    static run_t runs[GROWN];
    static tally_t errors[GROWN];
    dahl_params_t p = params_of(s);
    static long_t reference;
    motion_t motion = MOTION_START;
    uint64_t t = 0;
    start_long(&reference, &p);
    for (size_t k = 0; k < GROWN; k++) {
        start_run(&runs[k], &p, 1);
    }
    for (uint64_t decade = 100; decade <= ticks; decade *= 10) {
        while (t < decade) {
            size_t n = (size_t)(block_end(t, decade) - t);
            next_block(s, &motion, n);
            for (size_t i = 0; i < n; i++) {
                exact[i] = move_long(&reference, moves[i]);
            }
            for (size_t k = 0; k < GROWN; k++) {
                way_named(grown[k])->ratios(&runs[k], moves, angles, ratios, n);
                add_errors(&errors[k], exact, n);
            }
            t += n;
        }
        for (size_t k = 0; k < GROWN; k++) {
            printf("{\"scenario\": \"%s\", \"way\": \"%s\", \"ticks\": %" PRIu64 ", \"worst\": \"%.3e\"}\n", s->name, grown[k], decade,
                   errors[k].worst);
        }
        fflush(stdout);
    }
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

typedef struct {
    run_t run;
    int32_t *moves;
    float *angles, *F;
    size_t n;
    dahl_throughput_params_t params[CHANNELS];
    dahl_throughput_params_t other_params[CHANNELS]; /* of channels that differ */
    dahl_state_t states[CHANNELS];
} race_t;

static void run_way(race_t *race, const way_t *way)
{
    way->torques(&race->run, race->moves, race->angles, race->F, race->n);
}

static void throughput_other_channels(race_t *r, const way_t *way)
{
    (void)way;
    (void)dahl_throughput_counts_channels(r->other_params, r->states, CHANNELS, r->moves, r->F, r->n / CHANNELS);
}

static void throughput_channels(race_t *r, const way_t *way)
{
    (void)way;
    (void)dahl_throughput_counts_channels(r->params, r->states, CHANNELS, r->moves, r->F, r->n / CHANNELS);
}

static void throughput_angle_channels(race_t *r, const way_t *way)
{
    (void)way;
    (void)dahl_throughput_channels(r->params, r->states, CHANNELS, r->angles, r->F, r->n / CHANNELS);
}

static void copy(race_t *r, const way_t *way)
{
    (void)way;
    memcpy(r->F, r->moves, 4 * r->n);
    __asm__ volatile("" : : "r"(r->F) : "memory");
}

static void start_race(race_t *race, const scenario_t *s)
{
    dahl_params_t p = params_of(s);
    motion_t motion = MOTION_START;
    start_run(&race->run, &p, 1);
    for (size_t c = 0; c < CHANNELS; c++) {
        race->params[c] = (dahl_throughput_params_t){(double)p.sigma0, (double)p.Fc, (double)p.theta_per_count};
        race->other_params[c] = race->params[c];
        race->other_params[c].sigma0 *= 1.0 + 0.01 * (double)c;
        race->states[c].w = 0;
    }
    for (size_t i = 0; i < race->n; i++) {
        race->moves[i] = s->next(&motion);
        race->angles[i] = (float)race->moves[i] * p.theta_per_count;
    }
}

static const struct {
    const char *name;
    void (*run)(race_t *, const way_t *);
} extra[] = {{"throughput_counts_16", throughput_channels},
             {"throughput_angle_16", throughput_angle_channels},
             {"throughput_counts_16_apart", throughput_other_channels},
             {"copy", copy}};

enum { EXTRA = sizeof extra / sizeof extra[0] };

/* Read and write the arrays, so that each runner finds them in the same caches. Slow runners of a round leave time for
 * other guests of the machine to evict them. */
static void warm(race_t *r)
{
    memcpy(r->F, r->angles, 4 * r->n);
    copy(r, NULL);
}

/* Each round runs all runners, so that a busy machine slows all of them. The best round of each counts. */
static void race_on(race_t *race, const scenario_t *s, int rounds)
{
    double best[64];
    start_race(race, s);
    for (int round = 0; round < rounds; round++) {
        for (size_t k = 0; k < ways_count + EXTRA; k++) {
            warm(race);
            double start = now();
            if (k < ways_count) {
                run_way(race, &ways[k]);
            } else {
                extra[k - ways_count].run(race, NULL);
            }
            double took = now() - start;
            best[k] = round == 0 || took < best[k] ? took : best[k];
        }
    }
    for (size_t k = 0; k < ways_count + EXTRA; k++) {
        printf("{\"scenario\": \"%s\", \"way\": \"%s\", \"ns\": %.4f}\n", s->name, k < ways_count ? ways[k].name : extra[k - ways_count].name,
               best[k] / (double)race->n * 1e9);
    }
    fflush(stdout);
}

static void with_room_for(size_t ticks, race_t *race)
{
    race->n = ticks;
    race->moves = malloc(4 * ticks);
    race->angles = malloc(4 * ticks);
    race->F = malloc(4 * ticks);
    if (race->moves == NULL || race->angles == NULL || race->F == NULL) {
        fputs("error: not enough memory\n", stderr);
        exit(1);
    }
}

static race_t race;

static void speed(size_t ticks)
{
    with_room_for(ticks, &race);
    for (size_t i = 0; i < SCENARIOS; i++) {
        race_on(&race, &scenarios[i], 15);
    }
}

static void batches_once(const scenario_t *s, size_t ticks)
{
    with_room_for(ticks, &race);
    start_race(&race, s);
    run_way(&race, way_named("throughput_counts"));
    run_way(&race, way_named("throughput_angle"));
    for (size_t k = 0; k < 2; k++) {
        extra[k].run(&race, NULL);
    }
}

static void print_moves(const scenario_t *s, uint64_t ticks)
{
    dahl_params_t p = params_of(s);
    reference_t reference = reference_by_counts(&p);
    motion_t motion = MOTION_START;
    for (uint64_t t = 0; t < ticks; t++) {
        int32_t d = s->next(&motion);
        printf("%" PRId32 " %.17g\n", d, to_double(reference_move(&reference, d)));
    }
}

int main(int argc, char **argv)
{
    const char *what = argc > 1 ? argv[1] : "";
    if (strcmp(what, "errors") == 0 && argc == 3) {
        for (size_t i = 0; i < SCENARIOS; i++) {
            errors_on(&scenarios[i], strtoull(argv[2], NULL, 10));
        }
    } else if (strcmp(what, "parts") == 0 && argc == 4) {
        find_parts(atof(argv[2]), atof(argv[3]));
    } else if (strcmp(what, "parts-error") == 0 && argc == 6) {
        parts_error(argv[2], atoi(argv[3]), scenario_named(argv[4]), strtoull(argv[5], NULL, 10));
    } else if (strcmp(what, "growth") == 0 && argc == 4) {
        growth(scenario_named(argv[2]), strtoull(argv[3], NULL, 10));
    } else if (strcmp(what, "speed") == 0 && argc == 3) {
        speed((size_t)strtoull(argv[2], NULL, 10));
    } else if (strcmp(what, "batches") == 0 && argc == 4) {
        batches_once(scenario_named(argv[2]), (size_t)strtoull(argv[3], NULL, 10));
    } else if (strcmp(what, "moves") == 0 && argc == 4) {
        print_moves(scenario_named(argv[2]), strtoull(argv[3], NULL, 10));
    } else {
        fputs("error: host_bench errors|parts|parts-error|growth|speed|batches|moves ...; see tools/bench/host/main.c\n", stderr);
        return 2;
    }
    return 0;
}
