/* SPDX-License-Identifier: MIT */
/* Print the table of docs/model.md: worst error of the torque over 1e6 ticks of each hard motion, against long double. Errors
 * of the float form depend on the libm, so they have one digit. */
#include <stdio.h>

#include "dahl_float.h"
#include "motions.h"
#include "reference.h"

#define TICKS 1000000
#define START_RATIO 0.875f /* F/Fc, so that no motion stays near 0 */

typedef struct {
    double counts; /* ulp of Fc */
    double angle;
    double literal; /* of Fc */
} errors_t;

static double larger(double worst, long double error)
{
    return (double)fabsl(error) > worst ? (double)fabsl(error) : worst;
}

static errors_t run(const dahl_params_t *p, motion_fn next)
{
    dahl_plan_t plan;
    dahl_float_plan_t float_plan;
    dahl_state_t counts = {0}, angle = {0};
    dahl_float_state_t literal = {0};
    reference_t exact = reference_by_counts(p), exact_angle = reference_by_angle(p);
    motion_t motion = MOTION_START;
    errors_t worst = {0, 0, 0};
    if (dahl_prepare(&plan, p) != DAHL_OK || dahl_float_prepare(&float_plan, p) != DAHL_OK) {
        return worst;
    }
    dahl_set_torque(&plan, &counts, START_RATIO * p->Fc);
    angle = counts;
    literal.w_reversal = START_RATIO;
    exact.w_reversal = exact_angle.w_reversal = (long double)(START_RATIO * p->Fc) / p->Fc;
    for (int t = 0; t < TICKS; t++) {
        int32_t d = next(&motion);
        float dtheta = (float)d * p->theta_per_count;
        long double F = reference_move(&exact, d) * p->Fc, G = reference_move(&exact_angle, dtheta) * p->Fc;
        worst.counts = larger(worst.counts, (dahl_step_counts(&plan, &counts, d) - F) / ulp_of(p->Fc));
        worst.angle = larger(worst.angle, (dahl_step(&plan, &angle, dtheta) - G) / ulp_of(p->Fc));
        worst.literal = larger(worst.literal, (dahl_float_step_counts(&float_plan, &literal, d) - F) / p->Fc);
    }
    return worst;
}

int main(void)
{
    static const char *const words[MOTIONS] = {"long sweeps", "dither of 1 count", "2 forward, 1 back", "random walk of 8 counts",
                                               "leaps to INT32_MIN"};
    static const float travels[] = {1e-6f, 1e-2f};
    printf("| motion, 1e6 ticks | travel of one count | `dahl_step_counts` [ulp of Fc] | `dahl_step` [ulp of Fc] | `dahl_float_*` [of Fc] |\n");
    printf("|---|---|---|---|---|\n");
    for (size_t m = 0; m < MOTIONS; m++) {
        for (size_t i = 0; i < 2; i++) {
            dahl_params_t p = {travels[i] * 2.739f / 3.8e-4f, 2.739f, 3.8e-4f};
            errors_t worst = run(&p, motions[m].next);
            printf("| %s | %.0e | %.3f | %.3f | %.0e |\n", words[m], (double)travels[i], worst.counts, worst.angle, worst.literal);
        }
    }
    return 0;
}
