/* SPDX-License-Identifier: MIT */
/* fmu: see fmu.h. */
#include "fmu.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

bool fmu_fail(const fmu_t *m, const char *format, ...)
{
    char message[256];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    if (m != NULL && m->logger.callback != NULL) {
        m->logger.log(m, message);
    }
    return false;
}

bool fmu_deny(const fmu_t *m, const char *call, size_t n, const char *reason)
{
    return (n == 0 && m != NULL) || fmu_fail(m, "%s: %s", call, reason);
}

static bool check_pointers(const fmu_t *m, const char *call, bool are_given)
{
    if (!are_given) {
        (void)fmu_fail(m, "%s: an argument is NULL", call);
    }
    return m != NULL && are_given;
}

fmu_t *fmu_create(const char *call, const fmu_logger_t *logger, const volatile fmu_start_t *start, const char *name,
                  const char *guid, const char *refusal)
{
    fmu_t *m = calloc(1, sizeof *m);
    if (m == NULL) {
        return NULL;
    }
    m->logger = *logger;
    m->start = *start;
    (void)snprintf(m->name, sizeof m->name, "%s", name == NULL ? "" : name);
    (void)fmu_reset(m);
    if (refusal != NULL) {
        (void)fmu_fail(m, "%s: %s", call, refusal);
    } else if (guid == NULL || strcmp(guid, m->start.guid) != 0) {
        (void)fmu_fail(m, "%s: GUID %s is not %s", call, guid == NULL ? "NULL" : guid, m->start.guid);
    } else {
        return m;
    }
    free(m);
    return NULL;
}

bool fmu_reset(fmu_t *m)
{
    if (m == NULL) {
        return false;
    }
    memset(&m->now, 0, sizeof m->now);
    memcpy(m->now.guid, m->start.guid, sizeof m->now.guid);
    for (uint32_t k = 0; k < FMU_VALUES; k++) {
        m->now.value[k] = m->start.variable[k].start;
    }
    return true;
}

bool fmu_is_in_mode(const fmu_t *m, const char *call, uint64_t mode)
{
    static const char *const entered_by[] = {"Reset", "EnterInitializationMode", "ExitInitializationMode", "Terminate"};
    return m != NULL
        && (m->now.mode == mode || fmu_fail(m, "%s: possible only after %.4s%s", call, call, entered_by[mode]));
}

static bool is_variable(const fmu_t *m, uint32_t vr)
{
    return vr < FMU_VALUES && m->start.variable[vr].name[0] != 0;
}

static bool check_value(const fmu_t *m, const char *call, uint32_t vr, double value)
{
    const char *name = m->start.variable[vr].name;
    const double low = m->start.variable[vr].low, high = m->start.variable[vr].high;
    return (low <= value && value < high)
        || fmu_fail(m, "%s: %s = %.9g is outside %.9g <= %s < %.9g", call, name, value, low, name, high);
}

bool fmu_set_time(fmu_t *m, const char *call, double time)
{
    if (is_variable(m, FMU_TIME)) {
        if (!check_value(m, call, FMU_TIME, time)) {
            return false;
        }
        m->now.value[FMU_TIME] = time;
    }
    return true;
}

static void read_parameters(friction_t *f, const fmu_start_t *start, const double *value)
{
    *f = (friction_t){.model = friction_find(start->model),
                      .params = {.each = {.elements = start->Fcs, .theta_per_count = (float)value[FMU_THETA]},
                                 .slips = start->slips,
                                 .own = (float)value[FMU_OWN]},
                      .is_stiffness_fixed = start->fixed_stiffness != 0};
    for (uint32_t k = 0; k < start->Fcs; k++) {
        f->params.each.sigma0[k] = (float)value[FMU_SIGMA0 + k];
        f->params.each.Fc[k] = (float)value[FMU_FC + k];
    }
}

/* Return the larger of two limits, or the torque after a long move: its rounding may differ from that of the sum of Fc. */
static double largest_torque(const friction_t *f)
{
    if (friction_models[f->model].calls->q30->Fcs == 2) {
        return f->Fc;
    }
    friction_state_t state = {.word = {0}};
    const float forward = friction_move(f, &state, (double)INFINITY, 1.0);
    const float backward = friction_move(f, &state, (double)-INFINITY, 1.0);
    return (double)(forward > -backward ? forward : -backward);
}

