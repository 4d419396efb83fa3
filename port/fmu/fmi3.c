/* SPDX-License-Identifier: MIT */
/* Functions of FMI 3.0 for co-simulation, with the C types of the standard; fmu.h does the work. If fmi3Functions.h of the
 * standard is included first, its types are used and the compiler compares its declarations with ours. */
#include <stdlib.h>

#include "fmu.h"
#include "start.h"

/* NOLINTBEGIN(misc-unused-parameters): the standard fixes the parameters */

#ifndef fmi3Functions_h
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(void *environment, fmi3Status, const char *category, const char *message);
typedef void (*fmi3ClockUpdateCallback)(void *environment);
typedef void (*fmi3IntermediateUpdateCallback)(void *environment, double time, bool can_set, bool can_get, bool is_finished,
                                               bool can_return, bool *returns, double *return_time);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);
#endif

/* A tool that links several source FMUs into one program defines FMI3_FUNCTION_PREFIX as MODELIDENTIFIER_. */
#if defined(FMI3_OVERRIDE_FUNCTION_PREFIX) || !defined(FMI3_FUNCTION_PREFIX)
#undef FMI3_FUNCTION_PREFIX
#define FMI3_FUNCTION_PREFIX
#endif
#define NAMED(type, name, parameters) FMU_FUNCTION(type, FMU_NAME(FMI3_FUNCTION_PREFIX, fmi3##name), parameters)

/* Define a function that returns fmi3OK if `work` is true. */
#define FUNCTION(name, parameters, work)                                                                                       \
    NAMED(fmi3Status, name, parameters)                                                                                        \
    {                                                                                                                          \
        static const char call[] = "fmi3" #name;                                                                               \
        (void)call;                                                                                                            \
        return (work) ? fmi3OK : fmi3Error;                                                                                    \
    }

/* volatile: `dahl fmu` replaces this block in the compiled file, so the compiler must not use its values. */
static const volatile fmu_start_t start_block = FMU_START;

/* A cast between types of functions, without a warning. */
typedef union {
    fmi3LogMessageCallback logger;
    void (*stored)(void);
} callback_t;

static void log_error(const fmu_t *m, char *message)
{
    const callback_t callback = {.stored = m->logger.callback};
    callback.logger(m->logger.environment, fmi3Error, "logStatusError", message);
}

NAMED(const char *, GetVersion, (void))
{
    return "3.0";
}

