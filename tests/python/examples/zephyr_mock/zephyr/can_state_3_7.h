/* SPDX-License-Identifier: MIT */
/* How a program learns the state of the bus: before Zephyr 4.5. */
typedef void can_state_change_callback_t(const struct device *, enum can_state, struct can_bus_err_cnt, void *);

extern void (*can_set_state_change_callback)(const struct device *, can_state_change_callback_t *, void *);
