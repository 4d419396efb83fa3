/* SPDX-License-Identifier: MIT */
/**
 * @file dahl_node.h
 * @brief Friction node on a CAN bus: encoder frames in, torque frames out.
 *
 * Use it to answer each encoder count on a bus with the friction torque. Firmware and simulation
 * link the same file. There is no I/O, heap or operating system, and no float except to read or
 * write a parameter.
 *
 * @code{.c}
 *   static dahl_node_t node;
 *   if (dahl_node_init(&node, &params, 0) != DAHL_OK) { stop(); }
 *   if (dahl_node_receive(&node, &in, now_us, &out)) { send(&out); }   // on each frame
 *   if (dahl_node_tick(&node, now_us, &out)) { send(&out); }           // every millisecond
 * @endcode
 *
 * @par Answer
 * The node answers each accepted EncoderState once, with the FrictionTorque after this count: gain
 * times F/Fc, clamped to limit. With a gain and a limit of 1, as after dahl_node_init(), it has the
 * bits of the library. The count is absolute, so a lost frame loses no travel.
 *
 * @par Faults
 * lib/node/fault_table.h states the reaction to each frame.
 * - Timeout: DAHL_NODE_TIMEOUT_US, unless parameter Timeout was written. Then Status reports STALE
 *   at once; on bus-off, without the wait.
 * - Torque during STALE: 0, because the node sends no answer. If a ramp is set, the gain restarts
 *   at 0.
 * - Recovery: the third good frame in a row ends the silence. Its count is the new starting point.
 *   After a bus-off, good frames count only after one timeout. The fourth bus-off without an answer
 *   in between latches the node until a Reset with Restart.
 * - If the node answers but keeps the bristle, the count is a new starting point: a jump of the
 *   encoder cannot become a torque.
 *
 * @par MaxStep
 * A count is rejected as too far away if it exceeds MaxStep counts for each started ms since the
 * last accepted count. In sequence, each step of the counter counts as at least one ms.
 *
 * @par Limit: late frames
 * The sequence counter has 4 bits. A frame that is 13 to 15 periods late looks like one ahead and
 * is used. With a MaxStep, so is a frame that is 8 to 15 periods late; MaxStep then limits how far
 * it moves the bristle.
 *
 * @par Interrupts and threads
 * There is no lock, so calls for one node, and accesses to its members, must not overlap. If a
 * receive interrupt calls dahl_node_receive(), the main program must mask it, and read the clock
 * while it is masked:
 * @code{.c}
 *   mask(); due = dahl_node_tick(&node, clock_us(), &out); unmask(); if (due) { send(&out); }
 * @endcode
 * No mask is needed if the interrupt only queues frames. No call waits, and two nodes share no data.
 *
 * @par Time and stack of a receive interrupt
 * A ParamWrite that changes Sigma0, Fc or ThetaPerCount calls dahl_prepare() inside
 * dahl_node_receive(): its ParamReply says whether the values fit, and the next EncoderState uses
 * them. It needs several times the instructions and the stack of an EncoderState;
 * docs/microcontroller.md has both for each core.
 *
 * If the interrupt does not have this time, let it only queue the frames. All examples call the
 * node in the main program:
 * @code{.c}
 *   queue_put(&queue, &frame);         // receive interrupt, with a queue of your firmware
 *   while (queue_get(&queue, &in)) {   // main program
 *       if (dahl_node_receive(&node, &in, clock_us(), &out)) { send(&out); }
 *   }
 *   if (dahl_node_tick(&node, clock_us(), &out)) { send(&out); }   // every millisecond
 * @endcode
 * Read the clock at the call, not in the interrupt, so that it does not go back. An answer then
 * waits for the main program, and an EncoderState for a ParamWrite before it.
 *
 * @par Driver
 * The node needs only dahl_can_frame_t and its flags from dahl_can_bus.h. Any driver can fill in
 * id, flags, length and data; time_us is not read.
 */
#ifndef DAHL_NODE_H
#define DAHL_NODE_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"
#include "dahl.h"
#include "dahl_frames.h"
#include "dahl_parts.h"

