/* SPDX-License-Identifier: MIT */
/* timing: the sampling period of the loop, which is also GenMsgCycleTime of EncoderState in dahl.dbc, and units of time. */
#ifndef TIMING_H
#define TIMING_H

#include <stdint.h>

#define PERIOD_US 1000u /* from one tick, and one EncoderState, to the next */

#define NS_PER_US UINT64_C(1000)
#define NS_PER_S UINT64_C(1000000000)
#define US_PER_MS 1000u
#define US_PER_S 1000000u

#define PERIOD_NS (PERIOD_US * NS_PER_US)
#define PERIOD_S ((double)PERIOD_US / US_PER_S)
#define TICKS_PER_SECOND ((double)US_PER_S / PERIOD_US)

#endif
