/* SPDX-License-Identifier: MIT */
/**
 * @file dahl_commission.h
 * @brief Measure the friction of an axis with its own motor and encoder, without a torque sensor.
 *
 * Use it once, before the compensator is switched on. It moves the axis for about 24 s and returns
 * the parameters of dahl_compensator.h, each with an interval. It needs an encoder, a torque (or
 * current) command, and a position loop. It stores no log.
 *
 * All torques are in the unit of the command. If the torque constant is wrong, each torque, inertia
 * and stiffness is wrong by the same factor, and the compensator still fits the axis.
 *
 * @par Use
 * @code{.c}
 *   static dahl_commission_t axis;   static dahl_commission_command_t command;
 *   static const dahl_commission_config_t config = {
 *       .period = 1e-3f, .theta_per_count = 3.835e-4f, .inertia = 0.002f,   // s, rad, kg m2
 *       .travel = 0.35f, .angle_limit = 0.7f, .speed_limit = 10.0f,         // rad, rad, rad/s
 *       .torque_limit = 5.0f};                                              // N m
 *   // start:
 *     if (dahl_commission_start(&axis, &config) != DAHL_COMMISSION_OK) { stop(); }
 *   // each tick, after the encoder is read, until the stage is DONE or REFUSED:
 *     dahl_commission_tick(&axis, dcounts, last_torque, &command);
 *     if (command.mode == DAHL_COMMISSION_TRACK) {
 *         torque = position_loop(command.angle, command.speed, command.acceleration);
 *     } else { torque = command.torque; }
 *     last_torque = limit(torque, command.torque_limit);
 *   // DONE:
 *     dahl_compensator_params_t params;
 *     dahl_commission_params(&axis, &params, 0);   // then dahl_compensator_prepare()
 * @endcode
 *
 * @par Stages
 * 1. Rest: torque 0; the noise of the encoder.
 * 2. Sweeps: to and fro at three speeds; friction, load and viscous friction by angle.
 * 3. Cycle: a torque below the friction, without the loop; the presliding stiffness.
 * 4. Breakaway: a torque ramp in both directions.
 * 5. Inertia: strokes with three sines on them; inertia, delay, and a bound of the rotor alone. If
 *    that bound is too low for the compensator, the strokes are repeated with faster sines, up to
 *    76 or 88 Hz (3 to 7 s more). A period above 1.25 ms is too long for 76 Hz, and above 1.08 ms
 *    for 88 Hz.
 * 6. Kick: compensation on, short pushes. A swing lengthens length_long; a creep lowers the gain.
 *
 * If the position loop is too soft for the friction, each stroke starts with a torque ramp in the
 * mode TORQUE. If it shakes the axis (SPEED, VARIES), tune it to half the bandwidth and try again.
 *
 * @par Safety
 * - Clear the travel and angle_limit on both sides. Keep hands away: a hand counts as friction.
 * - The angle, the speed and the torque are checked in each tick. Beyond a limit the mode becomes
 *   #DAHL_COMMISSION_OFF. The axis then coasts until friction stops it, so leave a margin.
 * - The torque of the modes OFF and TORQUE is within the limit. In the mode TRACK the drive must
 *   limit the torque of its loop.
 * - A frozen encoder is found by its missing counts, not at once. Until then, an axis can coast
 *   beyond angle_limit.
 * - After a refusal, and at the end, the torque is 0. An axis whose load exceeds its friction falls
 *   then: use a brake.
 *
 * @par Validity
 * The axis must rub like Dahl, LuGre or slip elements with a breakaway of at most 1.6 Fc. The
 * numbers hold within the travel and up to #DAHL_COMMISSION_SPEED_MAX, at today's temperature.
 * Half the sum of both directions is the load. Friction that differs between the directions by up
 * to 15 % looks like a load; Fc.least and length.most allow for it.
 *
 * @par Properties
 * Floats, no heap, no global variable, no libm. Long evaluations take one tick for each step. The
 * longest ticks evaluate a sine or prepare the compensator: docs/microcontroller.md has the cost.
 * Because of the floats, results may differ between cores in their last bits.
 */
#ifndef DAHL_COMMISSION_H
#define DAHL_COMMISSION_H

#include "dahl_compensator.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Bins of angle over the travel. */
#define DAHL_COMMISSION_BINS 14
/** Speeds of the sweeps. */
#define DAHL_COMMISSION_SPEEDS 3
/** Sines of the stage INERTIA. */
#define DAHL_COMMISSION_SINES 3
/** [rad/s] Fastest sweep. */
#define DAHL_COMMISSION_SPEED_MAX 2.5f

