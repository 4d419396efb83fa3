/* SPDX-License-Identifier: MIT */
/* A node that receives any frames in an endless loop, for the Eva plug-in of Frama-C: frames of any format and content,
 * parameters written and read, any clock. Contracts, which cbmc_core.c proves, replace the calls of the library. */
#include <stdint.h>
#include "__fc_builtin.h"
#include "dahl.h"

#define IN_RANGE(x) (0x1p-64 <= (x) <= 0x1p64)

/*@ assigns \result, *plan \from *params;
    ensures \result == DAHL_OK || \result == DAHL_ERR_PARAM || \result == DAHL_ERR_RANGE;
    ensures \result != DAHL_OK || (\is_finite(params->sigma0) && \is_finite(params->Fc) && \is_finite(params->theta_per_count));
    ensures \result != DAHL_OK || (IN_RANGE(params->sigma0) && IN_RANGE(params->Fc) && 0 <= params->theta_per_count <= 0x1p64); */
dahl_err_t dahl_prepare(dahl_plan_t *plan, const dahl_params_t *params);

/*@ assigns *state \from *state, *from, *to; */
void dahl_change_plan(const dahl_plan_t *from, const dahl_plan_t *to, dahl_state_t *state);

/*@ assigns \result, *state \from *state, *plan, dcounts;
    ensures -(1 << 30) <= \result <= 1 << 30; */
int32_t dahl_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/*@ assigns \result \from before, now, counts_per_turn; */
int32_t dahl_counts_between(uint32_t before, uint32_t now, uint32_t counts_per_turn);

#include "node_library.c" /* receiver and frames, written by test_frama_c.py */

volatile uint32_t word;
volatile uint8_t byte;
volatile int choice;

/* Any frame whose byte 2 is low to high. Eva does not know the CRC, so it follows the paths of right and wrong ones. */
static dahl_can_frame_t any_frame(int low, int high)
{
    dahl_can_frame_t frame = {.id = word, .flags = byte, .length = byte};
    for (int i = 0; i < 8; i++) {
        frame.data[i] = byte;
    }
    frame.data[2] = (uint8_t)Frama_C_interval(low, high);
    return frame;
}

static void receive(dahl_node_t *node, int low, int high)
{
    dahl_can_frame_t in = any_frame(low, high), out;
    (void)dahl_node_receive(node, &in, word, &out);
}

/* Byte 2 is the number of a parameter. One case each keeps their limits apart in Eva. */
static void receive_any(dahl_node_t *node)
{
    switch (choice) {
    case 0: receive(node, 0, 2); break;
    case 3: receive(node, 3, 3); break;
    case 4: receive(node, 4, 4); break;
    case 5: receive(node, 5, 5); break;
    case 6: receive(node, 6, 6); break;
    case 7: receive(node, 7, 7); break;
    case 8: receive(node, 8, 8); break;
    default: receive(node, 9, 255); break;
    }
}

static void other_frames(void)
{
    dahl_can_frame_t frame = any_frame(0, 255);
    dahl_friction_torque_t torque;
    dahl_node_status_t status;
    dahl_param_reply_t reply;
    (void)dahl_frames_unpack_torque(&frame, &torque);
    (void)dahl_frames_unpack_status(&frame, &status);
    (void)dahl_frames_unpack_param_reply(&frame, &reply);
}

static void send_any(void)
{
    dahl_can_frame_t frame;
    dahl_encoder_state_t encoder = {(int32_t)word, byte, choice != 0};
    dahl_param_write_t param = {word, byte, byte, choice != 0};
    dahl_node_reset_t reset = {byte, byte};
    dahl_frames_pack_encoder(&frame, byte, &encoder);
    dahl_frames_pack_param_write(&frame, byte, &param);
    dahl_frames_pack_reset(&frame, byte, &reset);
}

int main(void)
{
    dahl_node_t node;
    dahl_params_t params = {1.0f, 1.0f, 1.0f};
    dahl_can_frame_t out;
    if (dahl_node_init(&node, &params, byte) != DAHL_OK) {
        return 0;
    }
    while (choice) {
        receive_any(&node);
        (void)dahl_node_tick(&node, word, &out);
        other_frames();
        send_any();
    }
    return 0;
}
