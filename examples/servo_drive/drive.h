/* SPDX-License-Identifier: MIT */
/* The control tick of the drive: encoder, commissioning, position loop with friction compensation, faults, torque. */
#ifndef DRIVE_H
#define DRIVE_H

#include "board.h"
#include "encoder.h"
#include "store.h"

#define DRIVE_THETA_PER_COUNT (6.2831853f / 65536)

typedef enum { DRIVE_OFF = 0, DRIVE_COMMISSION = 1, DRIVE_RUN = 2, DRIVE_FAULT = 3 } drive_state_t;

typedef enum {
    DRIVE_NO_FAULT = 0,
    DRIVE_ENCODER = 1,   /* three bad readings in a row */
    DRIVE_FOLLOWING = 2, /* the shaft is too far from its reference: blocked, or the encoder is frozen */
    DRIVE_BUS = 3,       /* no ORDER_MOVE for 200 ms while the drive ran */
    DRIVE_REFUSED = 4,   /* the commissioning was refused */
    DRIVE_RESET = 5      /* the watchdog has reset the drive */
} drive_fault_t;

/* Values of Command in servo_drive.dbc. The tick drops an order that its state does not allow. */
typedef enum { ORDER_STOP = 0, ORDER_MOVE = 1, ORDER_COMMISSION = 2, ORDER_SAVE = 3, ORDER_CLEAR = 4, ORDER_NONE } order_t;

/* Report of a tick */
typedef struct {
    encoder_t encoder;
    uint32_t ticks;
    int32_t ratio_q30;           /* friction compensation over Fc */
    float torque;                /* N m, of the motor */
    uint8_t state, fault, stage; /* drive_state_t, drive_fault_t, dahl_commission_stage_t */
    int8_t refusal;              /* dahl_commission_refusal_t */
} drive_report_t;

/* In the interrupt, each millisecond */
void drive_tick(void);

/* In the main program. drive_set() returns false and changes nothing if the parameters are out of range. New ones act from the
 * next tick on, without a step of the torque. */
void drive_start(board_reset_t cause);
bool drive_set(const store_params_t *params);
void drive_order(order_t order, int32_t target); /* target: counts, of ORDER_MOVE */
bool drive_is_ready(void); /* a tick has taken the last order and parameters; otherwise call neither of the two above */
void drive_read(drive_report_t *report);
bool drive_take_result(store_params_t *params); /* false: no new result of a commissioning */

/* Report that the main program is sound, if the plans are, too. Without a report for 50 ms, the ticks set the torque to 0 and
 * feed the watchdog no more. */
void drive_check(void);

#endif
