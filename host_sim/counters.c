/* SPDX-License-Identifier: MIT */
#include "counters.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

static void put(FILE *file, const char *group, const char *name, uint64_t value)
{
    fprintf(file, "%s%s = %" PRIu64 "\n", group, name, value);
}

static void put_histogram(FILE *file, const char *name, const histogram_t *histogram)
{
    fprintf(file, "%s = %" PRIu64, name, histogram->max);
    for (size_t bin = 0; bin < HISTOGRAM_BINS; bin++) {
        if (histogram->bins[bin] > 0) {
            fprintf(file, " %" PRIu64 ":%" PRIu64, histogram_edge(bin), histogram->bins[bin]);
        }
    }
    fputc('\n', file);
}

/* Names of dahl_node_counts_t, in its order. */
static const char *const count_names[] = {"ok",    "repeated", "lost",  "wrong_sequence", "crc",    "format", "invalid",
                                          "jump",  "stale",    "rearm", "ignored",        "params", "resets",
                                          "bus_off"};

enum { COUNTS = sizeof count_names / sizeof count_names[0] };

typedef char assert_counts_are_named[sizeof(dahl_node_counts_t) == COUNTS * sizeof(uint32_t) ? 1 : -1];

static void add_counts(uint64_t sums[COUNTS], const dahl_node_counts_t *counts)
{
    uint32_t values[COUNTS];
    memcpy(values, counts, sizeof values);
    for (size_t i = 0; i < COUNTS; i++) {
        sums[i] += values[i];
    }
}

static void put_counts(FILE *file, const char *group, const uint64_t sums[COUNTS])
{
    for (size_t i = 0; i < COUNTS; i++) {
        put(file, group, count_names[i], sums[i]);
    }
}

static void put_nodes(FILE *file, const loop_t *loop)
{
    uint64_t sums[COUNTS] = {0};
    for (uint32_t i = 0; i < loop->node_count; i++) {
        add_counts(sums, &loop->nodes[i].counts);
    }
    put(file, "", "nodes", loop->node_count);
    put_counts(file, "node.", sums);
}

/* The injected faults, and the counts that the nodes must have after them. */
static void put_faults(FILE *file, const loop_t *loop)
{
    uint64_t expected[COUNTS] = {0}, injected[FAULT_KINDS] = {0};
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        const faults_t *faults = loop->encoders[i].faults;
        add_counts(expected, &faults->expected);
        for (size_t fault = 0; fault < FAULT_KINDS; fault++) {
            injected[fault] += faults->injected[fault];
        }
    }
    for (size_t fault = 0; fault < FAULT_KINDS; fault++) {
        put(file, "injected.", fault_names[fault], injected[fault]);
    }
    put_counts(file, "expected.", expected);
}

/* In virtual time the clock stands still between a count and its answer, so there are no latencies. */
static void put_encoders(FILE *file, const loop_t *loop)
{
    static histogram_t latency, jitter; /* large */
    uint64_t sent = 0, answered = 0, late = 0, unmatched = 0, corrupt = 0;
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        const encoder_t *encoder = &loop->encoders[i];
        sent += encoder->sent;
        answered += encoder->answered;
        late += encoder->late;
        unmatched += encoder->unmatched;
        corrupt += encoder->corrupt;
        histogram_merge(&latency, &encoder->latency);
        histogram_merge(&jitter, &encoder->jitter);
    }
    put(file, "frames.", "sent", sent);
    put(file, "frames.", "answered", answered);
    put(file, "answers.", "unmatched", unmatched);
    put(file, "answers.", "corrupt", corrupt);
    if (!loop->clock->is_virtual) {
        put(file, "answers.", "late", late);
        put_histogram(file, "latency", &latency);
        put_histogram(file, "jitter", &jitter);
    }
}

static void put_plant(FILE *file, const plant_t *plant)
{
    put(file, "control.", "ticks", plant->ticks);
    fprintf(file, "control.sum_square_rad2 = %.17g\n", plant->sum_square);
    fprintf(file, "control.max_error_rad = %.17g\n", plant->max_error);
    put(file, "control.", "torque_alternations", plant->alternations);
    put(file, "control.", "reference_reversals", plant->reversals);
}

static void put_bus(FILE *file, const loop_t *loop)
{
    put(file, "bus.", "send_failed", loop->send_failed);
    put(file, "bus.", "error_frames", loop->error_frames);
    put(file, "bus.", "long_fd_frames", loop->cut_frames);
    put(file, "bus.", "dropped", loop->bus->counts.dropped);
    put(file, "bus.", "garbage", loop->bus->counts.garbage);
    put(file, "bus.", "retries", loop->bus->counts.retries);
}

/* Peak memory of this program. (getrusage would include the parent's memory before exec.) */
static uint64_t peak_memory_kib(void)
{
    char line[128];
    uint64_t kib = 0;
    FILE *file = fopen("/proc/self/status", "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL && sscanf(line, "VmHWM: %" SCNu64, &kib) != 1) {
    }
    if (file != NULL) {
        fclose(file);
    }
    return kib;
}

static void put_all(FILE *file, const loop_t *loop, const plant_t *plant)
{
    put(file, "", "ticks", loop->ticks);
    if (loop->encoder_count > 0) {
        put_encoders(file, loop);
    }
    if (!loop->clock->is_virtual) {
        put(file, "", "late_ticks", loop->late_ticks);
        put_histogram(file, "beat_late", &loop->late);
    }
    if (loop->node_count > 0) {
        put_nodes(file, loop);
    }
    if (loop->encoder_count > 0 && loop->encoders[0].faults != NULL) {
        put_faults(file, loop);
    }
    if (plant != NULL) {
        put_plant(file, plant);
    }
    put_bus(file, loop);
    put(file, "", "wall_ns", loop->wall_ns);
    put(file, "", "max_rss_kib", peak_memory_kib());
}

bool counters_write(const char *path, const loop_t *loop, const plant_t *plant)
{
    FILE *file = strcmp(path, "-") == 0 ? stdout : fopen(path, "w");
    if (file == NULL) {
        return false;
    }
    put_all(file, loop, plant);
    bool is_written = ferror(file) == 0;
    return (file == stdout ? fflush(file) == 0 : fclose(file) == 0) && is_written;
}
