/* SPDX-License-Identifier: MIT */
/**
 * @file dahl_compensator.h
 * @brief Feed-forward torque that cancels friction, with the checks that make it safe to switch on.
 *
 * Use it to add the torque of a friction element to a motor command. It works with any element
 * (Dahl, slip, parallel, asymmetric, elasto-plastic, loaded): one call before the tick of the
 * element, one call after it.
 *
 * @par Laws
 * - #DAHL_COMPENSATOR_MEASURED, for an axis that a hand or a wheel can drive: step the element by
 *   the result of dahl_compensator_move(), the measured counts behind a play.
 * - #DAHL_COMPENSATOR_REFERENCE, for an axis with a position loop: step the element by the move of
 *   the reference. dahl_compensator_move() still reads the encoder, for faults and speed. Add the
 *   residual observer below: alone, this law pushes a shaft at rest away from its target.
 *
 * @par Use (measured law; Fc_low, length_long and sigma0_high come from `dahl identify`)
 * @code{.c}
 *   static dahl_plan_t friction;           static dahl_state_t bristle;
 *   static dahl_compensator_plan_t plan;   static dahl_compensator_t compensator;   // all zeros
 *   static const dahl_compensator_params_t params = {
 *       .friction = {Fc_low / length_long, Fc_low, 3.835e-4f},   // sigma0, Fc, rad per count
 *       .law = DAHL_COMPENSATOR_MEASURED, .Fc_low = Fc_low, .length_long = length_long,
 *       .sigma0_high = sigma0_high, .load = 0.0f, .inertia = 0.002f,   // N m/rad, N m, kg m2
 *       .delay = 2e-3f, .elastic = 0,                                  // s
 *       .gain = 0.9f, .limit = 1.0f, .slew = 50.0f, .period = 1e-3f,   // N m, N m/s, s
 *       .rise = 0.5f, .fall = 0.02f, .fade_speed = 5.0f,               // s, s, rad/s
 *       .noise = 1, .play = 4, .jump = 200};                           // counts
 *   // start:
 *     if (dahl_prepare(&friction, &params.friction) != DAHL_OK
 *         || dahl_compensator_prepare(&plan, &params) != DAHL_COMPENSATOR_OK) { stop(); }
 *   // each tick:
 *     int32_t move = dahl_compensator_move(&plan, &compensator, dcounts, encoder_is_good);
 *     int32_t w = dahl_step_counts_q30(&friction, &bristle, move);
 *     int32_t y = dahl_compensator_torque(&plan, &compensator, w);
 *     command_mNm += dahl_to_units(y, Fc_mNm);
 *   // reference law, in place of the second line of the tick:
 *     w = dahl_step_counts_q30(&friction, &bristle, reference_move);
 * @endcode
 *
 * @par Bad readings
 * In a tick with a bad reading, pass is_good = 0, and do not call dahl_encoder_move(). There is an
 * example in docs/encoder.md.
 *
 * A move is used only if the reading before it was accepted too. The first good reading after a
 * rejected one returns 0: it sets the start of the next move, and may shift the counts within the
 * play. So no way back from a wrong count steps the element, even if dahl_encoder_move() read it.
 * - A bad reading loses the motion of its tick and of the next one. If the next move is longer than
 *   `jump`, it loses that of a third tick.
 * - The torque is held. From #DAHL_COMPENSATOR_BAD_TICKS bad readings without a used move on, it
 *   fades out in `fall`, also if good and bad readings take turns.
 * - If dahl_encoder_move() reads bad readings again and again, a free axis trembles: each time, the
 *   place of the noise within the play is lost.
 * - A wrong reading that is neither reported nor longer than `jump` counts as motion.
 *
 * @par Torque
 * y = gain w fade speed_fade, then a limit on its slew, then a limit on y. A torque is a fraction
 * of Fc of the element in Q30, with the sign of the motion: add it to the command. dahl_to_units()
 * converts it. Each term can be read in dahl_compensator_t.
 *
 * @par Guarantee (measured law)
 * After a push, a free axis comes to rest as without the law. Its end speed exceeds that without
 * the law by at most 0.02 rad/s, or 2 counts times sqrt(sigma0/inertia) if that is more. Three
 * rules must hold, which the prepare function enforces:
 * - 3 inertia >= sigma0_high (delay + period/2)^2: a lighter rotor swings,
 * - gain Fc <= 0.95 (Fc_low - load): otherwise a load drives the axis,
 * - Fc/sigma0 >= length_long, or 4 length_long if the axis is elastic: otherwise the motor swings
 *   on its shaft.
 *
 * The bounds must be true:
 * - Fc_low is at most the true Fc, at all speeds below twice fade_speed, and in each condition,
 * - length_long is at least the true presliding length that the encoder sees: the breakaway torque
 *   over sigma0, and the twist of the shaft,
 * - sigma0_high, load and delay are upper bounds, inertia is a lower one,
 * - the true friction is Dahl- or LuGre-like,
 * - the noise of the encoder is at most `noise` and does not follow the motion, as a hysteresis
 *   does. The play is at least 2 noise + 2, or 1 without noise. (Prepare enforces 2 noise.)
 * - slew is at least 20 Fc in a second, and at least Fc sqrt(sigma0/inertia)/25,
 * - fade_speed is 0, or at least half of Fc/sqrt(sigma0 inertia),
 * - the shaft of an elastic axis has a damping ratio of at least 0.01,
 * - bad readings are single ones, at most 2 in 100, and not passed to dahl_encoder_move().
 *
 * If slip elements make the presliding, give three times the measured length.
 *
 * A smaller play makes small motions lighter, but a free axis can keep moving.
 * docs/compensation.md has numbers for both.
 *
 * @par Energy (measured law)
 * If an external force moves the axis in strokes longer than the play and the presliding length,
 * the law adds no energy. It does not see a stroke within the play: the torque stays while the
 * friction relaxes. Such a stroke to and fro gets at most 2 gain Fc play, in J with the play in rad.
 * The first long stroke after short ones gets at most 2 Fc length_long. A law that only reads the
 * encoder cannot avoid this: docs/compensation.md.
 *
 * @par Not promised
 * - A benefit with 12 bits or fewer.
 * - Passivity of the reference law.
 * - Rest on a machine that shakes: a vibration within the play lets the shaft creep in the
 *   direction of its last motion.
 * - A reaction to faults that the caller does not report: an encoder that repeats its last count
 *   looks like rest.
 *
 * @par Properties
 * As in dahl.h: integers only, equal bits everywhere, no heap, no global variable, no libm, no
 * division by a variable in a tick. A plan of all zeros gives no torque. A compensator of all zeros
 * is relaxed and fades in. With a prepared plan, any bits are a safe state: the torque stays within
 * the limit. dahl.h says how to store a plan.
 */
