/* SPDX-License-Identifier: MIT */
/* Functions of FMI 2.0 for co-simulation, with the C types of platform "default"; fmu.h does the work. If fmi2Functions.h of the
 * standard is included first, its types are used and the compiler compares its declarations with ours. */
#include <stdlib.h>
#include <string.h>

#include "fmu.h"
#include "start.h"

/* NOLINTBEGIN(misc-unused-parameters): the standard fixes the parameters */

#ifndef fmi2Functions_h
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void (*fmi2CallbackLogger)(void *environment, const char *name, fmi2Status, const char *category, const char *text, ...);
typedef struct {
    fmi2CallbackLogger logger;
    void *(*allocateMemory)(size_t count, size_t size);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *environment, fmi2Status);
    void *componentEnvironment;
} fmi2CallbackFunctions;
#endif

/* A tool that links several source FMUs into one program defines FMI2_FUNCTION_PREFIX as MODELIDENTIFIER_. */
#ifndef FMI2_FUNCTION_PREFIX
#define FMI2_FUNCTION_PREFIX
#endif
#define NAMED(type, name, parameters) FMU_FUNCTION(type, FMU_NAME(FMI2_FUNCTION_PREFIX, fmi2##name), parameters)

/* Define a function that returns fmi2OK if `work` is true. */
#define FUNCTION(name, parameters, work)                                                                                       \
    NAMED(fmi2Status, name, parameters)                                                                                        \
    {                                                                                                                          \
        static const char call[] = "fmi2" #name;                                                                               \
        (void)call;                                                                                                            \
        return (work) ? fmi2OK : fmi2Error;                                                                                    \
    }

/* volatile: `dahl fmu` replaces this block in the compiled file, so the compiler must not use its values. */
static const volatile fmu_start_t start_block = FMU_START;

/* A cast between types of functions, without a warning. */
typedef union {
    fmi2CallbackLogger logger;
    void (*stored)(void);
} callback_t;

static void log_error(const fmu_t *m, char *message)
{
    for (char *percent = message; (percent = strchr(percent, '%')) != NULL;) {
        *percent = '?'; /* the logger uses the message as a format of printf() */
    }
    const callback_t callback = {.stored = m->logger.callback};
    callback.logger(m->logger.environment, m->name, fmi2Error, "logStatusError", message);
}

NAMED(const char *, GetTypesPlatform, (void))
{
    return "default";
}

NAMED(const char *, GetVersion, (void))
{
    return "2.0";
}

NAMED(void *, Instantiate,
      (const char *name, fmi2Type type, const char *guid, const char *resources, const fmi2CallbackFunctions *callback,
       int visible, int logging))
{
    if (callback == NULL) {
        return NULL;
    }
    const callback_t sender = {.logger = callback->logger};
    const fmu_logger_t logger = {log_error, sender.stored, callback->componentEnvironment};
    const char *refusal = type == fmi2CoSimulation ? NULL : "the type is not fmi2CoSimulation";
    return fmu_create("fmi2Instantiate", &logger, &start_block, name, guid, refusal);
}

NAMED(void, FreeInstance, (void *c))
{
    free(c);
}

/* There are error messages only, which are always on. */
FUNCTION(SetDebugLogging, (void *c, int on, size_t n, const char *const category[]), c != NULL)
FUNCTION(SetupExperiment, (void *c, int has_tolerance, double tolerance, double start, int has_stop, double stop),
         fmu_is_in_mode(c, call, FMU_INSTANTIATED))
FUNCTION(EnterInitializationMode, (void *c), fmu_advance(c, call, FMU_INSTANTIATED))
FUNCTION(ExitInitializationMode, (void *c), fmu_advance(c, call, FMU_INITIALIZING))
FUNCTION(Terminate, (void *c), fmu_advance(c, call, FMU_STEPPING))
FUNCTION(Reset, (void *c), fmu_reset(c))
FUNCTION(DoStep, (void *c, double time, double duration, int no_rollback), fmu_step(c, call, time, duration))
FUNCTION(GetReal, (void *c, const unsigned vr[], size_t n, double value[]), fmu_get(c, call, vr, n, value))
FUNCTION(SetReal, (void *c, const unsigned vr[], size_t n, const double value[]), fmu_set(c, call, vr, n, value))

FUNCTION(GetFMUstate, (void *c, void **state), fmu_save(c, call, state))
FUNCTION(SetFMUstate, (void *c, void *state), fmu_restore(c, call, state))
FUNCTION(FreeFMUstate, (void *c, void **state), fmu_free_state(state))
FUNCTION(SerializedFMUstateSize, (void *c, void *state, size_t *size), fmu_state_size(c, call, size))
FUNCTION(SerializeFMUstate, (void *c, void *state, char bytes[], size_t size), fmu_serialize(c, call, state, bytes, size))
FUNCTION(DeSerializeFMUstate, (void *c, const char bytes[], size_t size, void **state),
         fmu_deserialize(c, call, bytes, size, state))

#define NO_VARIABLES(name, type)                                                                                               \
    FUNCTION(name, (void *c, const unsigned vr[], size_t n, type value[]), fmu_deny(c, call, n, "all variables are Real"))
NO_VARIABLES(GetInteger, int)
NO_VARIABLES(GetBoolean, int)
NO_VARIABLES(GetString, const char *)
NO_VARIABLES(SetInteger, const int)
NO_VARIABLES(SetBoolean, const int)
NO_VARIABLES(SetString, const char *const)

/* Features that modelDescription.xml denies. */
FUNCTION(SetRealInputDerivatives, (void *c, const unsigned vr[], size_t n, const int order[], const double value[]),
         fmu_deny(c, call, 1, "canInterpolateInputs is false"))
FUNCTION(GetRealOutputDerivatives, (void *c, const unsigned vr[], size_t n, const int order[], double value[]),
         fmu_deny(c, call, 1, "maxOutputDerivativeOrder is 0"))
FUNCTION(GetDirectionalDerivative,
         (void *c, const unsigned unknown[], size_t unknowns, const unsigned known[], size_t knowns, const double change[],
          double derivative[]),
         fmu_deny(c, call, 1, "providesDirectionalDerivative is false"))
FUNCTION(CancelStep, (void *c), fmu_deny(c, call, 1, "canRunAsynchronuously is false"))

/* Only an asynchronous or discarded step has a status. */
#define NO_STATUS(name, type)                                                                                                  \
    NAMED(fmi2Status, name, (void *c, const fmi2StatusKind kind, type value))                                                  \
    {                                                                                                                          \
        return c == NULL ? fmi2Error : fmi2Discard;                                                                            \
    }
NO_STATUS(GetStatus, fmi2Status *)
NO_STATUS(GetRealStatus, double *)
NO_STATUS(GetIntegerStatus, int *)
NO_STATUS(GetBooleanStatus, int *)
NO_STATUS(GetStringStatus, const char **)
/* NOLINTEND(misc-unused-parameters) */
