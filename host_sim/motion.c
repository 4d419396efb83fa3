/* SPDX-License-Identifier: MIT */
#include "motion.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "splitmix.h"
#include "stderr_messages.h"
#include "timing.h"

/* Of steering: ranges of the random numbers, as shares of the given values; a tremor's duration in s. */
static const double SWEEP_MIN = 0.4, SWEEP_MAX = 1.0, SWEEP_TIME_MIN = 0.6, SWEEP_TIME_MAX = 1.4;
static const double TREMOR_MIN_S = 0.02, TREMOR_MAX_S = 0.12, PAUSE_MAX = 2.0;

static uint64_t to_ticks(double seconds)
{
    return (uint64_t)llround(seconds * TICKS_PER_SECOND);
}

static double random_between(motion_t *self, double low, double high)
{
    return low + (high - low) * splitmix_unit(&self->random);
}

static double leg_end(const motion_t *self, int leg)
{
    const double ends[4] = {0, self->run->theta1, self->run->theta2, self->run->theta3};
    return ends[leg];
}

static void next_leg(motion_t *self)
{
    self->leg++;
    self->tick = 1;
    self->hold = to_ticks(self->run->hold_s);
}

static int next_segment(motion_t *self, int64_t *count)
{
    if (self->leg == 3) {
        return 0;
    }
    double from = leg_end(self, self->leg);
    double to = leg_end(self, self->leg + 1);
    double travel = self->run->speed * (double)self->tick / TICKS_PER_SECOND;
    bool has_arrived = travel >= fabs(to - from);
    *count = llround(has_arrived ? to : from + (to > from ? travel : -travel));
    if (!has_arrived) {
        self->tick++;
    } else if (self->hold > 0) {
        self->hold--;
    } else {
        next_leg(self);
    }
    return 1;
}

/* From 0 to 1, with slope 0 at both ends. */
static double smooth_step(double x)
{
    return x * x * (3 - 2 * x);
}

static void new_sweep(motion_t *self)
{
    motion_move_t *sweep = &self->sweep;
    sweep->from = sweep->to;
    sweep->to = self->side * random_between(self, SWEEP_MIN, SWEEP_MAX) * self->run->amplitude;
    sweep->tick = 0;
    sweep->ticks = to_ticks(self->run->sweep_s * random_between(self, SWEEP_TIME_MIN, SWEEP_TIME_MAX)) + 1;
    self->side = -self->side;
    self->hold = to_ticks(self->run->hold_s * random_between(self, 0.0, 1.0));
}

static double next_sweep(motion_t *self)
{
    motion_move_t *sweep = &self->sweep;
    if (sweep->tick < sweep->ticks) {
        sweep->tick++;
    } else if (self->hold > 0) {
        self->hold--;
    } else {
        new_sweep(self);
    }
    return sweep->from + (sweep->to - sweep->from) * smooth_step((double)sweep->tick / (double)sweep->ticks);
}

static void new_bump(motion_t *self)
{
    self->bump = random_between(self, -1.0, 1.0) * self->run->tremor;
    self->bump_ticks = to_ticks(random_between(self, TREMOR_MIN_S, TREMOR_MAX_S));
    self->bump_tick = 0;
}

static void end_bump(motion_t *self)
{
    self->bump_ticks = 0;
    self->bump_tick = to_ticks(random_between(self, 0.0, PAUSE_MAX) * self->run->tremor_s);
}

static double next_bump(motion_t *self)
{
    if (self->bump_ticks == 0) {
        if (self->bump_tick-- == 0) {
            new_bump(self);
        }
        return 0;
    }
    double x = (double)++self->bump_tick / (double)self->bump_ticks;
    if (self->bump_tick >= self->bump_ticks) {
        end_bump(self);
    }
    return self->bump * 16 * x * x * (1 - x) * (1 - x); /* maximum at x = 1/2 */
}

static int next_steering(motion_t *self, int64_t *count)
{
    if (self->tick == self->ticks) {
        return 0;
    }
    double sweep = self->tick == 0 ? 0 : next_sweep(self);
    *count = llround(sweep + (self->tick == 0 ? 0 : next_bump(self)));
    self->tick++;
    return 1;
}

static const char BLANKS[] = " \t\r";

/* Read "count" or "count x". x is 0 if it is not there. */
static bool parse_row(const char *text, int64_t *count, double *x)
{
    char *end, *last;
    long long number = strtoll(text, &end, 10);
    *x = strtod(end, &last);
    *count = number;
    return end != text && (*end == '\0' || strchr(BLANKS, *end) != NULL) && number >= INT32_MIN && number <= INT32_MAX &&
           isfinite(*x) && last[strspn(last, BLANKS)] == '\0';
}

static int next_row(motion_t *self, int64_t *count)
{
    lines_t *rows = &self->counts;
    int result = lines_next(rows);
    if (result == 0 && rows->line == 1) {
        return log_error("%s: has no counts", rows->path);
    }
    if (result == 1 && !parse_row(rows->text, count, &self->load)) {
        return log_error("%s:%llu: %.40s: not a count from %d to %d, or not finite after it", rows->path,
                         (unsigned long long)rows->line, rows->text, INT32_MIN, INT32_MAX);
    }
    return result;
}

bool motion_open(motion_t *self, const run_motion_t *run, const char *path, uint64_t seed)
{
    *self = (motion_t){.run = run, .random = seed, .side = 1};
    switch (run->number) {
    case MOTION_SEGMENTS:
        self->next = next_segment;
        self->hold = to_ticks(run->hold_s);
        return true;
    case MOTION_STEERING:
        self->next = next_steering;
        self->ticks = to_ticks(run->seconds);
        end_bump(self);
        return true;
    default:
        self->next = next_row;
        return lines_open(&self->counts, path);
    }
}

int motion_next(motion_t *self, int32_t *count)
{
    int64_t from_start = 0;
    int result = self->next(self, &from_start);
    if (result == 1) {
        *count = (int32_t)(uint32_t)((uint64_t)from_start + (uint64_t)(int64_t)self->run->start_count);
    }
    return result;
}

void motion_close(motion_t *self)
{
    if (self->run != NULL && self->run->number == MOTION_COUNTS) {
        lines_close(&self->counts);
    }
}
