/* SPDX-License-Identifier: MIT */
/* Run files of any bytes are refused with one line, or accepted and run for some ticks: node, motion and rotor as in
 * dahl-loop. tests/python/sim compares the limits of each key. */
#include "run_file.h"

#include "motion.h"
#include "dahl_node.h"
#include "plant.h"
#include "streams.h"

enum { TICKS = 40 };

/* Return 0 if the parameters are refused after their rounding to float. */
static int start_node(const run_t *r, dahl_node_t *node)
{
    const run_friction_t *f = &r->friction;
    const dahl_params_t params = {(float)f->total_sigma0, (float)f->total_Fc, (float)f->theta_per_count};
    return dahl_node_init(node, &params, (uint8_t)f->node) == DAHL_OK;
}

static void run_rotor(const run_t *r, motion_t *reference)
{
    static plant_t plant;
    static encoder_t encoder;
    int32_t count;
    if (plant_open(&plant, r, r->has_control ? reference : NULL, &encoder)) {
        for (int i = 0; i < TICKS && motion_next(&plant.motion, &count) == 1; i++) {
        }
    }
}

static void run_motion(const run_t *r, motion_t *motion)
{
    int32_t count;
    HOLDS(motion_open(motion, &r->motion, "", 1), "an accepted run can move");
    for (int i = 0; i < TICKS && motion_next(motion, &count) == 1; i++) {
    }
}

static void run(const run_t *r)
{
    static motion_t motion;
    static dahl_node_t node;
    int moves = r->has_motion && r->motion.number != MOTION_COUNTS;
    if (r->has_friction && !start_node(r, &node)) {
        return;
    }
    if (moves) {
        run_motion(r, &motion);
    }
    if (r->has_rotor && (moves || r->has_motor)) {
        run_rotor(r, &motion);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static run_t parameters;
    streams_begin(data, size);
    int good = run_file_read(&parameters, "run");
    streams_check(good);
    if (good) {
        run(&parameters);
    }
    return 0;
}