/** Mode of the drive in a tick. */
typedef enum {
    DAHL_COMMISSION_OFF = 0,   /**< torque 0 */
    DAHL_COMMISSION_TRACK = 1, /**< position loop on angle, speed and acceleration. Load its
                                    integrator with the last torque when this mode starts. */
    DAHL_COMMISSION_TORQUE = 2 /**< no loop: the command is `torque` */
} dahl_commission_mode_t;

/** Stage. */
typedef enum {
    DAHL_COMMISSION_REST = 0,      /**< noise of the encoder */
    DAHL_COMMISSION_SWEEPS = 1,    /**< friction and load by angle */
    DAHL_COMMISSION_CYCLE = 2,     /**< presliding stiffness */
    DAHL_COMMISSION_BREAKAWAY = 3, /**< breakaway torque */
    DAHL_COMMISSION_INERTIA = 4,   /**< inertia and delay */
    DAHL_COMMISSION_KICK = 5,      /**< gain and length_long */
    DAHL_COMMISSION_DONE = 6,      /**< the result is valid */
    DAHL_COMMISSION_REFUSED = 7,   /**< `refusal` says why */
} dahl_commission_stage_t;

/** Reason of a refusal. Except 0, the codes differ from those of the other headers. */
typedef enum {
    DAHL_COMMISSION_OK = 0,            /**< not refused */
    DAHL_COMMISSION_PARAM = -41,       /**< a value of the configuration is out of range */
    DAHL_COMMISSION_ABORTED = -42,     /**< dahl_commission_abort() */
    DAHL_COMMISSION_ANGLE = -43,       /**< the angle left angle_limit: is the load held? */
    DAHL_COMMISSION_SPEED = -44,       /**< the speed exceeded speed_limit: tune the loop softer */
    DAHL_COMMISSION_UNLIMITED = -45,   /**< the drive reports a torque above torque_limit, or NaN */
    DAHL_COMMISSION_SATURATED = -46,   /**< the torque stayed at its limit: a larger motor? */
    DAHL_COMMISSION_TRACKING = -47,    /**< the loop does not follow: an end stop, or tuning */
    DAHL_COMMISSION_ENCODER = -48,     /**< no counts while the torque or the reference moves */
    DAHL_COMMISSION_SIGN = -49,        /**< the axis moves against the command: swap the sign */
    DAHL_COMMISSION_DISTURBED = -50,   /**< the axis moved when it had to rest: a hand? */
    DAHL_COMMISSION_TIMEOUT = -51,     /**< a stage took too long */
    DAHL_COMMISSION_NO_DATA = -52,     /**< too few samples in the bins of angle */
    DAHL_COMMISSION_VARIES = -53,      /**< the loop shakes the axis, or friction differs between
                                            two passes: check config.inertia, tune it softer */
    DAHL_COMMISSION_BAD_INERTIA = -54, /**< the fit of the inertia fails: correct config.inertia */
    DAHL_COMMISSION_COARSE = -55,      /**< presliding of less than 2 counts, or none */
    DAHL_COMMISSION_LIGHT = -56,       /**< the rotor is too light for period and delay */
    DAHL_COMMISSION_SWINGS = -57       /**< no gain comes to rest: a flexible axis? */
} dahl_commission_refusal_t;

/** Configuration. */
typedef struct {
    float period;          /**< [s] of a tick: 5e-5 .. 2e-3 */
    float theta_per_count; /**< [rad] > 0 */
    float inertia;         /**< [kg m2] of the axis, within a factor of 1.5 */
    float travel;          /**< [rad] 0.2 .. 3: it moves +-travel about the first angle */
    float angle_limit;     /**< [rad] largest angle from the first: at least 1.5 travel, at most
                                2e9 counts */
    float speed_limit;     /**< [rad/s] largest speed: at least 5 */
    float torque_limit;    /**< [N m] largest torque: 4 times the friction is enough */
} dahl_commission_config_t;

/** Command of one tick. */
typedef struct {
    float angle;        /**< [rad] from the first angle: TRACK */
    float speed;        /**< [rad/s] speed of the reference: TRACK */
    float acceleration; /**< [rad/s2] acceleration of the reference: TRACK */
    float torque;       /**< [N m]: TORQUE, 0 in OFF */
    float torque_limit; /**< [N m] limit of the whole torque of this tick */
    uint8_t mode;       /**< dahl_commission_mode_t */
    uint8_t stage;      /**< dahl_commission_stage_t */
    int8_t refusal;     /**< dahl_commission_refusal_t */
} dahl_commission_command_t;

/** Estimate with its interval. */
typedef struct {
    float least; /**< lower end */
    float best;  /**< estimate */
    float most;  /**< upper end */
} dahl_commission_range_t;