/* Report the first element whose travel of one count is out of range. */
static bool fail_travel(const fmu_t *m, const char *call, double theta)
{
    const double *value = m->now.value;
    for (uint32_t k = 0; k < m->start.Fcs; k++) {
        const uint32_t sigma0 = FMU_SIGMA0 + (m->start.sigma0s > 1 ? k : 0), Fc = FMU_FC + k;
        const double travel = value[sigma0] / value[Fc] * theta;
        if (theta > 0.0 && !(travel >= DAHL_TRAVEL_MIN && travel < DAHL_TRAVEL_MAX)) {
            return fmu_fail(m, "%s: %s = %.9g, %s = %.9g, theta_per_count = %.9g: sigma0/Fc theta_per_count = %.9g is outside "
                        "2^-30 <= travel < 2^20", call, m->start.variable[sigma0].name, value[sigma0],
                        m->start.variable[Fc].name, value[Fc], theta, travel);
        }
    }
    return fmu_fail(m, "%s: a parameter is out of range after it is rounded to float", call);
}

/* Prepare the friction from the present values. If they do not fit, it keeps its former plan. */
static bool prepare(fmu_t *m, const char *call)
{
    friction_t friction;
    read_parameters(&friction, &m->start, m->now.value);
    if (friction_prepare(&friction) != DAHL_OK) {
        return fail_travel(m, call, (double)friction.params.each.theta_per_count);
    }
    m->friction = friction;
    m->largest_torque = largest_torque(&friction);
    return true;
}

bool fmu_advance(fmu_t *m, const char *call, uint64_t from)
{
    if (!fmu_is_in_mode(m, call, from) || (from == FMU_INITIALIZING && !prepare(m, call))) {
        return false;
    }
    m->now.position = friction_position(&m->friction, m->now.value[FMU_ANGLE]);
    m->now.mode = from + 1;
    return true;
}

static bool check_reference(const fmu_t *m, const char *call, uint32_t vr)
{
    return is_variable(m, vr)
        || fmu_fail(m, "%s: value reference %u is no variable of the model %s", call, (unsigned)vr, m->start.model);
}

bool fmu_get(const fmu_t *m, const char *call, const uint32_t vr[], size_t n, double value[])
{
    bool is_done = n == 0 ? m != NULL : check_pointers(m, call, vr != NULL && value != NULL);
    for (size_t k = 0; k < n && is_done; k++) {
        is_done = check_reference(m, call, vr[k]);
        if (is_done) {
            value[k] = m->now.value[vr[k]];
        }
    }
    return is_done;
}

static bool check_set(const fmu_t *m, const char *call, uint32_t vr, double value)
{
    if (!check_reference(m, call, vr)) {
        return false;
    }
    const char *name = m->start.variable[vr].name;
    if (vr == FMU_TORQUE || vr == FMU_RATIO || vr == FMU_TIME) {
        return fmu_fail(m, "%s: %s is an output", call, name);
    }
    if (vr > FMU_RATIO && m->now.mode > FMU_INITIALIZING) {
        return fmu_fail(m, "%s: %s = %.9g: a parameter is fixed after %.4sExitInitializationMode", call, name, value, call);
    }
    return check_value(m, call, vr, value);
}

bool fmu_set(fmu_t *m, const char *call, const uint32_t vr[], size_t n, const double value[])
{
    bool is_done = n == 0 ? m != NULL : check_pointers(m, call, vr != NULL && value != NULL);
    for (size_t k = 0; k < n && is_done; k++) {
        is_done = check_set(m, call, vr[k], value[k]);
    }
    for (size_t k = 0; k < n && is_done; k++) {
        m->now.value[vr[k]] = value[k];
    }
    return is_done;
}

/* Move the friction to a position and return its torque. The damping is sigma1/sigma0 dF/dt, so it takes energy only. It counts the
 * change of F by the move alone, not by the load. The torque stays within twice the largest one. */
static double move_to(fmu_t *m, double position, double duration)
{
    const friction_t *f = &m->friction;
    const double *value = m->now.value;
    friction_state_t unmoved = m->now.state;
    double torque = (double)friction_move(f, &m->now.state, position - m->now.position, value[FMU_LOAD]);
    if (value[FMU_SIGMA1] > 0.0) {
        const double change = torque - (double)friction_move(f, &unmoved, 0.0, value[FMU_LOAD]);
        const double limit = 2.0 * m->largest_torque;
        torque += value[FMU_SIGMA1] / f->sigma0 * change / duration;
        torque = torque > limit ? limit : torque < -limit ? -limit : torque;
    }
    return torque;
}

