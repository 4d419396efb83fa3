/* SPDX-License-Identifier: MIT */
/* The control tick of the drive: encoder, commissioning, position loop with friction compensation, faults, torque. */
#ifndef DRIVE_H
#define DRIVE_H

#include <dahl_commission.h>

#include "board.h"
#include "store.h"

#define DRIVE_PERIOD_S 1e-3f
#define DRIVE_THETA_PER_COUNT (6.2831853f / 65536)
#define DRIVE_FC_LEAST 0.05f /* N m: range of a Fc from CAN */
#define DRIVE_FC_MOST 2.0f

typedef enum {
    DRIVE_OFF = 0,        /* torque 0 */
    DRIVE_COMMISSION = 1, /* the axis measures its friction */
    DRIVE_RUN = 2,        /* position loop with compensation */
    DRIVE_FAULT = 3       /* torque 0, until DRIVE_CLEAR */
} drive_state_t;

typedef enum {
    DRIVE_NO_FAULT = 0,
    DRIVE_ENCODER = 1,   /* three bad readings in a row */
    DRIVE_FOLLOWING = 2, /* the shaft is too far from its reference: blocked, or the encoder is frozen */
    DRIVE_BUS = 3,       /* no command for too long while the drive ran */
    DRIVE_REFUSED = 4,   /* the commissioning was refused */
    DRIVE_RESET = 5      /* the watchdog has reset the drive */
} drive_fault_t;

/* Orders from the main program. */
typedef enum { DRIVE_NONE, DRIVE_STOP, DRIVE_MOVE, DRIVE_START_COMMISSION, DRIVE_CLEAR } drive_order_t;

/* What a tick reports. */
typedef struct {
    uint32_t ticks;
    int32_t count;     /* of the encoder */
    int32_t ratio_q30; /* friction compensation over Fc */
    float torque;      /* N m, of the motor */
    uint32_t corrupt, jumps, invalid; /* readings of the encoder */
    uint8_t state, fault, stage;      /* drive_state_t, drive_fault_t, dahl_commission_stage_t */
    int8_t refusal;                   /* dahl_commission_refusal_t */
    bool is_good, is_primed;          /* the last reading was good; one was good */
} drive_report_t;

/* In the interrupt, each DRIVE_PERIOD_S. */
void drive_tick(void);

/* In the main program. Before drive_start() succeeded, the ticks leave the torque at 0. */
bool drive_start(const store_params_t *params, board_reset_t cause);

/* Use these parameters from the next tick on, without a step of the torque. Returns false, and changes nothing, if they are out
 * of range. Call it only if drive_is_ready(). */
bool drive_set(const store_params_t *params);

/* Give an order; target: counts, of DRIVE_MOVE. Call it only if drive_is_ready(): a tick has taken the order before. */
void drive_order(drive_order_t order, int32_t target);
bool drive_is_ready(void);

/* Report a sound main program, and that the plans have the bytes that were prepared. Without it for 50 ms, or if a plan is
 * damaged, the ticks set the torque to 0 and feed the watchdog no more. */
void drive_check(void);

void drive_read(drive_report_t *report);

/* Write Fc, sigma0, inertia, delay and noise of a commissioning that has ended. Returns false if there is no new one. */
bool drive_commissioned(store_params_t *params);

#endif
