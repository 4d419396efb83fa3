/* SPDX-License-Identifier: MIT */
/* dahl.friction: the friction of one joint or tendon as a passive force of MuJoCo. docs/simulators.md is its manual.
 *
 * The force depends on travel. MuJoCo may call compute() several times in a step, at trial positions: each call starts from the
 * state in plugin_state. advance() commits a new state, once, at the end of the step. plugin_data has the prepared model. */
#include <math.h>
#include <stdint.h>

#include "attributes.h"

#ifdef mjUSESINGLE
#error "mjtNum must be double, so that plugin_state can hold whole numbers of 32 bits"
#endif

/* The state of an instance: these numbers, then the words of its friction. All zeros: no position yet. */
enum { PHASE, TIME, POSITION, LOAD, HEADER };
#define PLACED 1.0 /* PHASE: relaxed at POSITION since TIME, in the first step */
#define MOVING 2.0 /* PHASE: a step has ended */
#define ONE_Q30 1073741824.0
#define FINE_TRAVEL 0x1p-12 /* [presliding lengths] of the least move that measures dF/dtheta */

static instance_t *instance_of(const mjData *d, int instance)
{
    return (instance_t *)d->plugin_data[instance];
}

static double position_of(const mjModel *m, const mjData *d, const instance_t *self)
{
    const double angle = self->joint >= 0 ? d->qpos[m->jnt_qposadr[self->joint]] : d->ten_length[self->tendon];
    return friction_position(&self->friction, angle);
}

static void place(const mjData *d, const instance_t *self, mjtNum *state, double position)
{
    state[PHASE] = PLACED;
    state[TIME] = d->time;
    state[POSITION] = position;
    state[LOAD] = (double)self->rest;
}

static void save(mjtNum *numbers, const friction_t *f, const friction_state_t *from)
{
    for (uint32_t k = 0; k < friction_count_words(f); k++) {
        numbers[k] = from->word[k];
    }
}

static void restore(friction_state_t *to, const friction_t *f, const mjtNum *numbers)
{
    for (uint32_t k = 0; k < friction_count_words(f); k++) {
        const bool is_word = numbers[k] >= 0.0 && numbers[k] <= UINT32_MAX;
        to->word[k] = is_word ? (uint32_t)numbers[k] : 0;
    }
}

/* Move by a difference of positions under the committed load and return F. */
static double move_by(const instance_t *self, const mjtNum *state, double distance, friction_state_t *moved)
{
    const friction_t *f = &self->friction;
    const double load = fmax(fmin(state[LOAD], 1.0), 0.0);
    if (f->model == FRICTION_DAHL) { /* may move by angle */
        return (double)friction_move(f, moved, distance, load);
    }
    return friction_move_q30(f, moved, distance, load) / ONE_Q30 * f->Fc;
}

/* Move from the committed state. Write the new state of the friction and return F. */
static double move_from(const instance_t *self, const mjtNum *state, double position, friction_state_t *moved)
{
    restore(moved, &self->friction, state + HEADER);
    return move_by(self, state, position - state[POSITION], moved);
}

/* A reset does not know the positions of a keyframe, and a user may set qpos and time after it. Therefore each call moves the
 * start until the first step ends. Later stages of RK4 do not: their time is later, by a time step at most. */
static bool is_start(const mjModel *m, const mjData *d, const mjtNum *state)
{
    const bool is_stage = d->time > state[TIME] && d->time < state[TIME] + 2.0 * m->opt.timestep;
    return state[PHASE] < PLACED || (state[PHASE] < MOVING && !is_stage);
}

/* MuJoCo does not clear the force of a tree that sleeps, so it must not grow. */
static void subtract_force(const mjModel *m, mjData *d, int dof, double force)
{
    if (d->tree_awake[m->dof_treeid[dof]] != 0) {
        d->qfrc_passive[dof] -= force;
    }
}

