/* SPDX-License-Identifier: MIT */
/* Commission random axes and print one line of JSON for each: commission_axes rigid|flexible FIRST COUNT.
 * tools/bench/axes.py makes the tables of docs/commissioning.md from these lines. */
#include <stdio.h>
#include <stdlib.h>

#include "axis_checks.h"

/* Values over the true ones. The inertia of a flexible axis is compared with that of its rotor. */
static void print_ratios(const axis_t *axis, const dahl_commission_result_t *result)
{
    const truth_t truth = truth_of(axis);
    printf(", \"Fc_low\": %.6f, \"Fc\": %.6f, \"length_long\": %.6f", (double)result->Fc.least / truth.least,
           (double)result->Fc.best / truth.mean, (double)result->length.most / truth.length);
    printf(", \"inertia_low\": %.6f, \"inertia\": %.6f, \"inertia_high\": %.6f",
           (double)result->inertia.least / truth.inertia, (double)result->inertia.best / truth.inertia,
           (double)result->inertia.most / truth.inertia);
}

static void print_rigid(uint64_t number)
{
    const axis_t axis = random_axis(number);
    motion_t motion;
    int passed[LINES] = {0};
    const dahl_commission_t state = commission_axis(&axis, &motion, RIGID_SECONDS);
    printf("{\"axis\": %d, \"refusal\": %d", (int)number, state.command.refusal);
    if (state.command.stage == DAHL_COMMISSION_DONE) {
        count_axis(&axis, &state, passed);
        print_ratios(&axis, &state.result);
        printf(", \"seconds\": %.3f, \"hand\": %.6f", (double)state.result.seconds, hand_torque_ratio(&axis, &state));
    }
    for (int line = 0; line < LINES; line++) {
        printf(", \"%s\": %d", lines[line].name, passed[line]);
    }
    puts("}");
}

static void print_flexible(uint64_t number)
{
    axis_t axis = flexible_axis(number);
    int tries;
    const dahl_commission_t state = commission_flexible(&axis, &tries);
    const int is_accepted = state.command.stage == DAHL_COMMISSION_DONE;
    printf("{\"axis\": %d, \"refusal\": %d, \"tries\": %d", (int)number, state.command.refusal, tries);
    if (is_accepted) {
        print_ratios(&axis, &state.result);
    }
    printf(", \"bounds\": %d, \"rest after pushes\": %d, \"bound of the rotor is true\": %d}\n", is_accepted,
           is_accepted && rests(&axis, &state, 0), is_accepted && bounds_rotor(&axis, &state.result));
}

int main(int count, char **words)
{
    if (count != 4 || (strcmp(words[1], "rigid") != 0 && strcmp(words[1], "flexible") != 0)) {
        fprintf(stderr, "usage: commission_axes rigid|flexible FIRST COUNT\n");
        return 2;
    }
    void (*print)(uint64_t) = strcmp(words[1], "rigid") == 0 ? print_rigid : print_flexible;
    const uint64_t first = strtoull(words[2], NULL, 10), end = first + strtoull(words[3], NULL, 10);
    for (uint64_t number = first; number < end; number++) {
        print(number);
        fflush(stdout);
    }
    return 0;
}