/** Result; valid if the stage is DONE. */
typedef struct {
    dahl_commission_range_t Fc;      /**< [N m] Coulomb friction; least: Fc_low over angle, speed
                                          and direction; most: with breakaway and direction */
    dahl_commission_range_t length;  /**< [rad] presliding length; most: length_long */
    dahl_commission_range_t sigma0;  /**< [N m/rad] stiffness at rest; most: sigma0_high */
    dahl_commission_range_t inertia; /**< [kg m2] of rotor and load. least: the rotor alone, if a
                                          shaft that the sines allow rings below 200 Hz (elastic),
                                          160 Hz (not elastic), or 130 Hz (not elastic at the
                                          faster sines) */
    dahl_commission_range_t delay;   /**< [s] from the reading to the torque */
    dahl_commission_range_t viscous; /**< [N m s/rad] slope of the friction over the speed */
    float load[DAHL_COMMISSION_BINS]; /**< [N m] torque that holds the axis, at the middles of the
                                           bins; dahl_commission_load() interpolates */
    float load_error;                /**< [N m] interval of each load: +-load_error */
    float load_most;                 /**< [N m] largest |load| and load_error */
    float breakaway;                 /**< [1] breakaway torque over Fc, as measured */
    float gain;                      /**< [1] largest gain that came to rest after all kicks */
    float seconds;                   /**< [s] duration */
    uint16_t noise;                  /**< [count] noise of the encoder at rest */
    uint16_t play;                   /**< [count] play of the compensator that covers the noise */
    uint8_t elastic;                 /**< 1: the inertia differs between the sines, or the kicks had
                                          to lengthen length_long. A stiff shaft may not be seen. */
} dahl_commission_result_t;