#ifndef DAHL_COMPENSATOR_H
#define DAHL_COMPENSATOR_H

#include "dahl.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Bad readings without a used move in between that start the fade. Fewer only hold the torque. */
#define DAHL_COMPENSATOR_BAD_TICKS 3u
/** [count] Largest play, and largest noise times 2. */
#define DAHL_COMPENSATOR_PLAY_MAX 16777216u
/** [count] Largest jump. */
#define DAHL_COMPENSATOR_JUMP_MAX 1073741824u
/** [1] A jump must be below this multiple of the counts of a tick at fade_speed. */
#define DAHL_COMPENSATOR_JUMP_SPEEDS 1000u
/** [count] Counts of a tick at fade_speed above which half of that factor applies. */
#define DAHL_COMPENSATOR_FINE_COUNTS 16384u
/** [1] Rounding of gain and fades, as a part of the torque of the element. */
#define DAHL_COMPENSATOR_ERROR 1.0682e-4

/** Result of dahl_compensator_prepare() and dahl_residual_prepare(). Except 0, the codes differ
 * from those of dahl_err_t. */
typedef enum {
    DAHL_COMPENSATOR_OK = 0,         /**< success */
    DAHL_COMPENSATOR_PARAM = -17,     /**< a parameter is NaN, infinite, negative, or zero but must
                                           not be; or the law is unknown */
    DAHL_COMPENSATOR_RANGE = -18,     /**< a parameter is out of range */
    DAHL_COMPENSATOR_GAIN = -19,      /**< gain Fc is above 0.95 (Fc_low - load); reference law:
                                           above Fc_low */
    DAHL_COMPENSATOR_SLOPE = -20,     /**< the presliding length Fc/sigma0 is below length_long, or
                                           below 4 length_long of an elastic axis */
    DAHL_COMPENSATOR_PLAY = -21,      /**< the play is below twice the noise, or below 1 count */
    DAHL_COMPENSATOR_WRONG_LAW = -22, /**< dahl_residual_prepare(): not the reference law */
    DAHL_COMPENSATOR_INERTIA = -23,   /**< 3 inertia is below sigma0_high (delay + period/2)^2 */
    DAHL_COMPENSATOR_CORNER = -24,    /**< dahl_residual_prepare(): the corner is too high for the
                                           loop, or for the resonance */
} dahl_compensator_err_t;

