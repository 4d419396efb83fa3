/* SPDX-License-Identifier: MIT */
/*
 * The contract of every model. Along a walk torque and Q30 result keep their bounds against the exact solution and leave the
 * same state; 0 counts change no bit; both ends agree, and for slip elements the mirrored walk and split travel. From any bits
 * a call first clamps the state, and the torque keeps its limits. Define HOLDS(condition, words) before the include.
 */
#ifndef PROPERTIES_H
#define PROPERTIES_H

#include "models.h"

enum { ALL_THE_WAY = 32 }; /* moves of INT32_MAX: 64 presliding lengths at least */

typedef struct {
    const model_t *model;
    const set_t *set;
    any_plan_t plan;
    any_state_t state, by_q30, mirrored, in_parts;
    exact_t exact;
} subject_t;

static inline float subject_step(const subject_t *subject, any_state_t *state, int32_t counts, uint32_t load)
{
    const move_t move = {counts, load};
    return subject->model->step(&subject->plan, state, subject->set, move);
}

/* Relaxed, with a plan. Return 0 if prepare refuses the parameters. */
static inline int subject_begin(subject_t *subject, const model_t *model, const set_t *set)
{
    memset(subject, 0, sizeof *subject);
    subject->model = model;
    subject->set = set;
    exact_begin(&subject->exact, model, set);
    return model->prepare(&subject->plan, set) == DAHL_OK;
}

static inline void check_exact(subject_t *s, move_t move, float F)
{
    const long double ratio = s->model->exact(&s->exact, move), whole = whole_of(s->model, s->set);
    HOLDS(fabsl(F - ratio * whole) <= (long double)s->model->ulps * ulp_now(s->model, s->set, move), "the torque is exact");
    HOLDS(s->model->has_load || (float)whole != whole || fabsf(F) <= (float)whole, "the torque stays within Fc if Fc is a float");
    if (s->model->step_q30 != NULL) {
        int32_t q30 = s->model->step_q30(&s->plan, &s->by_q30, move);
        HOLDS(fabsl(q30 * (long double)DAHL_Q30 - ratio) <= (long double)s->model->q30_error, "the Q30 result is exact");
        HOLDS(memcmp(&s->by_q30, &s->state, sizeof s->state) == 0, "both forms leave the same state");
    }
}

static inline void check_symmetry(subject_t *s, move_t move, float F)
{
    const any_state_t before = s->state;
    HOLDS(subject_step(s, &s->state, 0, move.load_q30) == F, "0 counts keep the torque");
    HOLDS(memcmp(&before, &s->state, sizeof before) == 0, "0 counts keep the state");
    if (s->model->is_split) {
        any_state_t further = s->state;
        HOLDS(subject_step(s, &s->mirrored, -move.counts, move.load_q30) == -F, "odd symmetry");
        (void)subject_step(s, &s->in_parts, move.counts / 3, move.load_q30);
        HOLDS(subject_step(s, &s->in_parts, move.counts - move.counts / 3, move.load_q30) == F, "split travel has the same torque");
        HOLDS(memcmp(&s->in_parts, &s->state, sizeof s->state) == 0, "split travel leaves the same state");
        HOLDS(subject_step(s, &further, 1, move.load_q30) >= F, "the torque does not fall with travel");
    }
}

/* The largest torque in a direction. */
static inline long double end_of(const subject_t *s, int direction)
{
    if (s->model->more != MORE_IS_RATIO) {
        return whole_of(s->model, s->set);
    }
    return direction < 0 ? asymmetric_params(s->set).Fc_backward : s->set->p.Fc;
}

/* Each direction ends at its Fc, or at the float nearest to the sum of several. */
static inline void check_end(subject_t *s, int direction)
{
    const long double whole = whole_of(s->model, s->set), end = end_of(s, direction);
    const int is_asymmetric = s->model->more == MORE_IS_RATIO;
    const long double slack = is_asymmetric ? 0x1p-23L * whole : (float)end == end ? 0 : 0.51L * ulp_of_sum(whole);
    float F = 0;
    for (int i = 0; i < ALL_THE_WAY; i++) {
        F = subject_step(s, &s->state, direction < 0 ? INT32_MIN : INT32_MAX, ONE_Q30);
    }
    HOLDS(fabsl(F - direction * end) <= slack, "all the way in one direction is its Fc");
}

static inline void check_ends(subject_t *s)
{
    check_end(s, 1);
    check_end(s, -1);
}

static inline void check_walk(subject_t *s, const move_t *moves, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const move_t move = {moves[i].counts < -INT32_MAX ? -INT32_MAX : moves[i].counts, moves[i].load_q30}; /* has a mirror */
        const float F = subject_step(s, &s->state, move.counts, move.load_q30);
        check_exact(s, move, F);
        check_symmetry(s, move, F);
    }
}

static inline void check_limits(const subject_t *s, move_t move, float F)
{
    const long double c = s->model->has_load ? load_in_range(move) * 0x1p-30L : 1;
    const long double slack = s->model->ulps * ulp_now(s->model, s->set, move);
    HOLDS(F <= c * end_of(s, 1) + slack && F >= -c * end_of(s, -1) - slack, "the torque stays within its limits");
    HOLDS(s->model->step != dahl_model_step || fabsf(F) <= s->set->p.Fc, "the torque stays within Fc to the bit");
}

/* The Q30 result after a move that left the state `after` and the torque F. */
static inline void check_q30(const subject_t *s, any_state_t before, const any_state_t *after, move_t move, float F)
{
    const long double whole = whole_of(s->model, s->set);
    const long double slack = s->model->q30_error * whole + s->model->ulps * ulp_now(s->model, s->set, move);
    const int32_t q30 = s->model->step_q30(&s->plan, &before, move);
    HOLDS(fabsl(q30 * (long double)DAHL_Q30 * whole - F) <= slack, "both forms agree");
    HOLDS(load_in_range(move) > ONE_Q30 || (q30 <= (int32_t)ONE_Q30 && q30 >= -(int32_t)ONE_Q30), "a ratio is at most 2^30");
    HOLDS(memcmp(&before, after, sizeof before) == 0, "both forms leave the same state");
}

/* A move from any bits has the result that it has after a rest under the load before. */
static inline void check_any_bits(const subject_t *s, any_state_t bits, move_t move)
{
    const uint32_t load_before = s->model->has_load == 1 ? bits.loaded.load_q30 : move.load_q30;
    any_state_t state = bits, at_rest = bits, clamped = bits;
    const float F0 = subject_step(s, &at_rest, 0, move.load_q30), F = subject_step(s, &state, move.counts, move.load_q30);
    check_limits(s, move, F0);
    check_limits(s, move, F);
    HOLDS(move.counts > 0 ? F >= F0 : move.counts < 0 ? F <= F0 : F == F0, "the torque follows the direction of the move");
    (void)subject_step(s, &clamped, 0, load_before);
    HOLDS(subject_step(s, &clamped, move.counts, move.load_q30) == F, "a call clamps the state first");
    HOLDS(memcmp(&clamped, &state, sizeof state) == 0, "a call clamps the state first");
    const int has_plan_of_dahl = s->model->prepare == dahl_model_prepare || s->model->prepare == loaded_prepare;
    HOLDS(!has_plan_of_dahl || dahl_state_ok(&state.dahl), "a call leaves a state in range");
    if (s->model->step_q30 != NULL) {
        check_q30(s, bits, &state, move, F);
    }
    HOLDS(subject_step(s, &state, 0, move.load_q30) == F, "0 counts keep the torque");
    HOLDS(memcmp(&clamped, &state, sizeof state) == 0, "0 counts keep the state");
}

#endif
