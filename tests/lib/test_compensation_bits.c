/* SPDX-License-Identifier: MIT */
/* Both laws, the pull and the adaptation have the same bits on each core: one hash over a million random ticks. */
#include <string.h>
#include <unity.h>

#include "../random.h"
#include "dahl_compensator.h"

#define TICKS 1000000
#define HASH_OF_ALL_CORES 0x36ae5fd0u
#define TICKS_WITH_ANY_BITS 4096 /* between two random states */

static uint64_t seed = 20;
static uint32_t hash = 2166136261u;

static void fold(int32_t word)
{
    hash = (hash ^ (uint32_t)word) * 16777619u;
    hash ^= hash >> 15;
}

/* Mostly a few counts, now and then any number. */
static int32_t random_move(void)
{
    const uint32_t choice = random_u32(&seed), any = random_u32(&seed);
    return choice % 64 == 0 ? (int32_t)any >> (choice >> 27) : (int32_t)(any % 13) - 6 + (int32_t)(choice >> 31);
}

static void randomize(void *memory, size_t bytes)
{
    for (size_t k = 0; k < bytes; k++) {
        ((unsigned char *)memory)[k] = (unsigned char)random_u32(&seed);
    }
}

static const dahl_compensator_params_t valid = {
    .friction = {128.0f, 0.5f, 0x1p-11f},
    .law = DAHL_COMPENSATOR_MEASURED,
    .Fc_low = 0.5f,
    .length_long = 0x1p-8f,
    .gain = 0.9f,
    .limit = 0.4f,
    .slew = 40.0f,
    .period = 0x1p-10f,
    .rise = 0.05f,
    .fall = 0.02f,
    .fade_speed = 2.0f,
    .pull = 0.7f,
    .noise = 1,
    .play = 4,
    .jump = 2000,
};

static dahl_plan_t element;

static void measured_tick(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, dahl_state_t *bristle)
{
    const int is_good = random_u32(&seed) % 32 != 0;
    const int32_t move = dahl_compensator_move(plan, compensator, random_move(), is_good);
    fold(dahl_compensator_torque(plan, compensator, dahl_step_counts_q30(&element, bristle, move)));
    fold(compensator->speed_q20);
}

typedef struct {
    dahl_compensator_plan_t plan;
    dahl_adaptation_plan_t adaptation_plan;
    dahl_compensator_t compensator;
    dahl_adaptation_t adaptation;
    dahl_state_t bristle, measured;
} reference_t;

static void reference_tick(reference_t *axis, int32_t direction)
{
    const int32_t move = dahl_compensator_move(&axis->plan, &axis->compensator, direction, random_u32(&seed) % 4096 != 0);
    const int32_t wanted = random_u32(&seed) % 64 == 0 ? random_move() : direction;
    (void)dahl_step_counts_q30(&element, &axis->measured, move);
    dahl_compensator_pull(&axis->plan, &axis->bristle, &axis->measured);
    const int32_t ratio = dahl_adaptation_apply(&axis->adaptation, dahl_step_counts_q30(&element, &axis->bristle, wanted));
    fold(dahl_compensator_torque(&axis->plan, &axis->compensator, ratio));
    const int32_t motor = direction * (int32_t)(random_u32(&seed) >> 6);
    dahl_adaptation_step(&axis->adaptation_plan, &axis->adaptation, &axis->compensator, motor);
    fold((int32_t)(axis->bristle.w >> 32) ^ axis->adaptation.Fc_change_q16);
}

static void test_a_million_random_ticks_have_the_bits_of_all_cores(void)
{
    static reference_t axis;
    static dahl_compensator_t compensator;
    dahl_compensator_plan_t plan;
    dahl_compensator_params_t params = valid;
    dahl_state_t bristle = {0};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&element, &params.friction));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&plan, &params));
    params.law = DAHL_COMPENSATOR_REFERENCE;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&axis.plan, &params));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_adaptation_prepare(&axis.adaptation_plan, &params, 0.002f));
    int32_t largest_change = 0;
    for (int32_t t = 0; t < TICKS / 2; t++) {
        if (t % TICKS_WITH_ANY_BITS == TICKS_WITH_ANY_BITS - 1) {
            randomize(&compensator, sizeof compensator);
            randomize(&axis.compensator, sizeof axis.compensator);
        }
        measured_tick(&plan, &compensator, &bristle);
        reference_tick(&axis, t % 1400 < 700 ? 1 : -1);
        largest_change = axis.adaptation.Fc_change_q16 > largest_change ? axis.adaptation.Fc_change_q16 : largest_change;
    }
    TEST_ASSERT_GREATER_THAN_INT32(1000, largest_change); /* the adaptation has worked */
    TEST_ASSERT_EQUAL_HEX32(HASH_OF_ALL_CORES, hash);
}