/** State of one axis: at most 1 kB. Read `result`; the other fields are private. */
typedef struct {
    dahl_commission_config_t config;   /**< copy of the configuration */
    dahl_commission_command_t command; /**< last command */
    dahl_commission_result_t result;   /**< result; valid if the stage is DONE */
    int32_t counts;                    /**< [count] since the start */
    float theta;                       /**< [rad] angle from the first */
    float count_speed;                 /**< [rad/s] speed of one count in a tick */
    float speed_share;                 /**< share by which a tick moves `speed` */
    float speed;                       /**< [rad/s] speed after a low-pass */
    float torque;                      /**< [N m] torque of the last tick */
    uint32_t ticks;                    /**< [tick] since the start */
    uint32_t stage_ticks;              /**< [tick] since the start of the stage */
    uint32_t step_ticks;               /**< [tick] since the start of the step */
    uint8_t step;                      /**< step of the stage */
    uint8_t pass;                      /**< ramps of the stage BREAKAWAY that have ended */
    uint8_t tries;                     /**< cycles that broke away */
    uint8_t is_held;                   /**< 1: the load moves the axis at rest, the loop holds it */
    uint8_t is_soft;                   /**< 1: the loop is too soft for the friction */
    uint8_t has_soft_shaft;            /**< 1: only faster sines showed the rotor */
    uint8_t is_fast;                   /**< 1: faster sweeps, because the loop shook the axis */
    struct {
        float start;             /* [rad] angle at the start of a push */
        float end;               /* [rad] last angle */
        float want_speed;        /* [rad/s] wanted speed */
        float want_acceleration; /* [rad/s2] wanted acceleration */
        float speed;             /* [rad/s] speed for whole ticks */
        float acceleration;      /* [rad/s2] acceleration for whole ticks */
        uint32_t ramp_ticks;     /* [tick] of the acceleration, and of the braking */
        uint32_t cruise_ticks;   /* [tick] at constant speed */
        uint32_t tick;           /* [tick] since the start of the stroke */
        uint8_t is_push;         /* 1: a torque pushes the axis, without the loop */
    } stroke; /**< accelerate, cruise, brake; with a soft loop push before */
    struct {
        float angle;              /* [rad] reference at the last count */
        float torque;             /* [N m] torque at the last count */
        uint32_t frozen_ticks;    /* [tick] without a count */
        uint32_t saturated_ticks; /* [tick] with the torque at its limit */
        uint32_t count_ticks;     /* [tick] friction needs up to this for some counts */
    } watch; /**< watch on the encoder and the torque */
    struct {
        float friction[DAHL_COMMISSION_BINS]; /* [N m] friction by angle, at the slowest speed */
        float level[DAHL_COMMISSION_SPEEDS];  /* [N m] friction by speed */
        float noise[DAHL_COMMISSION_SPEEDS];  /* [N m] error of each level */
        float least;                          /* [N m] least friction of a bin */
        float most;                           /* [N m] largest friction of a bin */
        float scatter;                        /* [N m] scatter of the bins between two passes */
    } table;               /**< friction by angle and by speed */
    float cycle_torque;    /**< [N m] amplitude of the torque of the cycle */
    float cycle_travel;    /**< [rad] travel of the cycle, from end to end */
    float break_torque[2]; /**< [N m] breakaway torque of both directions */
    float middle_Fc;       /**< [N m] friction in the middle of the travel */
    /** @cond */
    union {
        struct {
            float mean;           /* [count] slow mean of the counts */
            float low;            /* [count] least of the window, from the mean */
            float high;           /* [count] largest of the window, from the mean */
            int32_t last[2];      /* [count] counts of the last two ticks */
            uint16_t flicker[64]; /* windows by their range in counts */
            uint16_t jerk[64];    /* ticks by the second difference of the counts */
        } rest; /* REST */
        struct {
            float sum[4][DAHL_COMMISSION_BINS];        /* [N m] torque by stroke and bin */
            uint16_t samples[4][DAHL_COMMISSION_BINS]; /* samples by stroke and bin */
            float friction;  /* [N m] friction: sum over the bins of this speed */
            float reference; /* [N m] friction of the slowest speed: sum over the same bins */
            float change;    /* [N m] second pass minus first: sum over the bins */
            float square;    /* [N2 m2] square of the change: sum over the bins */
            float slope;     /* [N m s/rad] slope of the friction over the speed */
            float intercept; /* [N m] friction of this line at speed 0 */
            uint16_t backward_ticks; /* ticks of this stroke in which the axis moved backward */
            uint8_t speed;   /* index of the speed */
            uint8_t stroke;  /* stroke of this speed */
            uint8_t bins;    /* bins in the sums */
            uint8_t bin;     /* next bin to evaluate, then next step */
        } sweeps; /* SWEEPS */
        struct {
            float sum[16];        /* [rad] angle from `start` by phase */
            float start;          /* [rad] angle at the start */
            float rotor[2];       /* cosine and sine of the phase */
            float turn[2];        /* turn of the phase in a tick */
            float low;            /* [rad] least mean of a phase */
            float high;           /* [rad] largest mean of a phase */
            uint16_t samples[16]; /* samples by phase */
        } cycle; /* CYCLE */
        struct {
            float start;       /* [rad] angle at the start of the ramp */
            float peak;        /* [N m] largest torque of the ramp */
            float change;      /* [N m] largest correction of a bin near an end */
            uint8_t evaluated; /* steps of the evaluation that have ended */
        } breakaway; /* BREAKAWAY */
        struct {
            dahl_commission_command_t base;          /* motion without the sines */
            uint32_t phase[DAHL_COMMISSION_SINES];   /* phase of each sine; a turn is 2^32 */
            uint32_t turn[DAHL_COMMISSION_SINES];    /* turn of each sine in a tick */
            float frequency[DAHL_COMMISSION_SINES];  /* [rad/s] frequency of each sine */
            float slowest;                           /* [rad/s] one turn in a window */
            /* [N m] demodulated torque, by half of the strokes, sine and part */
            float torque[2][DAHL_COMMISSION_SINES][2];
            /* [rad/s] demodulated speed, likewise */
            float speed[2][DAHL_COMMISSION_SINES][2];
            uint32_t window;                         /* phase of the Hann window */
            uint32_t window_ticks;                   /* [tick] of the window */
            uint32_t settle_ticks;                   /* [tick] before it */
            float block_torque;                      /* [N m] sum over a block of ticks */
            float fall_torque;                       /* [N m] with weights that fall to 1 */
            float rise_torque;                       /* [N m] block before, rising weights */
            float block_load;                        /* [N m] load in the block */
            int32_t block_counts;                    /* [count] the same sums of the counts */
            int32_t fall_counts;                     /* [count] */
            int32_t rise_counts;                     /* [count] */
            uint32_t direction_ticks;                /* [tick] that show a direction */
            uint32_t moved_ticks;                    /* [tick] of these */
            uint32_t reversed_ticks;                 /* [tick] of the windows, backward */
            int32_t moved_counts;                    /* [count] move along the stroke */
            float last_torque;                       /* [N m] last block under the window */
            float last_speed;                        /* [rad/s] likewise */
            float mean_speed;                        /* [rad/s] speed of the strokes */
            float share;                             /* of the sines: the axis never reverses */
            float inertia[DAHL_COMMISSION_SINES];    /* [kg m2] inertia at each sine */
            float difference[DAHL_COMMISSION_SINES]; /* [kg m2] of the halves of the strokes */
            float error[DAHL_COMMISSION_SINES];      /* [kg m2] error of each inertia */
            float slope_error; /* [kg m2] error of the last inertia less the first one */
            float lag[DAHL_COMMISSION_SINES];        /* [rad] phase of torque over speed */
            float stiff[DAHL_COMMISSION_SINES];      /* effect of a load on this shaft */
            float shaft;       /* [rad2/s2] square of the resonance that is tried; 0: none yet */
            float stiffest;    /* [rad2/s2] largest of these */
            float misfit;      /* [kg m2] misfit of this shaft */
            float gap;         /* [kg m2] misfit of the best shaft */
            uint8_t block_ticks; /* ticks in the block */
            uint8_t sine;      /* sine of the last block that is demodulated next */
            uint8_t stroke;    /* strokes that have started */
            uint8_t set;       /* set of frequencies */
            uint8_t evaluated; /* steps of the evaluation that have ended */
            uint8_t is_shaft;  /* 1: the shaft explains the sines */
            uint8_t is_repeated; /* 1: faster sines follow, because the bound is too low */
        } inertia; /* INERTIA */
        struct {
            dahl_compensator_params_t params; /* parameters with the gain that is tried */
            dahl_plan_t friction;             /* plan of the element */
            dahl_state_t bristle;             /* state of the element */
            dahl_compensator_plan_t plan;     /* plan of the compensator */
            dahl_compensator_t compensator;   /* state of the compensator */
            float start;     /* [rad] angle at the start of a push */
            float push;      /* [N m] torque of the push */
            float speed;     /* [rad/s] speed that ends the push */
            float low;       /* [rad] least angle of the window */
            float high;      /* [rad] largest angle of the window */
            float first;     /* [rad] first angle of the window */
            float noise;     /* [rad] range of the noise */
            float ring;      /* [rad/s] frequency of the axis on its bristles */
            float ranges[2]; /* [rad] ranges of the last two windows, newest first */
            uint8_t kick;    /* index of the push */
            uint8_t gain;    /* index of the gain */
            uint8_t fails;   /* times that the axis swung */
            uint8_t creeps;  /* times that the axis crept */
            uint8_t phase;   /* prepare, fade in, push or settle */
            uint8_t windows; /* windows since the push */
        } kick; /* KICK */
    } work; /* of the present stage */
    /** @endcond */
} dahl_commission_t;

