/* SPDX-License-Identifier: MIT */
/* Parameters in two pages of flash. A save writes the page that is not in use, so that a power loss keeps the older set. */
#ifndef STORE_H
#define STORE_H

#include <stdbool.h>
#include <stdint.h>

/* Parameters that stay over a power cycle, from the commissioning and from CAN */
typedef struct {
    float Fc, sigma0, gain;     /* N m, N m/rad, 0 .. 1 */
    float inertia, inertia_low; /* kg m2: best value, lower bound */
    uint32_t delay, noise;      /* ticks from a command to its torque, counts */
} store_params_t;

typedef enum {
    STORE_GOOD = 0,   /* the newest set is in use */
    STORE_EMPTY = 1,  /* nothing was ever saved */
    STORE_TORN = 2,   /* one page is damaged, as by a power loss during a save; the set of the other one is in use */
    STORE_CORRUPT = 3 /* no page is good */
} store_result_t;

/* Read the newest good set. If there is none, leave params unchanged. */
store_result_t store_load(store_params_t *params);

/* Return true if the set was saved and read back. The ticks may stop during the erase, so the motor must be off. */
bool store_save(const store_params_t *params);

/* CRC-32 of Ethernet */
uint32_t store_crc(const void *from, uint32_t bytes);

#endif
