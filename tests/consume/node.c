/* SPDX-License-Identifier: MIT */
/* A firmware with dahl::node: pass two angles, print F/Fc of the second answer. */
#include <dahl_node.h>
#include <stdio.h>

int main(void)
{
    static dahl_node_t node;
    const dahl_params_t params = {.sigma0 = 100.0f, .Fc = 0.5f, .theta_per_count = 6.2831853f / 16384};
    dahl_can_frame_t in, out;
    dahl_friction_torque_t torque = {0};
    if (dahl_node_init(&node, &params, 0) != DAHL_OK) {
        return 1;
    }
    for (uint8_t counter = 0; counter < 2; counter++) {
        dahl_encoder_state_t angle = {.count = 100 * counter, .counter = counter, .valid = true};
        dahl_frames_pack_encoder(&in, 0, &angle);
        if (!dahl_node_receive(&node, &in, 1000u * counter, &out) || dahl_frames_unpack_torque(&out, &torque) != DAHL_FRAMES_GOOD) {
            return 2;
        }
    }
    printf("%.9g\n", torque.torque_q30 / 1073741824.0);
    return 0;
}