/** Move that steps the element. */
typedef enum {
    DAHL_COMPENSATOR_MEASURED = 1, /**< the measured counts, behind the play */
    DAHL_COMPENSATOR_REFERENCE = 2 /**< the reference of a position loop */
} dahl_compensator_law_t;

/** Parameters. Every float is 2^-64 <= x < 2^64, or 0 if its comment gives 0 a meaning. */
typedef struct {
    dahl_params_t friction;     /**< Fc [N m] and steepest sigma0 [N m/rad] of the element, and
                                     theta_per_count [rad/count]; none may be 0. For several
                                     elements, give the sums; for asymmetric friction, the larger
                                     Fc. */
    dahl_compensator_law_t law; /**< move that steps the element */
    float Fc_low;               /**< [N m] lower bound of the true Fc. With the reference law, 0
                                     skips the check. */
    float length_long;          /**< [rad] upper bound of the true presliding length: Fc/sigma0, or
                                     the breakaway torque over sigma0 if that is larger than Fc,
                                     as the encoder sees it: with the twist of the shaft. With the
                                     reference law, 0 skips the check. */
    float sigma0_high;          /**< [N m/rad] upper bound of the true steepest stiffness. This and
                                     the next four: measured law only. */
    float load;                 /**< [N m] largest constant torque from outside: gravity, a spring,
                                     a cable; 0: none */
    float inertia;              /**< [kg m2] lower bound of what turns with the encoder: rotor and
                                     load, or the rotor alone if the axis is elastic */
    float delay;                /**< [s] upper bound of the time from the reading to the torque,
                                     with the lag of the current loop; not 0 */
    uint32_t elastic;           /**< 1 if a gear, belt, coupling or any resonance is between motor
                                     and load; 0 if the axis is rigid */
    float gain;                 /**< [1] 0 .. 1: share of the friction to cancel */
    float limit;                /**< [N m] largest torque; above 2 Fc counts as 2 Fc */
    float slew;                 /**< [N m/s] largest change of the torque, at least 2^-29 Fc in a
                                     tick: 40 to 200 Fc in a second costs little, but a light rotor
                                     may need more: see the guarantee */
    float period;               /**< [s] time between two ticks */
    float rise;                 /**< [s] time to fade in at start and after a fault, at most 2^30
                                     ticks; 0: at once */
    float fall;                 /**< [s] time to fade out while the encoder is bad, at most 2^30
                                     ticks; 0: at once */
    float fade_speed;           /**< [rad/s] the torque falls from all of it at this speed to 0 at
                                     twice this speed; 0: no fade over speed. With more than
                                     #DAHL_COMPENSATOR_FINE_COUNTS per tick at this speed, the fade
                                     may start earlier. */
    uint32_t noise;             /**< [count] the noise is within +-noise, added before or after the
                                     angle is rounded to counts; half the flicker at rest, rounded
                                     up */
    uint32_t play;              /**< [count] width of the dead zone that follows the counts: 2 noise
                                     + 2 for the guarantee, or 1 without noise. At least 2 noise
                                     and 1, at most #DAHL_COMPENSATOR_PLAY_MAX */
    uint32_t jump;              /**< [count] longer moves of a tick are rejected: at least 1, at
                                     most #DAHL_COMPENSATOR_JUMP_MAX. With a fade_speed, below that
                                     and below #DAHL_COMPENSATOR_JUMP_SPEEDS times the counts of a
                                     tick at fade_speed. */
} dahl_compensator_params_t;

