/* SPDX-License-Identifier: MIT */
/* Zephyr 3.7, and 4.5 if MOCK_ZEPHYR_4_5 is defined, as far as examples/zephyr_node uses it. Its functions are pointers, which
 * the test sets. */
#ifndef ZEPHYR_MOCK_H
#define ZEPHYR_MOCK_H

#include <errno.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define ARG_UNUSED(x) (void)(x)
#define K_NO_WAIT 0
#define K_MSEC(ms) (ms)
#define CAN_FRAME_RTR 2u
#define CAN_MSGQ_DEFINE(name, frames) static struct k_msgq name = {frames}

typedef int k_timeout_t;
typedef long atomic_t, atomic_val_t;

struct device {
    const char *name;
};

struct k_msgq {
    int frames;
};

struct can_frame {
    uint32_t id;
    uint8_t dlc, flags;
    uint8_t data[8];
};

struct can_filter {
    uint32_t id, mask;
    uint8_t flags;
};

struct can_bus_err_cnt {
    uint8_t tx_err_cnt, rx_err_cnt;
};

enum can_state { CAN_STATE_ERROR_ACTIVE, CAN_STATE_ERROR_WARNING, CAN_STATE_ERROR_PASSIVE, CAN_STATE_BUS_OFF };

typedef void can_tx_callback_t(const struct device *, int, void *);

static inline void atomic_inc(atomic_t *value)
{
    (*value)++;
}

static inline atomic_val_t atomic_clear(atomic_t *value)
{
    atomic_val_t before = *value;
    *value = 0;
    return before;
}

extern const struct device mock_zephyr_canbus;
#define DT_CHOSEN(name) mock_##name
#define DEVICE_DT_GET(node) (&node)

int printk(const char *format, ...);
extern bool (*device_is_ready)(const struct device *);
extern int64_t (*k_uptime_ticks)(void);
extern uint64_t (*k_ticks_to_us_floor64)(uint64_t);
extern int (*k_msgq_get)(struct k_msgq *, void *, k_timeout_t);
extern int (*can_add_rx_filter_msgq)(const struct device *, struct k_msgq *, const struct can_filter *);
extern int (*can_start)(const struct device *);
extern int (*can_send)(const struct device *, const struct can_frame *, k_timeout_t, can_tx_callback_t *, void *);

#ifdef MOCK_ZEPHYR_4_5
#include "can_state_4_5.h"
#else
#include "can_state_3_7.h"
#endif

#endif