/* Define a function that returns an instance, or NULL if `refusal` is a message. */
#define INSTANTIATE(type, refusal, ...)                                                                                        \
    NAMED(void *, Instantiate##type,                                                                                           \
          (const char *name, const char *token, const char *resources, bool visible, bool logging, __VA_ARGS__))               \
    {                                                                                                                          \
        const callback_t sender = {.logger = callback};                                                                        \
        const fmu_logger_t logger = {log_error, sender.stored, environment};                                                   \
        return fmu_create("fmi3Instantiate" #type, &logger, &start_block, name, token, refusal);                               \
    }
#define CALLBACK void *environment, fmi3LogMessageCallback callback
INSTANTIATE(CoSimulation,
            has_events          ? "eventModeUsed is true, but hasEventMode is false"
            : intermediates > 0 ? "nRequiredIntermediateVariables is not 0, but providesIntermediateUpdate is false"
                                : NULL,
            bool has_events, bool can_return, const uint32_t intermediate[], size_t intermediates, CALLBACK,
            fmi3IntermediateUpdateCallback update)
#define NO_EXCHANGE "only co-simulation is supported"
INSTANTIATE(ModelExchange, NO_EXCHANGE, CALLBACK)
INSTANTIATE(ScheduledExecution, NO_EXCHANGE, CALLBACK, fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
            fmi3UnlockPreemptionCallback unlock)

NAMED(void, FreeInstance, (void *c))
{
    free(c);
}

/* All variables are scalars. */
static bool check_count(const fmu_t *m, const char *call, size_t n, size_t values)
{
    return n == values || fmu_fail(m, "%s: nValues = %lu is not %lu", call, (unsigned long)values, (unsigned long)n);
}

/* Take a step, which ends neither early nor with an event. */
static bool step(fmu_t *m, const char *call, double time, double duration, bool *const flag[3], double *last_time)
{
    if (flag[0] == NULL || flag[1] == NULL || flag[2] == NULL || last_time == NULL) {
        return fmu_fail(m, "%s: an argument is NULL", call);
    }
    *flag[0] = *flag[1] = *flag[2] = false;
    *last_time = time + duration;
    return fmu_step(m, call, time, duration);
}

/* There are error messages only, which are always on. */
FUNCTION(SetDebugLogging, (void *c, bool on, size_t n, const char *const category[]), c != NULL)
FUNCTION(EnterInitializationMode, (void *c, bool has_tolerance, double tolerance, double start, bool has_stop, double stop),
         fmu_is_in_mode(c, call, FMU_INSTANTIATED) && fmu_set_time(c, call, start) && fmu_advance(c, call, FMU_INSTANTIATED))
FUNCTION(ExitInitializationMode, (void *c), fmu_advance(c, call, FMU_INITIALIZING))
FUNCTION(Terminate, (void *c), fmu_advance(c, call, FMU_STEPPING))
FUNCTION(Reset, (void *c), fmu_reset(c))
FUNCTION(DoStep,
         (void *c, double time, double duration, bool no_rollback, bool *has_event, bool *has_end, bool *is_early,
          double *last_time),
         step(c, call, time, duration, (bool *const[]){has_event, has_end, is_early}, last_time))

#define VARIABLES void *c, const uint32_t vr[], size_t n
FUNCTION(GetFloat64, (VARIABLES, double value[], size_t values),
         check_count(c, call, n, values) && fmu_get(c, call, vr, n, value))
FUNCTION(SetFloat64, (VARIABLES, const double value[], size_t values),
         check_count(c, call, n, values) && fmu_set(c, call, vr, n, value))

FUNCTION(GetFMUState, (void *c, void **state), fmu_save(c, call, state))
FUNCTION(SetFMUState, (void *c, void *state), fmu_restore(c, call, state))
FUNCTION(FreeFMUState, (void *c, void **state), fmu_free_state(state))
FUNCTION(SerializedFMUStateSize, (void *c, void *state, size_t *size), fmu_state_size(c, call, size))
FUNCTION(SerializeFMUState, (void *c, void *state, uint8_t bytes[], size_t size), fmu_serialize(c, call, state, bytes, size))
FUNCTION(DeserializeFMUState, (void *c, const uint8_t bytes[], size_t size, void **state),
         fmu_deserialize(c, call, bytes, size, state))

#define ONLY_FLOAT64 "all variables are Float64"
#define NO_VARIABLES(name, type)                                                                                               \
    FUNCTION(Get##name, (VARIABLES, type value[], size_t values), fmu_deny(c, call, n, ONLY_FLOAT64))                          \
    FUNCTION(Set##name, (VARIABLES, type const value[], size_t values), fmu_deny(c, call, n, ONLY_FLOAT64))
NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Int64, int64_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(Boolean, bool)
NO_VARIABLES(String, const char *)
FUNCTION(GetBinary, (VARIABLES, size_t size[], const uint8_t *value[], size_t values), fmu_deny(c, call, n, ONLY_FLOAT64))
FUNCTION(SetBinary, (VARIABLES, const size_t size[], const uint8_t *const value[], size_t values),
         fmu_deny(c, call, n, ONLY_FLOAT64))

/* Features that modelDescription.xml denies. */
#define CLOCK(name, ...) FUNCTION(name, (VARIABLES, __VA_ARGS__), fmu_deny(c, call, 1, "there is no clock"))
CLOCK(GetClock, bool value[])
CLOCK(SetClock, const bool value[])
CLOCK(GetIntervalDecimal, double interval[], fmi3IntervalQualifier qualifier[])
CLOCK(GetIntervalFraction, uint64_t count[], uint64_t resolution[], fmi3IntervalQualifier qualifier[])
CLOCK(GetShiftDecimal, double shift[])
CLOCK(GetShiftFraction, uint64_t count[], uint64_t resolution[])
CLOCK(SetIntervalDecimal, const double interval[])
CLOCK(SetIntervalFraction, const uint64_t count[], const uint64_t resolution[])
CLOCK(SetShiftDecimal, const double shift[])
CLOCK(SetShiftFraction, const uint64_t count[], const uint64_t resolution[])

#define DENIED(name, parameters, reason) FUNCTION(name, parameters, fmu_deny(c, call, 1, reason))
DENIED(ActivateModelPartition, (void *c, uint32_t clock, double time), "there is no clock")
DENIED(EnterEventMode, (void *c), "hasEventMode is false")
DENIED(EnterStepMode, (void *c), "hasEventMode is false")
DENIED(EvaluateDiscreteStates, (void *c), "hasEventMode is false")
DENIED(UpdateDiscreteStates,
       (void *c, bool *needs_update, bool *has_end, bool *has_nominals, bool *has_states, bool *has_next, double *next_time),
       "hasEventMode is false")
DENIED(EnterConfigurationMode, (void *c), "there is no structural parameter")
DENIED(ExitConfigurationMode, (void *c), "there is no structural parameter")
DENIED(GetNumberOfVariableDependencies, (void *c, uint32_t vr, size_t *n), "providesPerElementDependencies is false")
DENIED(GetVariableDependencies,
       (void *c, uint32_t vr, size_t element[], uint32_t on[], size_t on_element[], fmi3DependencyKind kind[], size_t n),
       "providesPerElementDependencies is false")
DENIED(GetOutputDerivatives, (VARIABLES, const int32_t order[], double value[], size_t values), "maxOutputDerivativeOrder is 0")
#define DERIVATIVE                                                                                                             \
    (VARIABLES, const uint32_t known[], size_t knowns, const double seed[], size_t seeds, double result[], size_t results)
DENIED(GetDirectionalDerivative, DERIVATIVE, "providesDirectionalDerivatives is false")
DENIED(GetAdjointDerivative, DERIVATIVE, "providesAdjointDerivatives is false")
DENIED(EnterContinuousTimeMode, (void *c), NO_EXCHANGE)
DENIED(CompletedIntegratorStep, (void *c, bool no_rollback, bool *has_event, bool *has_end), NO_EXCHANGE)
DENIED(SetTime, (void *c, double time), NO_EXCHANGE)
DENIED(SetContinuousStates, (void *c, const double state[], size_t n), NO_EXCHANGE)
DENIED(GetContinuousStates, (void *c, double state[], size_t n), NO_EXCHANGE)
DENIED(GetContinuousStateDerivatives, (void *c, double derivative[], size_t n), NO_EXCHANGE)
DENIED(GetNominalsOfContinuousStates, (void *c, double nominal[], size_t n), NO_EXCHANGE)
DENIED(GetEventIndicators, (void *c, double indicator[], size_t n), NO_EXCHANGE)
DENIED(GetNumberOfEventIndicators, (void *c, size_t *n), NO_EXCHANGE)
DENIED(GetNumberOfContinuousStates, (void *c, size_t *n), NO_EXCHANGE)
/* NOLINTEND(misc-unused-parameters) */
