/* SPDX-License-Identifier: MIT */
#include "can_node.h"

void app_main(void);

void app_main(void)
{
    int code = can_node_init();
    while (code == 0) {
        can_node_serve();
    }
}
