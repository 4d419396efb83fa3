/* SPDX-License-Identifier: MIT */
/* How a program learns the state of the bus: since Zephyr 4.5, which deprecates the call of 3.7. */
struct can_state_change_callback;
typedef void (*can_state_change_callback_handler_t)(const struct device *, struct can_state_change_callback *, enum can_state,
                                                    struct can_bus_err_cnt);
struct can_state_change_callback {
    can_state_change_callback_handler_t handler;
};

extern void (*can_init_state_change_callback)(struct can_state_change_callback *, can_state_change_callback_handler_t);
extern int (*can_add_state_change_callback)(const struct device *, struct can_state_change_callback *);