/** Values that dahl_compensator_prepare() derives from the parameters. Integers only. `dahl plan`
 * does not write it. */
typedef struct {
    uint32_t gain_q16;      /**< [Q16] gain, rounded down */
    int32_t limit_q30;      /**< [Q30 of Fc] limit */
    uint32_t slew_q30;      /**< [Q30 of Fc] largest change in a tick */
    uint32_t rise_q30;      /**< [Q30] increase of the fade in a good tick */
    uint32_t fall_q30;      /**< [Q30] decrease of the fade in a bad tick */
    uint32_t jump;          /**< [count] longest move of a tick */
    int32_t play;           /**< [count] width of the play */
    uint8_t speed_shift;    /**< the mean of the speed covers 2^speed_shift ticks */
    uint8_t law;            /**< dahl_compensator_law_t */
    uint32_t speed_mask;    /**< 2^speed_shift - 1 */
    uint32_t speed_unit;    /**< [Q20] speed of one count per tick over fade_speed */
    uint32_t Fc_mantissa;   /**< Fc = Fc_mantissa 2^Fc_exponent [N m]; top bit set */
    int32_t Fc_exponent;    /**< exponent of Fc_mantissa */
    uint32_t fade_mantissa; /**< fade_speed [rad/s] likewise; 0: no fade over speed */
    int32_t fade_exponent;  /**< exponent of fade_mantissa */
} dahl_compensator_plan_t;

/** State and telemetry of one compensator. All zeros: relaxed, faded out. */
typedef struct {
    int32_t play_position;    /**< [count] position of the counts within the play */
    int32_t move;             /**< [count] last result of dahl_compensator_move() */
    uint32_t bad_ticks;       /**< rejected readings since the last move that was used */
    uint32_t rejected;        /**< rejected readings since the start; stops at UINT32_MAX */
    uint32_t needs_start;     /**< not 0: the last reading was rejected; the next good one only sets
                                   the start of a move */
    int32_t speed_q20;        /**< [Q20 of fade_speed] mean of the speed */
    uint32_t fade_q30;        /**< [Q30] fade: 0 out, 2^30 in */
    uint32_t speed_fade_q15;  /**< [Q15] fade over speed */
    int32_t ratio_q30;        /**< [Q30 of Fc] last torque of the element */
    int32_t wanted_q30;       /**< [Q30 of Fc] after gain and fades, before slew and limit */
    int32_t torque_q30;       /**< [Q30 of Fc] last result of dahl_compensator_torque() */
} dahl_compensator_t;

/**
 * Prepare a compensator. Call it at start-up.
 * @param[out] plan   plan to write; unchanged if the call fails
 * @param      params parameters; both pointers must be valid
 * @return #DAHL_COMPENSATOR_OK, or why the parameters are rejected. Of several reasons, the first
 *   in the order of dahl_compensator_err_t.
 * @note Bounds are compared exactly. Two are rounded to the safe side: the rule of the inertia by
 *   2^-26 of it, Fc_low - load by 2^-30 of it. A length_long one float above Fc/sigma0 passes, so
 *   that sigma0 = Fc/length_long is accepted in float.
 */
DAHL_NODISCARD dahl_compensator_err_t dahl_compensator_prepare(
    dahl_compensator_plan_t *plan, const dahl_compensator_params_t *params);

/** Result of dahl_compensator_params_plausible(): a unit that is probably wrong. */
typedef enum {
    DAHL_COMPENSATOR_PLAUSIBLE = 0,   /**< no remark */
    DAHL_COMPENSATOR_LONG_PERIOD = 1, /**< the period is above 0.04 s, or longer than rise or fall:
                                           ms, us or Hz? */
    DAHL_COMPENSATOR_FAST_FADE = 2    /**< at fade_speed, a tick moves by more than jump, so that
                                           its reading is rejected: deg/s or rpm? */
} dahl_compensator_plausible_t;

/**
 * Check parameters for the usual mistakes with units: a period in us or ms, a fade_speed in rpm or
 * deg/s. Call it if a person enters numbers. A remark is no error. For the friction, call
 * dahl_params_plausible(), too.
 *
 * @param params parameters
 * @return the first remark of dahl_compensator_plausible_t; #DAHL_COMPENSATOR_PLAUSIBLE also if
 *   dahl_compensator_prepare() rejects them
 * @note It cannot find a fade_speed in rpm or deg/s that stays below the speed of `jump`. It cannot
 *   find a period in ms that stays below 0.04, rise and fall.
 * @note A program that does not call it does not link it. It is not for a tick.
 */
