/* SPDX-License-Identifier: MIT */
/* A search for the worst axis. An axis is a point: each of its values is a number of 0 .. 1. The search climbs from the best of
 * some random points: it changes some values, and keeps what is worse for the axis. */
#ifndef TEST_SEARCH_H
#define TEST_SEARCH_H

#include <math.h>
#include <unity.h>

#include "../random.h"

enum { VALUES = 64, STARTS = 8, MOVES = 40 };

typedef struct {
    double value[VALUES];
    int next;
} point_t;

/* Return the next value of a point. The order of the calls must not depend on the point. */
static inline double between(point_t *point, double least, double most)
{
    TEST_ASSERT_LESS_THAN_INT(VALUES, point->next);
    return least + (most - least) * point->value[point->next++];
}

static inline double log_between(point_t *point, double least, double most)
{
    return least * pow(most / least, between(point, 0, 1));
}

static inline int choose(point_t *point, int choices)
{
    return (int)between(point, 0, choices);
}

/* `usual` for half of the points. */
static inline double maybe(point_t *point, double usual, double least, double most)
{
    const int is_usual = choose(point, 2);
    const double value = between(point, least, most);
    return is_usual ? usual : value;
}

static inline double random_part(uint64_t *random)
{
    return random_u32(random) * 0x1p-32;
}

static inline point_t random_point(uint64_t *random)
{
    point_t point = {.next = 0};
    for (int k = 0; k < VALUES; k++) {
        point.value[k] = random_part(random);
    }
    return point;
}

/* Change up to three values: draw them again, or move them by a step of any size. */
static inline point_t neighbour(point_t point, uint64_t *random)
{
    for (int changes = 1 + (int)(random_u32(random) % 3); changes > 0; changes--) {
        double *value = &point.value[random_u32(random) % VALUES];
        const double step = pow(10, -2.5 * random_part(random)), drawn = random_part(random);
        const double moved = *value + step * (2 * drawn - 1);
        *value = random_u32(random) % 3 == 0 ? drawn : fmax(0, fmin(1 - 0x1p-32, moved));
    }
    return point;
}

/* Return the score of an axis; negative if the point is none. */
typedef double (*score_t)(const point_t *point, const void *problem);

/* Return the largest score after `tries` axes, or the first above `enough`, and its point. */
static inline double search(score_t score, const void *problem, int tries, double enough, uint64_t *random, point_t *worst)
{
    double largest = 0;
    point_t best = {.next = 0};
    double most = -1;
    for (int tried = 0, k = 0; tried < tries && largest <= enough; k = (k + 1) % (STARTS + MOVES)) {
        most = k == 0 ? -1 : most;
        const point_t point = k < STARTS || most < 0 ? random_point(random) : neighbour(best, random);
        const double found = score(&point, problem);
        tried += found >= 0;
        if (found >= most) {
            most = found;
            best = point;
        }
        if (found > largest) {
            largest = found;
            *worst = point;
        }
    }
    return largest;
}

#endif
