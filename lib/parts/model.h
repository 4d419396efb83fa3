/* SPDX-License-Identifier: MIT */
/** Define the objects of a model (dahl_model_t). */
#ifndef DAHL_MODEL_H
#define DAHL_MODEL_H

#include "dahl_parts.h"

/** Numbers of each row of DAHL_MODELS, by name. */
#define DAHL_MODEL_NUMBERS(name, NAME, Class, number, sigma0s, Fcs, ...) \
    dahl_number_of_##name = (number), dahl_sigma0s_of_##name = (sigma0s), dahl_Fcs_of_##name = (Fcs),
enum { DAHL_MODELS(DAHL_MODEL_NUMBERS) };

/** Define dahl_model_NAME and dahl_model_NAME_q30. Before it stand prepare_NAME(), step_NAME() and step_NAME_q30(). */
#define DAHL_DEFINE_MODEL(name, plan_t, state_t)                                                                               \
    const dahl_model_q30_t dahl_model_##name##_q30 = {prepare_##name,                                                          \
                                                      step_##name##_q30,                                                       \
                                                      (uint16_t)sizeof(plan_t),                                                \
                                                      (uint16_t)sizeof(state_t),                                               \
                                                      (uint8_t)dahl_number_of_##name,                                          \
                                                      (uint8_t)dahl_sigma0s_of_##name,                                         \
                                                      (uint8_t)dahl_Fcs_of_##name};                                            \
    const dahl_model_t dahl_model_##name = {&dahl_model_##name##_q30, step_##name};

/** The same for a model whose calls are dahl_NAME_step_counts() and dahl_NAME_step_counts_q30() without a load. */
#define DAHL_DEFINE_MODEL_BY_COUNTS(name)                                                                                      \
    static float step_##name(const void *plan, void *state, int32_t dcounts, uint32_t load_q30)                                \
    {                                                                                                                          \
        (void)load_q30;                                                                                                        \
        return dahl_##name##_step_counts((const dahl_##name##_plan_t *)plan, (dahl_##name##_state_t *)state, dcounts);         \
    }                                                                                                                          \
    static int32_t step_##name##_q30(const void *plan, void *state, int32_t dcounts, uint32_t load_q30)                        \
    {                                                                                                                          \
        (void)load_q30;                                                                                                        \
        return dahl_##name##_step_counts_q30((const dahl_##name##_plan_t *)plan, (dahl_##name##_state_t *)state, dcounts);     \
    }                                                                                                                          \
    DAHL_DEFINE_MODEL(name, dahl_##name##_plan_t, dahl_##name##_state_t)

/** Return the parameters of element k; k = 0 for a model of one element. */
static inline dahl_params_t dahl_element_params(const dahl_model_params_t *params, uint32_t k)
{
    dahl_params_t one;
    one.sigma0 = params->each.sigma0[k];
    one.Fc = params->each.Fc[k];
    one.theta_per_count = params->each.theta_per_count;
    return one;
}

#endif