#ifdef __cplusplus
extern "C" {
#endif

/** [us] Default timeout: 100 frames. The 4-bit counter shows missing frames only modulo 16. */
#define DAHL_NODE_TIMEOUT_US 100000u
/** [us] Default period of Status. */
#define DAHL_NODE_STATUS_US 100000u
/** Largest counter step that is used without a MaxStep: two frames missing. */
#define DAHL_NODE_GAP_MAX 3u
/** Largest counter step that is used with a MaxStep. Larger steps look like late frames. */
#define DAHL_NODE_GAP_MAX_STEP 8u
/** Good frames in a row that make a new starting point. */
#define DAHL_NODE_REARM 3u
/** Bus-offs without an answer in between that latch the node. */
#define DAHL_NODE_OFF_MAX 4u
/** A gain, limit or load of 1. */
#define DAHL_NODE_ONE 65536u

/** Frames by result since dahl_node_init(). */
typedef struct {
    uint32_t ok;             /**< used */
    uint32_t repeated;       /**< same counter as before */
    uint32_t lost;           /**< missing by the counter */
    uint32_t wrong_sequence; /**< counter step larger than allowed */
    uint32_t crc;            /**< wrong CRC */
    uint32_t format;         /**< wrong length or kind of frame */
    uint32_t invalid;        /**< count marked invalid by the encoder */
    uint32_t jump;           /**< count further away than MaxStep allows */
    uint32_t stale;          /**< timeouts */
    uint32_t rearm;          /**< good frames before the end of a silence */
    uint32_t ignored;        /**< other ids */
    uint32_t params;         /**< good ParamWrite frames */
    uint32_t resets;         /**< good Reset frames */
    uint32_t bus_off;        /**< bus-offs */
} dahl_node_counts_t;

/** Counts as Status reports them, modulo 256. */
typedef struct {
    uint8_t lost;        /**< frames missing */
    uint8_t corrupt;     /**< CRC and format errors */
    uint8_t out_of_step; /**< repeated, wrong sequence, jumps, timeouts and bus-offs */
} dahl_node_tally_t;

/** A friction model that replaces the Dahl element, followed by its plan and its state.
 * dahl_node_use() sets it. */
typedef struct {
    const dahl_model_q30_t *calls; /**< calls of the model */
    uint32_t kind;                 /**< value of parameter Model, DAHL_FRAMES_MODEL_... */
} dahl_node_model_t;

/** A node. The members gain .. status_us may be changed after dahl_node_init(). */
typedef struct {
    dahl_plan_t plan;          /**< plan of the Dahl element */
    dahl_params_t params;      /**< present parameters */
    dahl_params_t held;        /**< params plus the values that wait for the next Write */
    dahl_state_t bearing;      /**< state of the Dahl element */
    dahl_node_model_t *model;  /**< model that answers; NULL: plan and bearing */
    dahl_node_counts_t counts; /**< frames by result */
    uint32_t gain;             /**< [1/DAHL_NODE_ONE] gain to reach; more than 1 counts as 1 */
    uint32_t limit;            /**< [1/DAHL_NODE_ONE] limit of |torque|/Fc; more than 1 counts as
                                    1 */
    uint32_t load;             /**< [1/DAHL_NODE_ONE] load relative to that of Fc, for the model
                                    Loaded; more than 1 counts as 1 */
    uint32_t ramp_us;          /**< [us] time of the gain from 0 to 1; 0: none. A gap of more
                                    than 65 ms counts as 65 ms. If it changes while the gain
                                    moves, the next answer goes on from the present gain at the
                                    new rate. With 0, it reaches the gain at once. Each change may
                                    shift the gain by 1/DAHL_NODE_ONE */
    uint32_t timeout_us;       /**< [us] timeout */
    uint32_t max_step;         /**< [counts/ms] MaxStep; 0: no limit */
    uint32_t status_us;        /**< [us] period of Status; 0: only after power-on, a timeout, a
                                    bus-off and a Reset */
    uint32_t gain_now;         /**< [1/DAHL_NODE_ONE] present gain, on its ramp */
    uint32_t gain_rest;        /**< remainder of the ramp, less than ramp_us */
    uint32_t count;            /**< [counts] last accepted count */
    uint32_t good_us;          /**< [us] time of the last accepted count */
    uint32_t sent_us;          /**< [us] time of the last Status */
    uint32_t bus_off_us;       /**< [us] time of the last bus-off */
    uint8_t number;            /**< node number, 0 .. 15 */
    uint8_t state;             /**< dahl_frames_state_t */
    uint8_t errors;            /**< sticky errors of Status */
    uint8_t counter;           /**< counter of the last EncoderState in sequence */
    uint8_t good_in_a_row;     /**< frames in a row, each with the next counter */
    uint8_t candidate;         /**< counter of the last of them */
    uint8_t bus_off_count;     /**< bus-offs since the last answer */
    uint8_t torque_counter;    /**< counter of the next FrictionTorque */
    uint8_t status_counter;    /**< counter of the next Status */
    dahl_node_tally_t cleared; /**< counts at the last Reset; Status reports the difference */
    bool primed;               /**< count and counter are a valid starting point */
    bool silenced;             /**< the next starting point ends a silence */
    bool urgent;               /**< Status is due at once */
} dahl_node_t;

/**
 * Initialize a node: relaxed, before the first frame.
 * @param[out] node   node to write; unchanged if the call fails
 * @param      params parameters of the Dahl element
 * @param      number node number 0 .. 15; higher bits are ignored
 * @return as dahl_prepare()
 */
DAHL_NODISCARD dahl_err_t dahl_node_init(dahl_node_t *node, const dahl_params_t *params,
                                         uint8_t number);

/**
 * @name Other models (dahl_parts.h)
 * Call dahl_node_use() or a wrapper of it after dahl_node_init(). The node then answers with this
 * relaxed model. The storage must live as long as the node. Parameter Model returns the model;
 * writing Fc, Sigma0 or ThetaPerCount is rejected with OutOfRange. If a call fails, it returns the
 * error of the prepare function and changes nothing. A model that is not called is not linked.
 */
/** @{ */

/** Defines dahl_node_NAME_t, the storage of model NAME for a node. */
#define DAHL_NODE_STORAGE(name, ...) \
    typedef struct { \
        dahl_node_model_t model;   /**< must be first */ \
        dahl_##name##_plan_t plan; /**< plan */ \
        dahl_##name##_state_t state; /**< state */ \
    } dahl_node_##name##_t;
DAHL_OTHER_MODELS(DAHL_NODE_STORAGE)

/**
 * Use a model. The answer is a fraction of Fc, of the sum of Fc, or of the larger Fc of two
 * directions; Fc and Sigma0 return these numbers.
 * @code{.c}
 *   static dahl_node_slip_t slip;
 *   err = dahl_node_use(&node, &slip.model, &dahl_model_slip_q30, &params);
 * @endcode
 * @param node    node
 * @param storage member `model` of dahl_node_NAME_t
 * @param model   dahl_model_NAME_q30 of the same NAME; model `loaded` follows parameter Load,
 *   0 .. 1, which starts at 1
 * @param params  parameters; of `loaded` those at load 1
 * @return as the prepare function of the model
 */
DAHL_NODISCARD dahl_err_t dahl_node_use(dahl_node_t *node, dahl_node_model_t *storage,
                                        const dahl_model_q30_t *model,
                                        const dahl_model_params_t *params);

/** Use slip elements. */
DAHL_NODISCARD static inline dahl_err_t dahl_node_use_slip(dahl_node_t *node,
                                                           dahl_node_slip_t *slip,
                                                           const dahl_slip_params_t *params)
{
    dahl_model_params_t all;
    all.each = *params;
    return dahl_node_use(node, &slip->model, &dahl_model_slip_q30, &all);
}

/** Use asymmetric friction. */
DAHL_NODISCARD static inline dahl_err_t
dahl_node_use_asymmetric(dahl_node_t *node, dahl_node_asymmetric_t *storage,
                         const dahl_asymmetric_params_t *params)
{
    dahl_model_params_t all;
    all.each.theta_per_count = params->theta_per_count;
    all.each.sigma0[0] = params->sigma0;
    all.each.Fc[0] = params->Fc_forward;
    all.each.Fc[1] = params->Fc_backward;
    return dahl_node_use(node, &storage->model, &dahl_model_asymmetric_q30, &all);
}

/** Use elasto-plastic friction, without creep below breakaway. */
DAHL_NODISCARD static inline dahl_err_t
dahl_node_use_elastoplastic(dahl_node_t *node, dahl_node_elastoplastic_t *storage,
                            const dahl_params_t *params, float breakaway)
{
    dahl_model_params_t all;
    all.each.theta_per_count = params->theta_per_count;
    all.each.sigma0[0] = params->sigma0;
    all.each.Fc[0] = params->Fc;
    all.own = breakaway;
    return dahl_node_use(node, &storage->model, &dahl_model_elastoplastic_q30, &all);
}

/** Use friction whose Fc and sigma0 scale with parameter Load. params are those at load 1. */
DAHL_NODISCARD static inline dahl_err_t dahl_node_use_loaded(dahl_node_t *node,
                                                             dahl_node_loaded_t *storage,
                                                             const dahl_params_t *params)
{
    dahl_model_params_t all;
    all.each.theta_per_count = params->theta_per_count;
    all.each.sigma0[0] = params->sigma0;
    all.each.Fc[0] = params->Fc;
    return dahl_node_use(node, &storage->model, &dahl_model_loaded_q30, &all);
}

/** Parameters of dahl_node_use_parallel(). */
typedef struct {
    uint32_t elements;           /**< 1 .. DAHL_SLIP_MAX */
    uint32_t slips;              /**< bit k set: element k slips, otherwise it is a Dahl element */
    float theta_per_count;       /**< [rad/count] must not be 0 */
    float sigma0[DAHL_SLIP_MAX]; /**< [N m/rad] stiffness of each element */
    float Fc[DAHL_SLIP_MAX];     /**< [N m] Coulomb torque of each element */
} dahl_node_parallel_params_t;

/** Use Dahl and slip elements on one shaft. Error: 1e-9 plus that of the elements. */
DAHL_NODISCARD static inline dahl_err_t
dahl_node_use_parallel(dahl_node_t *node, dahl_node_parallel_t *storage,
                       const dahl_node_parallel_params_t *params)
{
    dahl_model_params_t all;
    all.slips = params->slips;
    all.each.elements = params->elements;
    all.each.theta_per_count = params->theta_per_count;
    for (uint32_t k = 0; k < DAHL_SLIP_MAX; k++) {
        all.each.sigma0[k] = params->sigma0[k];
        all.each.Fc[k] = params->Fc[k];
    }
    return dahl_node_use(node, &storage->model, &dahl_model_parallel_q30, &all);
}
/** @} */

/**
 * Report a bus-off that the driver does not deliver as an error frame.
 * @param node   node
 * @param now_us [us] time
 */
void dahl_node_bus_off(dahl_node_t *node, uint32_t now_us);

/**
 * Process a received frame of any kind.
 * @param      node   node
 * @param      in     received frame
 * @param      now_us [us] time; one clock for all calls, which may wrap but must not go back
 * @param[out] out    answer
 * @return true if `out` must be sent at once
 */
bool dahl_node_receive(dahl_node_t *node, const dahl_can_frame_t *in, uint32_t now_us,
                       dahl_can_frame_t *out);

/**
 * Check the timeout and the period of Status, about every millisecond. A timeout is detected at the
 * next tick or good frame. After 35 minutes without a tick, an age may appear too short.
 * @param      node   node
 * @param      now_us [us] time
 * @param[out] out    Status frame
 * @return true if `out` must be sent. The first call returns true, unless dahl_node_receive() has
 *   sent the Status before, as the answer to a Reset.
 */
bool dahl_node_tick(dahl_node_t *node, uint32_t now_us, dahl_can_frame_t *out);

#ifdef __cplusplus
}
#endif

#endif
