/* SPDX-License-Identifier: MIT */
/* Files of counts of any bytes are read to their end, or to a line that is refused with one error. */
#include "motion.h"

#include <math.h>

#include "streams.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const run_motion_t run = {.number = MOTION_COUNTS};
    static motion_t motion;
    int32_t count;
    int result = 1;
    streams_begin(data, size);
    HOLDS(motion_open(&motion, &run, "counts", 1), "the file is there");
    while ((result = motion_next(&motion, &count)) == 1) {
        HOLDS(isfinite(motion.load), "a load is finite");
    }
    motion_close(&motion);
    HOLDS(size > 0 || result == -1, "an empty file is refused");
    streams_check(result == 0);
    return 0;
}