dahl_compensator_plausible_t dahl_compensator_params_plausible(
    const dahl_compensator_params_t *params);

/**
 * Read the encoder: reject bad readings, fade, measure the speed, apply the play. Call it first in
 * every tick, with both laws.
 * @param plan        prepared plan
 * @param compensator state
 * @param dcounts     [counts] measured move since the last tick, any int32_t; unused with a bad
 *   reading
 * @param is_good     0 if the reading is bad or stale: CRC error, timeout, lost magnet
 * @return [counts] move for the element of the measured law; 0 if the reading is rejected, or if it
 *   only sets the start of the next move
 */
int32_t dahl_compensator_move(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator,
                              int32_t dcounts, int is_good);

/**
 * Return the compensating torque. Call it after the tick of the element.
 * @param plan        prepared plan
 * @param compensator state
 * @param ratio_q30   [Q30 of Fc] torque of the element: result of its Q30 call
 * @return [Q30 of Fc] torque to add to the command, within the limit
 * @note Error: at most #DAHL_COMPENSATOR_ERROR of ratio_q30 and 2^-30, towards 0, for the gain of
 *   the parameters and the fade_q30 and speed_q20 of the state. It is ratio_q30 with gain 1, if no
 *   fade, slew or limit is in reach. The opposite input from the opposite state gives the
 *   opposite torque within 2^-30, also in a run: the mean of the speed is symmetric.
 */
int32_t dahl_compensator_torque(const dahl_compensator_plan_t *plan,
                                dahl_compensator_t *compensator, int32_t ratio_q30);

/**
 * Change the parameters of a running compensator. Call it between two ticks, at most once, next to
 * dahl_change_plan() of the element.
 * @param from        plan of the last tick
 * @param to          plan of the next tick
 * @param compensator state: torque, wanted, ratio and speed are converted to the units of `to`, and
 *   the distance to the nearer end of the play is kept. The fade and the counters stay.
 * @note The next torque is within the limit of `to`, and it differs from the last one by at most
 *   the slew of `to`, both in N m. Fc, gain, limit, slew, fade_speed, play and period may change.
 *   If the new limit is below the torque, both cannot hold: the torque falls to the limit at once,
 *   then by the slew at most.
 * @note A state converts to 0 torque if one of the plans is all zeros. If `from` has no fade over
 *   speed, the speed begins with that of the last move, as if it took one period of `to`.
 *   Interrupts: only the context of the ticks may call it. `from` may be written again after it
 *   returns; `to` must stay until the next change (examples/change_parameters).
 */
void dahl_compensator_change(const dahl_compensator_plan_t *from, const dahl_compensator_plan_t *to,
                             dahl_compensator_t *compensator);

