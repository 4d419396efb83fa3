/* SPDX-License-Identifier: MIT */
/* Run files of any bytes are refused with one line, or accepted and run for some ticks: node, motion and rotor as in
 * dahl-loop. tests/python/sim compares the limits of each key. */
#include "run_file.h"

#include "models.h"
#include "motion.h"
#include "dahl_node.h"
#include "plant.h"
#include "streams.h"

enum { TICKS = 40 };

static void run_rotor(const run_t *r, motion_t *reference, float Fc)
{
    static plant_t plant;
    static encoder_t encoder;
    int32_t count;
    if (plant_open(&plant, r, r->has_control ? reference : NULL, &encoder, Fc)) {
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
    static model_memory_t memory;
    int moves = r->has_motion && r->motion.number != MOTION_COUNTS;
    if (r->has_friction && models_start(&node, &memory, &r->friction, (uint8_t)r->friction.node, "run") != 0) {
        return;
    }
    if (moves) {
        run_motion(r, &motion);
    }
    if (r->has_rotor && (moves || r->has_motor)) {
        run_rotor(r, &motion, node.params.Fc);
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
