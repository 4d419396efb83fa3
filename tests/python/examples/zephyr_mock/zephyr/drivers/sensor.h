/* SPDX-License-Identifier: MIT */
/* Declarations of Zephyr's sensor API that docs/recipes.md uses. */
#ifndef MOCK_SENSOR_H
#define MOCK_SENSOR_H

#include <stdint.h>

struct device;

struct sensor_value {
    int32_t val1; /* whole part */
    int32_t val2; /* millionths */
};

enum sensor_channel { SENSOR_CHAN_ROTATION };

int sensor_sample_fetch(const struct device *dev);
int sensor_channel_get(const struct device *dev, enum sensor_channel channel, struct sensor_value *value);

#endif