/**
 * @name Residual observer
 * Optional, for the reference law only: add the torque that the friction model lacks. It follows an
 * Fc that is wrong or drifts, unequal directions, viscous friction and a constant load. It also
 * draws a shaft that rests to its target. A program that does not call it does not link it.
 * @code{.c}
 *   // each tick, after dahl_compensator_torque() has returned y:
 *     int32_t r = dahl_residual_torque(&residual_plan, &residual, &compensator, dcounts);
 *     float known = Fc * DAHL_Q30 * (float)y + gravity;      // feed-forwards, except inertia and r
 *     float command = loop + known + inertia * acceleration + Fc * DAHL_Q30 * (float)r;
 *     command = clamp(command, drive_limit);                 // N m, as the drive gets it
 *     dahl_residual_note(&residual, dahl_residual_q24(&residual_plan, command - known));
 *   // with integers, note a torque in Q24 of Fc: (command_mNm - known_mNm) * (16777216 / Fc_mNm)
 * @endcode
 *
 * r = low-pass of (motor torque - known feed-forwards - inertia times acceleration). The motor
 * torque is the one that acted, so a limit of the drive winds nothing up.
 *
 * The observer is a feedback of the speed, 2 pi corner inertia in N m s/rad. It is stable if it has
 * at most half of the speed feedback of the loop. The prepare function checks one of two rules:
 * - 4 pi corner inertia <= speed_gain, also if inertia is up to twice the true one,
 * - corner <= resonance/10, if speed_gain is 0. The inertia must then be a lower bound, and the
 *   speed gain of the loop at least 2 pi resonance/6 times the inertia: with slower loops, 12 of
 *   400 were unstable.
 *
 * The rules were tested on rigid axes and on axes with a resonance of 30 to 200 Hz, with delays of 0
 * to 3 ticks. The loops were stable at 0.6 to 1.7 times the expected inertia. After the reference
 * has stopped, the end speed is at most 1.5 times that without the observer, plus 0.02 rad/s or
 * 2 counts times sqrt(sigma0/inertia). This needs three conditions:
 * - The noise is shorter than the presliding length.
 * - A count moves the torque of the loop, behind the low-pass of its speed, by less than Fc/4.
 *   Otherwise a loop without noise may rest within a count, and the observer swings over it.
 * - The loop is stiff: Fc/kp is at most 0.1 rad, kp in N m/rad.
 *
 * Rules of use:
 * - If the loop has no integral, set no_integral. The limit must then be at least gain Fc plus the
 *   load that no feed-forward cancels. Less cannot cancel the push of the reference law at rest.
 * - If it has an integral, that cancels push and load. Give half of the true Fc: with more, some
 *   loops under a load hunt at rest. The prepare function refuses more than 0.64 Fc.
 * - The torque of the compensator is y + r. Each of them keeps its limit and the slew of the
 *   compensator. So the limit of the sum is the sum of both limits, and its slew is twice the slew.
 * - r fades in and out with the compensator. A bad reading holds it. After fewer than
 *   #DAHL_COMPENSATOR_BAD_TICKS of them, the change of the speed since the last move counts. After
 *   more, r goes on without a step.
 * - Set the state to zeros if the motor was off. For new parameters, call dahl_residual_change().
 * - A count moves r by 2 (2 pi corner)^2 inertia theta_per_count. Keep that below Fc/4, or r swings
 *   between counts. A loop with its own integral needs the observer least.
 */
/** @{ */

/** [tick] A delay must be below. */
#define DAHL_RESIDUAL_TICKS 4

/** Parameters. Every float is 2^-64 <= x < 2^64, or 0 if its comment gives 0 a meaning. */
typedef struct {
    float inertia;    /**< [kg m2] lower bound of all that moves: rotor and load */
    float corner;     /**< [Hz] corner of the low-pass, at most 0.05/period; 15 suits most axes, 10
                           a PD loop with a noisy encoder */
    float limit;      /**< [N m] largest r: Fc/2, at most 0.64 Fc. With no_integral: gain Fc, and
                           above 2 Fc counts as 2 Fc. */
    float speed_gain; /**< [N m s/rad] torque per speed of the loop: D gain of PD and PID, P gain of
                           the speed loop of a cascade; 0: unknown, resonance decides */
    float resonance;  /**< [Hz] lowest resonance of the axis; unused with a speed_gain */
    uint32_t delay;   /**< [tick] from the command to its torque: 0 if it acts until the next
                           reading; below #DAHL_RESIDUAL_TICKS */
    uint32_t no_integral; /**< 1 if the loop has no integral: limit may then be above 0.64 Fc */
} dahl_residual_params_t;

/** Prepared observer; may be `const` in flash. All zeros: no torque. */
typedef struct {
    int32_t step_q32;             /**< [Q32] 2 pi corner period */
    int32_t share_q32;            /**< [Q32] share of a gap that the second low-pass closes */
    int32_t momentum_q24;         /**< [Q24 of Fc] 2 pi corner inertia times 1 count per tick */
    int32_t limit_q24;            /**< [Q24 of Fc] limit */
    uint32_t slew_q24;            /**< [Q24 of Fc] largest change in a tick */
    uint32_t delay;               /**< [tick] delay */
    uint32_t per_torque_mantissa; /**< mantissa of 1/Fc; top bit set */
    int32_t torque_shift;         /**< shift of a product with it, at exponent field 0 of a float */
    uint32_t Fc_mantissa;         /**< Fc = Fc_mantissa 2^Fc_exponent [N m]; top bit set */
    int32_t Fc_exponent;          /**< exponent of Fc_mantissa */
} dahl_residual_plan_t;