/* Return the row of the Jacobian of an instance, on the stack of d. */
static mjtNum *jacobian_of(const mjModel *m, mjData *d, const instance_t *self)
{
    mjtNum *row = mj_stackAllocNum(d, (size_t)m->nv);
    mju_zero(row, (int)m->nv);
    if (self->joint >= 0) {
        row[m->jnt_dofadr[self->joint]] = 1.0;
        return row;
    }
    const int first = m->ten_J_rowadr[self->tendon];
    for (int at = first; at < first + m->ten_J_rownnz[self->tendon]; at++) {
        row[m->ten_J_colind[at]] = d->ten_J[at];
    }
    return row;
}

/* Return the acceleration of a joint or tendon at these accelerations of all joints. */
static double acceleration_of(const mjModel *m, const mjData *d, const instance_t *self, const mjtNum *all)
{
    if (self->joint >= 0) {
        return all[m->jnt_dofadr[self->joint]];
    }
    double sum = 0.0;
    const int first = m->ten_J_rowadr[self->tendon];
    for (int at = first; at < first + m->ten_J_rownnz[self->tendon]; at++) {
        sum += d->ten_J[at] * all[m->ten_J_colind[at]];
    }
    return sum;
}

/* Return a usual acceleration by a force of 1. It gives joints and tendons of any unit a common measure. */
static double usual_acceleration_of(const mjModel *m, const instance_t *self)
{
    const bool is_joint = self->joint >= 0;
    return fmax(is_joint ? m->dof_invweight0[m->jnt_dofadr[self->joint]] : m->tendon_invweight0[self->tendon], mjMINVAL);
}

/* What a force of 1 on a joint or tendon accelerates now, if no constraint acts: its own place, and all places with damping. */
typedef struct {
    double own, all;
} response_t;

/* With c_i = 1/all of each instance i, the sum of c_i J_i'J_i is at most the inertia matrix (Gershgorin), however the joints are
 * coupled. Both are 0 if no joint moves the tendon. */
static response_t response_of(const mjModel *m, mjData *d, const instance_t *self)
{
    response_t response = {0.0, 0.0};
    mj_markStack(d);
    const mjtNum *row = jacobian_of(m, d, self);
    mjtNum *solution = mj_stackAllocNum(d, (size_t)m->nv);
    mj_solveM(m, d, solution, row, 1);
    response.own = acceleration_of(m, d, self, solution);
    for (int i = 0; i < m->nplugin; i++) {
        const instance_t *other = m->plugin[i] == self->slot ? instance_of(d, i) : NULL;
        if (other != NULL && other->dampratio > 0.0f) {
            const double ratio = usual_acceleration_of(m, self) / usual_acceleration_of(m, other);
            response.all += fabs(acceleration_of(m, d, other, solution)) * sqrt(ratio);
        }
    }
    mj_freeStack(d);
    return response;
}

/* Return sigma1/sigma0 dF/dtheta in N m s/rad, with sigma1 for the inertia of a joint in qpos0, or of a tendon now. The limit for
 * the inertia now lets no step reverse the speed, and keeps a step stable that is so without damping. Coupled instances stay so
 * up to a step of 1.7 sqrt(inertia/stiffness), instead of 2. */
static double coefficient_of(const mjModel *m, mjData *d, const instance_t *self, double slope)
{
    const double step = m->opt.timestep;
    const response_t response = response_of(m, d, self);
    if (!(response.own > mjMINVAL)) {
        return 0.0;
    }
    const double limit = (4.0 / (response.all * step) - slope * step) / 8.0;
    const double inertia = self->joint >= 0 ? m->dof_M0[m->jnt_dofadr[self->joint]] : 1.0 / response.own;
    return fmax(fmin(2.0 * (double)self->dampratio * sqrt(inertia / self->friction.sigma0) * slope, limit), 0.0);
}

/* Return sigma1/sigma0 dF/dt = sigma1/sigma0 dF/dtheta speed, with dF/dtheta over the travel that is ahead in this step. It has
 * the sign of the speed, so it only takes energy. */
static double damping_of(const mjModel *m, mjData *d, const instance_t *self, const mjtNum *state, friction_state_t moved)
{
    const friction_t *f = &self->friction;
    const double speed = self->joint >= 0 ? d->qvel[m->jnt_dofadr[self->joint]] : d->ten_velocity[self->tendon];
    const double theta = (double)f->params.each.theta_per_count;
    const double travel = fmax(fabs(speed) * m->opt.timestep, FINE_TRAVEL * f->Fc / f->sigma0);
    const double distance = copysign(theta > 0.0 ? fmax(friction_position(f, travel), 1.0) : travel, speed);
    const double F = move_by(self, state, 0.0, &moved), ahead = move_by(self, state, distance, &moved);
    const double slope = (ahead - F) / (theta > 0.0 ? distance * theta : distance);
    return coefficient_of(m, d, self, slope) * speed;
}

