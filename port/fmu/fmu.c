/* SPDX-License-Identifier: MIT */
/* Co-simulation interface of FMI 2.0 around one friction model. A communication step moves the friction from the angle of
 * the last step to the present angle. Its duration does not matter, so a step may be split. */
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../simulators/friction.h"
#include "fmi2.h"
#include "start.h"
#include "variables.h"

/* volatile: `dahl fmu` replaces this block in the compiled file, so the compiler must not use its values. */
static const volatile fmu_start_t start_block = FMU_START;

/* Modes of an instance, in the order of a simulation, and the call that enters each. */
enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED };
static const char *const entered_by[] = {"fmi2Instantiate or fmi2Reset", "fmi2EnterInitializationMode",
                                         "fmi2ExitInitializationMode", "fmi2Terminate"};

/* All that may change after fmi2Instantiate; the content of an fmi2FMUstate and of its serialized form. */
typedef struct {
    char guid[40]; /* a state of another FMU is rejected by it */
    uint64_t mode;
    double position; /* [rad], or [counts] if theta_per_count is not 0: where the last step ended */
    double value[FMU_VALUES];
    friction_state_t state[DAHL_SLIP_MAX];
} snapshot_t;

typedef struct {
    fmi2CallbackFunctions callback;
    char name[64];
    fmu_start_t start;
    friction_t friction;
    double largest_torque; /* [N m] at load 1 */
    snapshot_t now;
} instance_t;

/* Send an error to the simulator in one line. An instance that is NULL has no logger. */
FMI2_PRINTF(2, 3)
static fmi2Status fail(const instance_t *m, const char *format, ...)
{
    char message[256];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    for (char *percent = message; (percent = strchr(percent, '%')) != NULL;) {
        *percent = '?'; /* the logger uses the message as a format of printf() */
    }
    if (m != NULL && m->callback.logger != NULL) {
        m->callback.logger(m->callback.componentEnvironment, m->name, fmi2Error, "logStatusError", message);
    }
    return fmi2Error;
}

/* Return the instance, or NULL after an error if it is not in this mode. */
static instance_t *in_mode(fmi2Component c, uint64_t mode, const char *call)
{
    instance_t *m = c;
    if (m != NULL && m->now.mode != mode) {
        (void)fail(m, "%s: possible only after %s", call, entered_by[mode]);
        return NULL;
    }
    return m;
}

static void reset(instance_t *m)
{
    memset(&m->now, 0, sizeof m->now);
    memcpy(m->now.guid, m->start.guid, sizeof m->now.guid);
    for (uint32_t k = 0; k < FMU_VALUES; k++) {
        m->now.value[k] = m->start.variable[k].start;
    }
}

static bool is_variable(const instance_t *m, fmi2ValueReference vr)
{
    return vr < FMU_VALUES && m->start.variable[vr].name[0] != 0;
}

static fmi2Status check_value(const instance_t *m, const char *call, fmi2ValueReference vr, double value)
{
    const char *name = m->start.variable[vr].name;
    const double low = m->start.variable[vr].low, high = m->start.variable[vr].high;
    return low <= value && value < high
               ? fmi2OK
               : fail(m, "%s: %s = %.9g is outside %.9g <= %s < %.9g", call, name, value, low, name, high);
}

static void read_parameters(friction_t *f, const fmu_start_t *start, const double *value)
{
    *f = (friction_t){.model = friction_find(start->model),
                      .params = {.elements = start->Fcs, .theta_per_count = (float)value[FMU_THETA]},
                      .breakaway = (float)value[FMU_BREAKAWAY],
                      .slips = start->slips,
                      .is_stiffness_fixed = start->fixed_stiffness != 0};
    for (uint32_t k = 0; k < start->Fcs; k++) {
        f->params.sigma0[k] = (float)value[FMU_SIGMA0 + k];
        f->params.Fc[k] = (float)value[FMU_FC + k];
    }
}

/* Return the torque after a long move. Its rounding may differ from that of the sum of Fc. */
static double largest_torque(const friction_t *f)
{
    friction_state_t state[DAHL_SLIP_MAX] = {0};
    const float forward = friction_move(f, state, (double)INFINITY, 1.0);
    const float backward = friction_move(f, state, (double)-INFINITY, 1.0);
    return (double)(forward > -backward ? forward : -backward);
}

