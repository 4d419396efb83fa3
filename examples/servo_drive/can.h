/* SPDX-License-Identifier: MIT */
/*
 * The drive on CAN. It sends and accepts these frames, with the ids of node 0:
 *   EncoderState, FrictionTorque   sent each 10 ms    dahl.dbc: count; compensation over Fc
 *   Status                         sent each 100 ms   dahl.dbc: errors and counts of the encoder on SPI
 *   DriveStatus                    sent each 100 ms, and on a change of state   servo_drive.dbc
 *   ParamWrite                     accepted           dahl.dbc: Fc and Gain; Sigma0 and ThetaPerCount can be read
 *   ParamReply                     sent               dahl.dbc
 *   DriveCommand                   accepted           servo_drive.dbc: stop, move, commission, save, clear
 * A frame with a wrong CRC or form is dropped; Status reports ErrorFormat.
 */
#ifndef CAN_H
#define CAN_H

#include "store.h"

void can_start(const store_params_t *params, store_result_t stored);

/* Serve the bus: call it after each board_wait(). */
void can_serve(void);

#endif
