/* SPDX-License-Identifier: MIT */
#include <zephyr/kernel.h>
#include "can_node.h"

int main(void)
{
    const struct device *can = DEVICE_DT_GET(DT_CHOSEN(zephyr_canbus));
    int code = can_node_init(can);
    if (code != 0) {
        printk("error: %s: code %d\n", can->name, code);
        return 0;
    }
    printk("friction node 0 on %s\n", can->name);
    for (;;) {
        can_node_serve();
    }
}