/* Report the first element whose travel of one count is out of range. */
static fmi2Status fail_travel(const instance_t *m, const char *call, double theta)
{
    const double *value = m->now.value;
    for (uint32_t k = 0; k < m->start.Fcs; k++) {
        const uint32_t sigma0 = FMU_SIGMA0 + (m->start.sigma0s > 1 ? k : 0), Fc = FMU_FC + k;
        const double travel = value[sigma0] / value[Fc] * theta;
        if (theta > 0.0 && !(travel >= DAHL_TRAVEL_MIN && travel < DAHL_TRAVEL_MAX)) {
            return fail(m, "%s: %s = %.9g, %s = %.9g, theta_per_count = %.9g: sigma0/Fc theta_per_count = %.9g is outside "
                        "2^-30 <= travel < 2^20", call, m->start.variable[sigma0].name, value[sigma0],
                        m->start.variable[Fc].name, value[Fc], theta, travel);
        }
    }
    return fail(m, "%s: a parameter is out of range after it is rounded to float", call);
}

/* Prepare the friction from the present values. If they do not fit, it keeps its former plan. */
static fmi2Status prepare(instance_t *m, const char *call)
{
    friction_t friction;
    read_parameters(&friction, &m->start, m->now.value);
    if (friction_prepare(&friction) != DAHL_OK) {
        return fail_travel(m, call, (double)friction.params.theta_per_count);
    }
    m->friction = friction;
    m->largest_torque = largest_torque(&friction);
    return fmi2OK;
}

FMI2_FUNCTION(const char *, fmi2GetTypesPlatform, void)
{
    return "default";
}

FMI2_FUNCTION(const char *, fmi2GetVersion, void)
{
    return "2.0";
}

FMI2_FUNCTION(fmi2Status, fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)on, (void)n, (void)categories; /* there are error messages only, which are always on */
    return c == NULL ? fmi2Error : fmi2OK;
}

static fmi2Status check_identity(const instance_t *m, fmi2Type type, fmi2String guid)
{
    if (type != fmi2CoSimulation) {
        return fail(m, "fmi2Instantiate: type %d is not fmi2CoSimulation", (int)type);
    }
    if (guid == NULL || strcmp(guid, m->start.guid) != 0) {
        return fail(m, "fmi2Instantiate: GUID %s is not %s", guid == NULL ? "NULL" : guid, m->start.guid);
    }
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Component, fmi2Instantiate, fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
              const fmi2CallbackFunctions *callback, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible, (void)logging;
    instance_t *m = callback == NULL ? NULL : calloc(1, sizeof *m);
    if (m == NULL) {
        return NULL;
    }
    m->callback = *callback;
    m->start = start_block;
    (void)snprintf(m->name, sizeof m->name, "%s", name == NULL ? "" : name);
    reset(m);
    if (check_identity(m, type, guid) != fmi2OK) {
        free(m);
        return NULL;
    }
    return m;
}

FMI2_FUNCTION(void, fmi2FreeInstance, fmi2Component c)
{
    free(c);
}

FMI2_FUNCTION(fmi2Status, fmi2SetupExperiment, fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
              fmi2Boolean has_stop, fmi2Real stop)
{
    (void)has_tolerance, (void)tolerance, (void)start, (void)has_stop, (void)stop;
    return in_mode(c, INSTANTIATED, "fmi2SetupExperiment") == NULL ? fmi2Error : fmi2OK;
}

/* Go from one mode to the next. */
static fmi2Status advance(fmi2Component c, uint64_t from, const char *call)
{
    instance_t *m = in_mode(c, from, call);
    if (m == NULL || (from == INITIALIZING && prepare(m, call) != fmi2OK)) {
        return fmi2Error;
    }
    m->now.position = friction_position(&m->friction, m->now.value[FMU_ANGLE]);
    m->now.mode = from + 1;
    return fmi2OK;
}

