/* SPDX-License-Identifier: MIT */
/* frame_queue: a ring buffer of frames in fixed memory. A full buffer rejects new frames and overwrites no old one. For one
 * thread. */
#ifndef FRAME_QUEUE_H
#define FRAME_QUEUE_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"

#define FRAME_QUEUE_SIZE 1024u /* a power of two */

/* All zeros: empty. */
typedef struct {
    uint32_t head; /* next to read; both wrap at 2^32 */
    uint32_t tail; /* next to write */
    dahl_can_frame_t frames[FRAME_QUEUE_SIZE];
} frame_queue_t;

static inline uint32_t frame_queue_room(const frame_queue_t *queue)
{
    return FRAME_QUEUE_SIZE - (queue->tail - queue->head);
}

static inline bool frame_queue_put(frame_queue_t *queue, const dahl_can_frame_t *frame)
{
    if (frame_queue_room(queue) == 0) {
        return false;
    }
    queue->frames[queue->tail++ % FRAME_QUEUE_SIZE] = *frame;
    return true;
}

static inline bool frame_queue_take(frame_queue_t *queue, dahl_can_frame_t *frame)
{
    if (queue->head == queue->tail) {
        return false;
    }
    *frame = queue->frames[queue->head++ % FRAME_QUEUE_SIZE];
    return true;
}

#endif