static void compute(const mjModel *m, mjData *d, int instance, int capability)
{
    instance_t *self = instance_of(d, instance);
    mjtNum *state = d->plugin_state + m->plugin_stateadr[instance];
    const double position = position_of(m, d, self);
    (void)capability;
    if (is_start(m, d, state)) {
        place(d, self, state, position);
    }
    friction_state_t moved;
    double F = move_from(self, state, position, &moved);
    if (self->dampratio > 0.0f) {
        F += damping_of(m, d, self, state, moved);
    }
    if (self->joint >= 0) {
        subtract_force(m, d, m->jnt_dofadr[self->joint], F);
        return;
    }
    const int first = m->ten_J_rowadr[self->tendon];
    for (int at = first; at < first + m->ten_J_rownnz[self->tendon]; at++) {
        subtract_force(m, d, m->ten_J_colind[at], d->ten_J[at] * F);
    }
}

/* Commit. qpos is that of the new time. The length of a tendon is that of the last compute(): the start of the step or, in RK4, a
 * trial position. */
static void advance(const mjModel *m, mjData *d, int instance)
{
    instance_t *self = instance_of(d, instance);
    mjtNum *state = d->plugin_state + m->plugin_stateadr[instance];
    if (self->tendon >= 0 && m->opt.integrator == mjINT_RK4) {
        mj_kinematics(m, d);
        mj_tendon(m, d);
    }
    const double position = position_of(m, d, self);
    if (state[PHASE] < PLACED) { /* compute() was not called: passive forces are disabled */
        place(d, self, state, position);
    }
    friction_state_t moved;
    (void)move_from(self, state, position, &moved);
    save(state + HEADER, &self->friction, &moved);
    state[PHASE] = MOVING;
    state[POSITION] = position;
    if (self->full > 0.0f) {
        state[LOAD] = (double)self->rest + fabs(d->qfrc_actuator[m->jnt_dofadr[self->joint]]) / (double)self->full;
    }
}

/* Report no error here: MuJoCo's compiler of models would lose memory. It calls init() later. */
static int nstate(const mjModel *m, int instance)
{
    const friction_t f = {.model = attributes_read_model(m, instance)};
    return HEADER + (int)(f.model < FRICTION_MODELS ? friction_count_words(&f) : 0);
}

static int init(const mjModel *m, mjData *d, int instance)
{
    instance_t attributes;
    attributes_read(m, d, instance, &attributes);
    instance_t *self = mju_malloc(sizeof *self);
    *self = attributes;
    self->slot = m->plugin[instance];
    d->plugin_data[instance] = (uintptr_t)self;
    return 0;
}

static void destroy(mjData *d, int instance)
{
    mju_free(instance_of(d, instance));
}

static void reset(const mjModel *m, mjtNum *state, void *data, int instance)
{
    (void)data;
    mju_zero(state, m->plugin_statenum[instance]);
}

mjPLUGIN_LIB_INIT(dahl_friction)
{
    static const char *keys[ATTRIBUTES_MAX];
    mjpPlugin plugin;
    if (mj_version() != mjVERSION_HEADER) { /* the members of mjModel and mjData may have moved */
        mju_warning("dahl.friction is not registered: compiled for MuJoCo %d, but this is %d", mjVERSION_HEADER, mj_version());
        return;
    }
    mjp_defaultPlugin(&plugin);
    plugin.name = "dahl.friction";
    plugin.nattribute = attributes_list(keys);
    plugin.attributes = keys;
    plugin.capabilityflags = mjPLUGIN_PASSIVE;
    plugin.nstate = nstate;
    plugin.init = init;
    plugin.destroy = destroy;
    plugin.reset = reset;
    plugin.compute = compute;
    plugin.advance = advance;
    mjp_registerPlugin(&plugin);
}