#define ADVANCE(call, from)                                                                                                    \
    FMI2_FUNCTION(fmi2Status, call, fmi2Component c)                                                                           \
    {                                                                                                                          \
        return advance(c, from, #call);                                                                                        \
    }
ADVANCE(fmi2EnterInitializationMode, INSTANTIATED)
ADVANCE(fmi2ExitInitializationMode, INITIALIZING)
ADVANCE(fmi2Terminate, STEPPING)

FMI2_FUNCTION(fmi2Status, fmi2Reset, fmi2Component c)
{
    if (c == NULL) {
        return fmi2Error;
    }
    reset(c);
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2GetReal, fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    const instance_t *m = c;
    for (size_t k = 0; m != NULL && k < n; k++) {
        if (!is_variable(m, vr[k])) {
            return fail(m, "fmi2GetReal: value reference %u is no variable of the model %s", vr[k], m->start.model);
        }
        value[k] = m->now.value[vr[k]];
    }
    return m == NULL ? fmi2Error : fmi2OK;
}

static fmi2Status check_set(const instance_t *m, fmi2ValueReference vr, double value)
{
    if (!is_variable(m, vr)) {
        return fail(m, "fmi2SetReal: value reference %u is no variable of the model %s", vr, m->start.model);
    }
    const char *name = m->start.variable[vr].name;
    if (vr == FMU_TORQUE || vr == FMU_RATIO) {
        return fail(m, "fmi2SetReal: %s is an output", name);
    }
    if (vr > FMU_RATIO && m->now.mode > INITIALIZING) {
        return fail(m, "fmi2SetReal: %s = %.9g: a parameter is fixed after fmi2ExitInitializationMode", name, value);
    }
    return check_value(m, "fmi2SetReal", vr, value);
}

/* Set all values or none. */
FMI2_FUNCTION(fmi2Status, fmi2SetReal, fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    instance_t *m = c;
    fmi2Status status = m == NULL ? fmi2Error : fmi2OK;
    for (size_t k = 0; k < n && status == fmi2OK; k++) {
        status = check_set(m, vr[k], value[k]);
    }
    for (size_t k = 0; k < n && status == fmi2OK; k++) {
        m->now.value[vr[k]] = value[k];
    }
    return status;
}

/* All variables are Real. */
#define NO_VARIABLES(call, type)                                                                                               \
    FMI2_FUNCTION(fmi2Status, call, fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[])                    \
    {                                                                                                                          \
        (void)vr, (void)value;                                                                                                 \
        return n == 0 && c != NULL ? fmi2OK : fail(c, #call ": all variables are Real");                                       \
    }
NO_VARIABLES(fmi2GetInteger, fmi2Integer)
NO_VARIABLES(fmi2GetBoolean, fmi2Boolean)
NO_VARIABLES(fmi2GetString, fmi2String)
NO_VARIABLES(fmi2SetInteger, const fmi2Integer)
NO_VARIABLES(fmi2SetBoolean, const fmi2Boolean)
NO_VARIABLES(fmi2SetString, const fmi2String)

FMI2_FUNCTION(fmi2Status, fmi2DoStep, fmi2Component c, fmi2Real time, fmi2Real duration, fmi2Boolean no_rollback)
{
    (void)time, (void)no_rollback;
    instance_t *m = in_mode(c, STEPPING, "fmi2DoStep");
    if (m == NULL) {
        return fmi2Error;
    }
    if (!(duration > 0)) {
        return fail(m, "fmi2DoStep: communicationStepSize = %.9g is not above 0", duration);
    }
    double *value = m->now.value;
    const double end = friction_position(&m->friction, value[FMU_ANGLE]);
    value[FMU_TORQUE] = (double)friction_move(&m->friction, m->now.state, end - m->now.position, value[FMU_LOAD]);
    value[FMU_RATIO] = value[FMU_TORQUE] / m->largest_torque;
    m->now.position = end;
    return fmi2OK;
}

/* Features that modelDescription.xml denies. */
FMI2_FUNCTION(fmi2Status, fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
              const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr, (void)n, (void)order, (void)value;
    return fail(c, "fmi2SetRealInputDerivatives: canInterpolateInputs is false");
}

FMI2_FUNCTION(fmi2Status, fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
              const fmi2Integer order[], fmi2Real value[])
{
    (void)vr, (void)n, (void)order, (void)value;
    return fail(c, "fmi2GetRealOutputDerivatives: maxOutputDerivativeOrder is 0");
}

FMI2_FUNCTION(fmi2Status, fmi2GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
              const fmi2ValueReference known[], size_t knowns, const fmi2Real change[], fmi2Real derivative[])
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)change, (void)derivative;
    return fail(c, "fmi2GetDirectionalDerivative: providesDirectionalDerivative is false");
}

