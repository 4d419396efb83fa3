/* SPDX-License-Identifier: MIT */
#ifndef CURRENT_LOOP_H
#define CURRENT_LOOP_H

extern volatile float torque_command; /* N m, from a position or speed loop */
extern volatile int encoder_is_good;  /* 0: an encoder fault, such as a lost index; the compensation fades out */
extern volatile float compensation;   /* N m, added in the last tick; telemetry */

#define CURRENT_LOOP_ENCODER 1

/* Set up the encoder timer. Call it before the interrupt is enabled. Returns 0, a code of dahl_prepare() or
 * dahl_compensator_prepare(), or CURRENT_LOOP_ENCODER: leave the motor off. */
int current_loop_init(void);

void ADC_IRQHandler(void);

#endif
