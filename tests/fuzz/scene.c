/* SPDX-License-Identifier: MIT */
/* Scenes of any bytes are refused with one line, or accepted and run for some ticks: node, motion and rotor as in dahl-loop. If
 * the first byte is '@', the first lines are settings of the command line. tests/python/sim compares the limits of each key. */
#include "scene.h"

#include "motion.h"
#include "dahl_node.h"
#include "plant.h"
#include "streams.h"

enum { TICKS = 40, SETS = 2, SET_LENGTH = 80 };

/* Return 0 if the parameters are refused after their rounding to float. */
static int start_node(const scene_t *scene, dahl_node_t *node)
{
    const scene_friction_t *f = &scene->friction;
    const dahl_params_t params = {(float)f->sigma0, (float)f->Fc, (float)f->theta_per_count};
    return dahl_node_init(node, &params, (uint8_t)f->node) == DAHL_OK;
}

static void run_rotor(const scene_t *scene, motion_t *reference)
{
    static plant_t plant;
    static encoder_t encoder;
    int32_t count;
    if (plant_open(&plant, scene, scene->has_control ? reference : NULL, &encoder)) {
        for (int i = 0; i < TICKS && motion_next(&plant.motion, &count) == 1; i++) {
        }
    }
}

static void run_motion(const scene_t *scene, motion_t *motion)
{
    int32_t count;
    HOLDS(motion_open(motion, &scene->motion, "", "", 1), "an accepted scene can move");
    for (int i = 0; i < TICKS && motion_next(motion, &count) == 1; i++) {
    }
}

static void run(const scene_t *scene)
{
    static motion_t motion;
    static dahl_node_t node;
    int moves = scene->has_motion && scene->motion.kind != MOTION_LOG;
    if (scene->has_friction && !start_node(scene, &node)) {
        return;
    }
    if (moves) {
        run_motion(scene, &motion);
    }
    if (scene->has_rotor && (moves || scene->has_motor)) {
        run_rotor(scene, &motion);
    }
}

static int take_sets(const uint8_t **data, size_t *size, char sets[SETS][SET_LENGTH])
{
    int count = 0;
    for (; count < SETS; count++) {
        const uint8_t *end = memchr(*data, '\n', *size);
        size_t length = end == NULL ? 0 : (size_t)(end - *data);
        if (end == NULL || length >= SET_LENGTH) {
            break;
        }
        memcpy(sets[count], *data, length);
        sets[count][length] = '\0';
        *data = end + 1;
        *size -= length + 1;
    }
    return count;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static scene_t scene;
    char sets[SETS][SET_LENGTH];
    const char *texts[SETS] = {sets[0], sets[1]};
    int count = 0;
    if (size > 0 && data[0] == '@') {
        data++;
        size--;
        count = take_sets(&data, &size, sets);
    }
    streams_begin(data, size);
    int good = scene_read(&scene, "scene.ini", texts, count);
    streams_check(good);
    if (good) {
        run(&scene);
    }
    return 0;
}