bool fmu_step(fmu_t *m, const char *call, double time, double duration)
{
    if (!fmu_is_in_mode(m, call, FMU_STEPPING)) {
        return false;
    }
    if (!(duration > 0)) {
        return fmu_fail(m, "%s: communicationStepSize = %.9g is not above 0", call, duration);
    }
    if (!fmu_set_time(m, call, time + duration)) {
        return false;
    }
    double *value = m->now.value;
    const double end = friction_position(&m->friction, value[FMU_ANGLE]);
    value[FMU_TORQUE] = move_to(m, end, duration);
    value[FMU_RATIO] = value[FMU_TORQUE] / m->largest_torque;
    m->now.position = end;
    return true;
}

static bool copy_state(const fmu_t *m, const char *call, const fmu_state_t *from, void **state)
{
    if (*state == NULL) {
        *state = malloc(sizeof *from);
    }
    if (*state == NULL) {
        return fmu_fail(m, "%s: no memory for %u bytes", call, (unsigned)sizeof *from);
    }
    memcpy(*state, from, sizeof *from);
    return true;
}

bool fmu_save(const fmu_t *m, const char *call, void **state)
{
    return check_pointers(m, call, state != NULL) && copy_state(m, call, &m->now, state);
}

bool fmu_restore(fmu_t *m, const char *call, const void *state)
{
    if (!check_pointers(m, call, state != NULL)) {
        return false;
    }
    const fmu_state_t before = m->now;
    memcpy(&m->now, state, sizeof m->now);
    if (m->now.mode >= FMU_STEPPING && !prepare(m, call)) {
        m->now = before;
        return false;
    }
    return true;
}

bool fmu_free_state(void **state)
{
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return true;
}

bool fmu_state_size(const fmu_t *m, const char *call, size_t *size)
{
    if (!check_pointers(m, call, size != NULL)) {
        return false;
    }
    *size = sizeof(fmu_state_t);
    return true;
}

static bool check_size(const fmu_t *m, const char *call, size_t size)
{
    return size == sizeof(fmu_state_t)
        || fmu_fail(m, "%s: size = %lu is not %u", call, (unsigned long)size, (unsigned)sizeof(fmu_state_t));
}

bool fmu_serialize(const fmu_t *m, const char *call, const void *state, void *bytes, size_t size)
{
    if (!check_pointers(m, call, state != NULL && bytes != NULL) || !check_size(m, call, size)) {
        return false;
    }
    memcpy(bytes, state, size);
    return true;
}

/* Return true if the position is finite and each value that is no variable is 0. */
static bool has_valid_numbers(const fmu_t *m, const fmu_state_t *from)
{
    bool is_valid = from->position >= -DBL_MAX && from->position <= DBL_MAX;
    for (uint32_t vr = 0; vr < FMU_VALUES; vr++) {
        is_valid = is_valid && (is_variable(m, vr) || (from->value[vr] >= 0.0 && from->value[vr] <= 0.0));
    }
    return is_valid;
}

/* Check bytes from outside. The state of the friction needs no check, since any bits are safe. */
static bool check_state(const fmu_t *m, const char *call, const fmu_state_t *from)
{
    if (memcmp(from->guid, m->start.guid, sizeof from->guid) != 0 || from->mode > FMU_TERMINATED || !has_valid_numbers(m, from)) {
        return fmu_fail(m, "%s: the bytes are no state of the FMU %s", call, m->start.guid);
    }
    bool is_valid = true;
    for (uint32_t vr = 0; vr < FMU_VALUES && is_valid; vr++) {
        is_valid = !is_variable(m, vr) || check_value(m, call, vr, from->value[vr]);
    }
    return is_valid;
}

bool fmu_deserialize(const fmu_t *m, const char *call, const void *bytes, size_t size, void **state)
{
    fmu_state_t from;
    if (!check_pointers(m, call, bytes != NULL && state != NULL) || !check_size(m, call, size)) {
        return false;
    }
    memcpy(&from, bytes, sizeof from);
    return check_state(m, call, &from) && copy_state(m, call, &from, state);
}
