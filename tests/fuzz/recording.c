/* SPDX-License-Identifier: MIT */
/* Measured logs of any bytes are refused with one line, or read to their end. tests/python checks the content of rows. */
#include "recording.h"

#include <math.h>

#include "streams.h"

static void read_all(double counts_per_unit, const char *time)
{
    static recording_t recording;
    const recording_columns_t columns = {"a", time, time, counts_per_unit};
    double load = 0;
    int32_t count;
    uint64_t rows = 0;
    int good = recording_open(&recording, "log", &columns), result = 0;
    for (; good && (result = recording_next(&recording, &count, &load)) == 1; rows++) {
        HOLDS(rows > 0 || count == 0, "counts begin at 0");
        HOLDS(time[0] == '\0' ? load == 0 : isfinite(load), "a load is finite, and 0 without a column");
    }
    HOLDS(result == 0, "an accepted log is read to its end without an error");
    HOLDS(!good || rows > 0, "a log without rows is refused");
    recording_close(&recording);
    streams_check(good);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const double scales[4] = {1, 1e3, -1e15, 0.25};
    if (size < 2) {
        return 0;
    }
    streams_begin(data + 1, size - 1);
    read_all(scales[data[0] & 3], (data[0] & 4) != 0 ? "t" : "");
    return 0;
}
