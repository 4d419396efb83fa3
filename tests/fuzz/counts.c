/* SPDX-License-Identifier: MIT */
/* Files of counts of any bytes are read to their end, or to a line that is refused with one error. */
#include "counts.h"

#include <math.h>

#include "streams.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static counts_t counts;
    double x = 0;
    int32_t count;
    int result = 1;
    streams_begin(data, size);
    HOLDS(counts_open(&counts, "counts"), "the file is there");
    while ((result = counts_next(&counts, &count, &x)) == 1) {
        HOLDS(isfinite(x), "a load is finite");
    }
    counts_close(&counts);
    HOLDS(size > 0 || result == -1, "an empty file is refused");
    streams_check(result == 0);
    return 0;
}
