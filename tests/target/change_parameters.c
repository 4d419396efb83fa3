/* SPDX-License-Identifier: MIT */
/*
 * examples/change_parameters under a real interrupt. SysTick steps the bearing at 8 kHz while main prepares both plans without
 * a pause: the one in use with equal parameters, the other with new ones. Each tick must equal that of a copy with constant
 * plans.
 */
#include <stdio.h>
#include <string.h>

#include "cortex_m.h"
#include "friction.h"

#define SYSTICK_CONTROL CORTEX_REGISTER(0xE000E010u)
#define SYSTICK_RELOAD CORTEX_REGISTER(0xE000E014u)
#define SYSTICK_VALUE CORTEX_REGISTER(0xE000E018u)
extern char core_mhz[]; /* its address is the number, from the board's linker script */

enum { TICKS = 8000, SETS = 3, REFRESHES = 20 };

static const dahl_params_t params[SETS] = {{100.0f, 0.5f, 3.8349519e-4f}, {170.0f, 0.3f, 3.8349519e-4f}, {33.0f, 1.0f, 3.8349519e-4f}};
static dahl_plan_t untouched[SETS];
static dahl_state_t reference;

static volatile uint32_t ticks, wrong, taken;
static unsigned current; /* set of the copy */

static int32_t next_move(void)
{
    static uint32_t random = 2463534242u;
    random ^= random << 13;
    random ^= random >> 17;
    random ^= random << 5;
    return (int32_t)(random % 41u) - 20;
}

/* The set of this plan; SETS if its words are of no set or of several. */
static unsigned set_of(const dahl_plan_t *plan)
{
    unsigned set = 0;
    while (set < SETS && memcmp(plan, &untouched[set], sizeof *plan) != 0) {
        set++;
    }
    return set;
}

static float expected(int32_t dcounts, unsigned set)
{
    if (set != current && set != SETS) {
        dahl_change_plan(&untouched[current], &untouched[set], &reference);
        current = set;
        taken++;
    }
    return dahl_step_counts(&untouched[current], &reference, dcounts);
}

void cortex_tick(void)
{
    int32_t dcounts = next_move();
    float F = friction_tick(dcounts);
    unsigned set = set_of(friction_plan());
    float G = expected(dcounts, set);
    wrong += set == SETS || memcmp(&F, &G, sizeof F) != 0;
    ticks++;
}

static bool prepare_all(void)
{
    bool good = true;
    for (unsigned set = 0; set < SETS; set++) {
        good = good && dahl_prepare(&untouched[set], &params[set]) == DAHL_OK;
    }
    return good;
}

int main(void)
{
    uint32_t refused = 0, prepared = 0;
    unsigned set = 0;
    dahl_err_t err;
    if (!prepare_all() || !friction_set(&params[0], &err)) {
        return 1;
    }
    SYSTICK_RELOAD = (uint32_t)(uintptr_t)core_mhz * 125u - 1u;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 7; /* the core's clock, interrupt, on */
    while (ticks < TICKS) {
        for (int i = 0; i < REFRESHES; i++) {
            refused += dahl_prepare(friction_plan(), &params[set]) != DAHL_OK;
            prepared++;
        }
        set = friction_set(&params[(set + 1) % SETS], &err) ? (set + 1) % SETS : set;
    }
    SYSTICK_CONTROL = 0;
    printf("%lu ticks, %lu wrong, %lu changes of parameters, %lu times prepared in use, %lu refused\n", (unsigned long)ticks,
           (unsigned long)wrong, (unsigned long)taken, (unsigned long)prepared, (unsigned long)refused);
    return wrong != 0 || refused != 0 || taken < 10;
}
