/* SPDX-License-Identifier: MIT */
/* setup: create the nodes, encoders, faults and the shaft of a run, from a run file and the options. */
#ifndef SETUP_H
#define SETUP_H

#include "encoder_node.h"
#include "faults.h"
#include "files.h"
#include "models.h"
#include "motion.h"
#include "dahl_node.h"
#include "options.h"
#include "plant.h"
#include "run_file.h"

/* All zeros but options, run and counts_path, before setup_create. Large: make it static. */
typedef struct {
    const options_t *options;
    const run_t *run;
    const char *counts_path; /* of a motion of kind counts */
    uint32_t node_count;
    uint32_t encoder_count;
    dahl_node_t nodes[DAHL_FRAMES_NODES];
    model_memory_t models[DAHL_FRAMES_NODES]; /* used if the model is not dahl */
    motion_t motions[DAHL_FRAMES_NODES];
    encoder_t encoders[DAHL_FRAMES_NODES];
    faults_t faults[DAHL_FRAMES_NODES];
    plant_t plant;
} setup_t;

/* Returns 0, or prints one error line and returns -1. */
int setup_create(setup_t *s);

/* Node number of the i-th node and of its encoder. */
uint8_t setup_number(const setup_t *s, uint32_t i);

void setup_close(setup_t *s);

#endif
