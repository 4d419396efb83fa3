/* SPDX-License-Identifier: MIT */
/* Cases of the other methods: one count with the plan of the library, and the worst case over several travels. */
#include "bench.h"
#include "rivals.h"

int32_t call_coulomb(int32_t *, int32_t) __asm__("bench_call");
float call_rival(const rival_plan_t *, rival_state_t *, int32_t) __asm__("bench_call");

static rival_plan_t plan;

static const float starts[] = {0.0f, 0.3f, -0.7f, 1.0f, -1.0f, 1e-12f};
static const int32_t moves[] = {1, 2, 3, 5, 8, 13, 21, 55, 144, 1000, 10000, 1000000, INT32_MAX};

static const struct {
    const char *name;
    const char *name_worst;
    rival_step_t step;
} rivals[] = {
    {"expm1f", "expm1f_worst", rival_expm1f},
    {"expf", "expf_worst", rival_expf},
    {"exp_double", "exp_double_worst", rival_exp_double},
    {"euler", "euler_worst", rival_euler},
    {"rk4", "rk4_worst", rival_rk4},
    {"table", "table_worst", rival_table},
};

static void from_all_starts(rival_step_t step, int32_t dcounts)
{
    bench_function = (bench_function_t)step;
    for (unsigned i = 0; i < sizeof starts / sizeof starts[0]; i++) {
        rival_state_t state = {starts[i]};
        call_rival(&plan, &state, dcounts);
        state.w = starts[i];
        call_rival(&plan, &state, -dcounts);
    }
}

static void bench_coulomb(void)
{
    int32_t last = 0;
    bench_case("coulomb");
    bench_function = (bench_function_t)rival_coulomb;
    for (int32_t n = -3; n <= 3; n++) {
        call_coulomb(&last, n);
    }
}

void bench_rivals(void)
{
    bench_coulomb();
    rival_prepare(&plan, 100.0f, 0.5f, 3.8349519e-4f);
    for (unsigned k = 0; k < sizeof rivals / sizeof rivals[0]; k++) {
        bench_case(rivals[k].name);
        from_all_starts(rivals[k].step, 1);
        bench_case(rivals[k].name_worst);
        for (unsigned i = 0; i < sizeof moves / sizeof moves[0]; i++) {
            from_all_starts(rivals[k].step, moves[i]);
        }
    }
}
