/* SPDX-License-Identifier: MIT */
/* parts: the nodes, encoders, faults and the shaft that a scene names, made ready to run. */
#ifndef PARTS_H
#define PARTS_H

#include "encoder.h"
#include "faults.h"
#include "files.h"
#include "models.h"
#include "motion.h"
#include "dahl_node.h"
#include "options.h"
#include "plant.h"
#include "scene.h"

/* All zeros but options, scene and log_path, before parts_prepare. Large: make it static. */
typedef struct {
    const options_t *options;
    const scene_t *scene;
    const char *log_path; /* of the measured log */
    uint32_t node_count;
    uint32_t encoder_count;
    dahl_node_t nodes[DAHL_FRAMES_NODES];
    models_kept_t models[DAHL_FRAMES_NODES]; /* where the scene's model is not Dahl's */
    motion_t motions[DAHL_FRAMES_NODES];
    encoder_t encoders[DAHL_FRAMES_NODES];
    faults_t faults[DAHL_FRAMES_NODES];
    plant_t plant;
} parts_t;

/* 0, or -1 after one error line was printed. */
int parts_prepare(parts_t *p);

/* Node number of the i-th node and of its encoder. */
uint8_t parts_number(const parts_t *p, uint32_t i);

void parts_close(parts_t *p);

#endif
