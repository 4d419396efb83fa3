/* SPDX-License-Identifier: MIT */
/* The friction node on the CAN API of Zephyr 3.7 to 4.5. It was not built with Zephyr or run on hardware. The driver queues
 * frames and one thread serves them, so that no mask is needed. The driver recovers from bus-off by itself. */
#include <string.h>
#include <dahl_node.h>
#include <zephyr/drivers/can.h>
#include <zephyr/kernel.h>
#include <zephyr/version.h>
#include "can_node.h"

#define ID (DAHL_FRAMES_ID_ENCODER | 0u) /* of node 0 */
#define ID_MASK 0x70Fu                   /* passes 0x100, 0x110 .. 0x170; the node ignores those it does not use */
static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_node_t node;
static const struct device *device;
static atomic_t bus_offs;    /* that the node has not handled */
static volatile bool is_off; /* the bus */
volatile uint32_t can_dropped;

CAN_MSGQ_DEFINE(received, 8);

static void set_state(enum can_state state)
{
    is_off = state == CAN_STATE_BUS_OFF;
    if (is_off) {
        atomic_inc(&bus_offs);
    }
}

#if ZEPHYR_VERSION_CODE >= ZEPHYR_VERSION(4, 5, 0)
static void on_state(const struct device *can, struct can_state_change_callback *callback, enum can_state state,
                     struct can_bus_err_cnt errors)
{
    ARG_UNUSED(can);
    ARG_UNUSED(callback);
    ARG_UNUSED(errors);
    set_state(state);
}

static int watch_state(const struct device *can)
{
    static struct can_state_change_callback callback;
    can_init_state_change_callback(&callback, on_state);
    return can_add_state_change_callback(can, &callback);
}
#else
static void on_state(const struct device *can, enum can_state state, struct can_bus_err_cnt errors, void *user_data)
{
    ARG_UNUSED(can);
    ARG_UNUSED(errors);
    ARG_UNUSED(user_data);
    set_state(state);
}

static int watch_state(const struct device *can)
{
    can_set_state_change_callback(can, on_state, NULL);
    return 0;
}
#endif

int can_node_init(const struct device *can)
{
    const struct can_filter filter = {.id = ID, .mask = ID_MASK};
    device = can;
    int code = device_is_ready(can) ? dahl_node_init(&node, &params, ID & 15) : -ENODEV;
    if (code == DAHL_OK) {
        code = watch_state(can);
    }
    if (code == 0) {
        int filter_id = can_add_rx_filter_msgq(can, &received, &filter);
        code = filter_id < 0 ? filter_id : can_start(can);
    }
    return code;
}

static uint32_t clock_us(void)
{
    return (uint32_t)k_ticks_to_us_floor64((uint64_t)k_uptime_ticks());
}

/* Without a callback, can_send() would wait until the frame is on the bus: forever, if no other node acknowledges it. */
static void on_sent(const struct device *can, int error, void *user_data)
{
    ARG_UNUSED(can);
    ARG_UNUSED(error);
    ARG_UNUSED(user_data);
}

static void send(const dahl_can_frame_t *out)
{
    struct can_frame frame = {.id = out->id, .dlc = out->length};
    memcpy(frame.data, out->data, 8);
    can_dropped += can_send(device, &frame, K_NO_WAIT, on_sent, NULL) != 0;
}

static void receive(const struct can_frame *frame)
{
    dahl_can_frame_t out, in = {.id = frame->id, .length = (uint8_t)(frame->dlc < 8 ? frame->dlc : 8)};
    in.flags = (frame->flags & CAN_FRAME_RTR) != 0 ? DAHL_CAN_FRAME_REMOTE : 0;
    memcpy(in.data, frame->data, 8);
    if (dahl_node_receive(&node, &in, clock_us(), &out)) {
        send(&out);
    }
}

void can_node_serve(void)
{
    struct can_frame frame;
    dahl_can_frame_t out;
    if (k_msgq_get(&received, &frame, K_MSEC(1)) == 0) {
        receive(&frame);
    }
    for (atomic_val_t count = atomic_clear(&bus_offs); count > 0; count--) {
        dahl_node_bus_off(&node, clock_us());
    }
    if (!is_off && dahl_node_tick(&node, clock_us(), &out)) {
        send(&out);
    }
}