/** State of the observer. All zeros: no residual. */
typedef struct {
    /** [Q24 of Fc] noted torques, newest first */
    int32_t unexplained_q24[DAHL_RESIDUAL_TICKS];
    int64_t raw_q56;      /**< [Q56 of Fc] residual before the second low-pass */
    int64_t filtered_q56; /**< [Q56 of Fc] residual before limit, fade and slew */
    uint32_t move;        /**< [counts] last move plus 2^31; 0: the next good one only sets it */
    int32_t torque_q24;   /**< [Q24 of Fc] last result of dahl_residual_torque() */
} dahl_residual_t;

/**
 * Prepare an observer. Call it at start-up.
 * @param[out] plan     plan to write; unchanged if the call fails
 * @param      params   parameters of the compensator, accepted by dahl_compensator_prepare()
 * @param      residual parameters of the observer
 * @return #DAHL_COMPENSATOR_OK, or
 *   - #DAHL_COMPENSATOR_WRONG_LAW for the measured law;
 *   - #DAHL_COMPENSATOR_PARAM if a parameter is NaN, infinite, negative, or zero but must not be;
 *     also if speed_gain and resonance are both 0;
 *   - #DAHL_COMPENSATOR_RANGE if one is out of range; if the limit is above 0.64 Fc without
 *     no_integral; if the slew is below 2^-23 Fc in a tick; if 2 pi corner inertia is 64 Fc or more
 *     at 2 noise + 2 counts per tick;
 *   - #DAHL_COMPENSATOR_CORNER if the rule of the corner fails: lower the corner.
 * @note The first rule is rounded to the safe side by 2^-30 of it, the second one is exact.
 */
DAHL_NODISCARD dahl_compensator_err_t dahl_residual_prepare(dahl_residual_plan_t *plan,
                                                            const dahl_compensator_params_t *params,
                                                            const dahl_residual_params_t *residual);

/**
 * Return the residual torque. Call it once in a tick, after dahl_compensator_move().
 * @param plan        prepared plan
 * @param residual    state
 * @param compensator compensator of the same axis: its bad_ticks and fade are read
 * @param dcounts     [counts] the move that dahl_compensator_move() got, any int32_t
 * @return [Q30 of Fc] torque to add to the command, within the limit for any bits of the states. It
 *   differs from the last one by at most the slew of the compensator.
 */
int32_t dahl_residual_torque(const dahl_residual_plan_t *plan, dahl_residual_t *residual,
                             const dahl_compensator_t *compensator, int32_t dcounts);

/**
 * Note the torques of a tick. Call it once in a tick, at the end.
 * @param residual        state
 * @param unexplained_q24 [Q24 of Fc] motor torque as commanded, after the limit of the drive, less
 *   the feed-forwards of friction, gravity and viscous friction. Those of the inertia and of the
 *   observer stay in it. More than 64 Fc counts as 64 Fc.
 */
void dahl_residual_note(dahl_residual_t *residual, int32_t unexplained_q24);

/**
 * Convert a torque, without a float operation.
 * @param plan   prepared plan
 * @param torque [N m] any float
 * @return [Q24 of Fc] the torque, rounded towards 0; beyond +-64 Fc, any value beyond; 0 for NaN
 */
int32_t dahl_residual_q24(const dahl_residual_plan_t *plan, float torque);

/**
 * Change the parameters of a running observer. Call it next to dahl_compensator_change().
 * @param from     plan of the last tick
 * @param to       plan of the next tick
 * @param residual state: all torques are converted to the unit of `to`
 * @note The next torque is within the limit of `to`, and it differs from the last one by at most
 *   the slew of `to`, both in N m. If the new limit is below the torque, the torque falls to the
 *   limit at once. All parameters may change. The state becomes 0 if a plan is all zeros.
 */
void dahl_residual_change(const dahl_residual_plan_t *from, const dahl_residual_plan_t *to,
                          dahl_residual_t *residual);
/** @} */

#ifdef __cplusplus
}
#endif

#endif
