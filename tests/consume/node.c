/* SPDX-License-Identifier: MIT */
/* What a firmware does with dahl::node: frames in, frames out. Here two angles, and the torque after the second, F/Fc. */
#include <dahl_node.h>
#include <stdio.h>

int main(void)
{
    static node_t node;
    const dahl_params_t params = {.sigma0 = 100.0f, .Fc = 0.5f, .theta_per_count = 6.2831853f / 16384};
    can_frame_t in, out;
    friction_torque_t torque = {0};
    if (node_init(&node, &params, 0) != DAHL_OK) {
        return 1;
    }
    for (uint8_t counter = 0; counter < 2; counter++) {
        encoder_state_t angle = {.count = 100 * counter, .counter = counter, .valid = true};
        frames_pack_encoder(&in, 0, &angle);
        if (!node_receive(&node, &in, 1000u * counter, &out) || frames_unpack_torque(&out, &torque) != FRAMES_GOOD) {
            return 2;
        }
    }
    printf("%.9g\n", torque.torque_q30 / 1073741824.0);
    return 0;
}