/**
 * Start. The axis must be at rest in the middle of its travel.
 * @param[out] axis   state; all fields are written
 * @param      config configuration; both pointers must be valid
 * @return #DAHL_COMMISSION_OK, or #DAHL_COMMISSION_PARAM. The stage is then REFUSED.
 */
DAHL_NODISCARD dahl_commission_refusal_t dahl_commission_start(
    dahl_commission_t *axis, const dahl_commission_config_t *config);

/**
 * One tick. Call it after the encoder is read and before the position loop.
 * @param      axis    state
 * @param      dcounts [count] move since the last tick; 0 in the first tick
 * @param      torque  [N m] torque of the last tick, after all limits; 0 in the first tick
 * @param[out] command command of this tick
 * @return stage. After DONE or REFUSED a call changes nothing, and the mode is OFF.
 */
dahl_commission_stage_t dahl_commission_tick(dahl_commission_t *axis, int32_t dcounts, float torque,
                                             dahl_commission_command_t *command);

/** Stop at once: the next command is OFF, the stage REFUSED with #DAHL_COMMISSION_ABORTED. A
 * finished axis keeps its result. */
void dahl_commission_abort(dahl_commission_t *axis);

/**
 * Return the torque that holds the axis.
 * @param axis  state, after the sweeps
 * @param angle [rad] from the first angle; outside the travel, the load at its end is returned
 * @return [N m] +- load_error
 */
float dahl_commission_load(const dahl_commission_t *axis, float angle);

/**
 * Write the parameters of the compensator: measured law, bounds of the result, gain of the kicks.
 * @param      axis     state, stage DONE
 * @param[out] params   parameters for dahl_compensator_prepare(); element: Fc.least with the slope
 *   Fc.least/length.most, or a quarter of it if elastic
 * @param      has_load 0: the firmware adds dahl_commission_load() to the command; 1: it does not,
 *   so the gain is lowered until the load cannot drive the axis
 * @return 0, or the code by which dahl_compensator_prepare() rejects them
 */
DAHL_NODISCARD dahl_compensator_err_t dahl_commission_params(const dahl_commission_t *axis,
                                                             dahl_compensator_params_t *params,
                                                             int has_load);

#ifdef __cplusplus
}
#endif

#endif