FMI2_FUNCTION(fmi2Status, fmi2CancelStep, fmi2Component c)
{
    return fail(c, "fmi2CancelStep: canRunAsynchronuously is false");
}

/* Only an asynchronous or discarded step has a status. */
#define NO_STATUS(call, type)                                                                                                  \
    FMI2_FUNCTION(fmi2Status, call, fmi2Component c, const fmi2StatusKind kind, type value)                                    \
    {                                                                                                                          \
        (void)kind, (void)value;                                                                                               \
        return c == NULL ? fmi2Error : fmi2Discard;                                                                            \
    }
NO_STATUS(fmi2GetStatus, fmi2Status *)
NO_STATUS(fmi2GetRealStatus, fmi2Real *)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer *)
NO_STATUS(fmi2GetBooleanStatus, fmi2Boolean *)
NO_STATUS(fmi2GetStringStatus, fmi2String *)

static fmi2Status copy_state(const instance_t *m, const char *call, const snapshot_t *from, fmi2FMUstate *state)
{
    if (*state == NULL) {
        *state = malloc(sizeof *from);
    }
    if (*state == NULL) {
        return fail(m, "%s: no memory for %u bytes", call, (unsigned)sizeof *from);
    }
    memcpy(*state, from, sizeof *from);
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2GetFMUstate, fmi2Component c, fmi2FMUstate *state)
{
    const instance_t *m = c;
    return m == NULL ? fmi2Error : copy_state(m, "fmi2GetFMUstate", &m->now, state);
}

FMI2_FUNCTION(fmi2Status, fmi2SetFMUstate, fmi2Component c, fmi2FMUstate state)
{
    instance_t *m = c;
    if (m == NULL || state == NULL) {
        return fail(m, "fmi2SetFMUstate: the state is NULL");
    }
    const snapshot_t before = m->now;
    memcpy(&m->now, state, sizeof m->now);
    if (m->now.mode >= STEPPING && prepare(m, "fmi2SetFMUstate") != fmi2OK) {
        m->now = before;
        return fmi2Error;
    }
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2FreeFMUstate, fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof(snapshot_t);
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (c == NULL || state == NULL || size != sizeof(snapshot_t)) {
        return fail(c, "fmi2SerializeFMUstate: the state is NULL, or size is not fmi2SerializedFMUstateSize");
    }
    memcpy(bytes, state, size);
    return fmi2OK;
}

/* Return true if the position is finite and each value that is no variable is 0. */
static bool has_valid_numbers(const instance_t *m, const snapshot_t *from)
{
    bool is_valid = from->position >= -DBL_MAX && from->position <= DBL_MAX;
    for (uint32_t vr = 0; vr < FMU_VALUES; vr++) {
        is_valid = is_valid && (is_variable(m, vr) || (from->value[vr] >= 0.0 && from->value[vr] <= 0.0));
    }
    return is_valid;
}

/* Check bytes from outside. The state of the friction needs no check, since any bits are safe. */
static fmi2Status check_snapshot(const instance_t *m, const char *call, const snapshot_t *from)
{
    if (memcmp(from->guid, m->start.guid, sizeof from->guid) != 0 || from->mode > TERMINATED || !has_valid_numbers(m, from)) {
        return fail(m, "%s: the bytes are no state of the FMU %s", call, m->start.guid);
    }
    for (uint32_t vr = 0; vr < FMU_VALUES; vr++) {
        if (is_variable(m, vr) && check_value(m, call, vr, from->value[vr]) != fmi2OK) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    static const char call[] = "fmi2DeSerializeFMUstate";
    const instance_t *m = c;
    snapshot_t from;
    if (m == NULL || size != sizeof from) {
        return fail(m, "%s: size is not fmi2SerializedFMUstateSize", call);
    }
    memcpy(&from, bytes, sizeof from);
    return check_snapshot(m, call, &from) != fmi2OK ? fmi2Error : copy_state(m, call, &from, state);
}
