/* SPDX-License-Identifier: MIT */
/* Only parts that were run have entries. */
#include "summary.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "timing.h"
#include "utf8.h"

static void add(cJSON *to, const char *name, double value)
{
    cJSON_AddNumberToObject(to, name, value);
}

static void add_count(cJSON *to, const char *name, uint64_t value)
{
    add(to, name, (double)value);
}

/* A path may hold any bytes; JSON requires UTF-8. */
static void add_text(cJSON *to, const char *name, const char *text)
{
    char copy[4096];
    snprintf(copy, sizeof copy, "%s", text);
    utf8_repair(copy);
    cJSON_AddStringToObject(to, name, copy);
}

static double to_us(uint64_t ns)
{
    return (double)ns / NS_PER_US;
}

static void add_histogram(cJSON *to, const char *name, const histogram_t *histogram)
{
    cJSON *object = cJSON_AddObjectToObject(to, name);
    add(object, "p50", to_us(histogram_quantile(histogram, 0.5)));
    add(object, "p99", to_us(histogram_quantile(histogram, 0.99)));
    add(object, "max", to_us(histogram->max));
}

/* For each bin with counts, its upper edge in us and its count. */
static void add_bins(cJSON *to, const char *name, const histogram_t *histogram)
{
    cJSON *list = cJSON_AddArrayToObject(to, name);
    for (size_t bin = 0; bin < HISTOGRAM_BINS; bin++) {
        if (histogram->bins[bin] > 0) {
            const double pair[2] = {to_us(histogram_edge(bin)), (double)histogram->bins[bin]};
            cJSON_AddItemToArray(list, cJSON_CreateDoubleArray(pair, 2));
        }
    }
}

/* Print all 64 bits, so that the run can be repeated. A double would round them. */
static void add_seed(cJSON *to, uint64_t seed)
{
    char text[24];
    snprintf(text, sizeof text, "%llu", (unsigned long long)seed);
    cJSON_AddRawToObject(to, "seed", text);
}

static void add_run(cJSON *to, const options_t *options, const scene_t *scene, const loop_t *loop)
{
    add_text(to, "bus", options->bus);
    add_text(to, "scene", options->scene);
    cJSON_AddStringToObject(to, "title", scene->title);
    cJSON_AddStringToObject(to, "time", options->is_virtual ? "virtual" : "real");
    add_seed(to, options->seed);
    add_count(to, "ticks", loop->ticks);
}

typedef struct {
    uint64_t sent, answered, unmatched, corrupt;
    histogram_t latency, jitter;
} encoders_t;

static void add_up(encoders_t *all, const loop_t *loop)
{
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        const encoder_t *encoder = &loop->encoders[i];
        all->sent += encoder->sent;
        all->answered += encoder->answered;
        all->unmatched += encoder->unmatched;
        all->corrupt += encoder->corrupt;
        histogram_merge(&all->latency, &encoder->latency);
        histogram_merge(&all->jitter, &encoder->jitter);
    }
}

/* In virtual time without a bit rate the clock stands still between a count and its answer. */
static bool has_latencies(const loop_t *loop)
{
    return !loop->clock->is_virtual || loop->is_timed;
}

static void add_latencies(cJSON *to, const encoders_t *all)
{
    add_histogram(to, "latency_us", &all->latency);
    add_histogram(to, "jitter_us", &all->jitter);
    add_bins(to, "latency_histogram", &all->latency);
}

static void add_encoders(cJSON *to, const loop_t *loop)
{
    static encoders_t all; /* large */
    all = (encoders_t){0};
    add_up(&all, loop);
    add_count(to, "frames_sent", all.sent);
    add_count(to, "frames_answered", all.answered);
    add_count(to, "frames_lost", all.sent - all.answered);
    add_count(to, "answers_unmatched", all.unmatched);
    add_count(to, "answers_corrupt", all.corrupt);
    if (has_latencies(loop)) {
        add_latencies(to, &all);
    }
}

/* Answers and ticks that are more than a period late, and their sum. The totals are frames_answered and ticks. */
static void add_deadlines(cJSON *to, const loop_t *loop)
{
    uint64_t answers = 0;
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        answers += loop->encoders[i].late;
    }
    add_count(to, "late_ticks", loop->late_ticks);
    if (loop->encoder_count > 0) {
        add_count(to, "late_answers", answers);
    }
    add_count(to, "deadline_misses", loop->late_ticks + answers);
}

/* Names of dahl_node_counts_t, in its order. */
static const char *const count_names[] = {"ok",    "repeated", "lost",  "wrong_sequence", "crc",    "format", "invalid",
                                          "jump",  "stale",    "rearm", "ignored",        "params", "resets",
                                          "bus_off"};

enum { COUNTS = sizeof count_names / sizeof count_names[0] };

typedef char assert_counts_are_named[sizeof(dahl_node_counts_t) == COUNTS * sizeof(uint32_t) ? 1 : -1];

static uint32_t count_of(const dahl_node_counts_t *counts, size_t i)
{
    uint32_t values[COUNTS];
    memcpy(values, counts, sizeof values);
    return values[i];
}

static void add_nodes(cJSON *to, const loop_t *loop)
{
    cJSON *node = cJSON_AddObjectToObject(to, "node");
    add_count(to, "nodes", loop->node_count);
    for (size_t i = 0; i < COUNTS; i++) {
        uint64_t sum = 0;
        for (uint32_t n = 0; n < loop->node_count; n++) {
            sum += count_of(&loop->nodes[n].counts, i);
        }
        add_count(node, count_names[i], sum);
    }
}

static void add_injected(cJSON *to, const loop_t *loop)
{
    cJSON *injected = cJSON_AddObjectToObject(to, "injected");
    for (size_t fault = 0; fault < FAULT_KINDS; fault++) {
        uint64_t sum = 0;
        for (uint32_t i = 0; i < loop->encoder_count; i++) {
            sum += loop->encoders[i].faults->injected[fault];
        }
        add_count(injected, fault_names[fault], sum);
    }
}

/* The injected faults, and the counts that the nodes must have after them. */
static void add_faults(cJSON *to, const loop_t *loop)
{
    cJSON *faults = cJSON_AddObjectToObject(to, "faults");
    add_injected(faults, loop);
    cJSON *expected = cJSON_AddObjectToObject(faults, "expected");
    for (size_t i = 0; i < COUNTS; i++) {
        uint64_t sum = 0;
        for (uint32_t n = 0; n < loop->encoder_count; n++) {
            sum += count_of(&loop->encoders[n].faults->expected, i);
        }
        add_count(expected, count_names[i], sum);
    }
}

static void add_plant(cJSON *to, const plant_t *plant)
{
    cJSON *control = cJSON_AddObjectToObject(to, "control");
    double ticks = (double)(plant->ticks > 0 ? plant->ticks : 1);
    add(control, "rms_error_rad", sqrt(plant->sum_square / ticks));
    add(control, "max_error_rad", plant->max_error);
    add_count(control, "torque_alternations", plant->alternations);
    add_count(control, "reference_reversals", plant->reversals);
}

static void add_load(cJSON *to, const loop_t *loop)
{
    add_count(to, "bitrate", loop->bitrate);
    add(to, "bus_load", loop->load);
    add(to, "bus_load_peak", loop->peak_load);
}

static void add_bus(cJSON *to, const loop_t *loop)
{
    cJSON *bus = cJSON_AddObjectToObject(to, "bus_counts");
    add_count(bus, "send_failed", loop->send_failed);
    add_count(bus, "error_frames", loop->error_frames);
    add_count(bus, "long_fd_frames", loop->cut_frames);
    add_count(bus, "dropped", loop->bus->counts.dropped);
    add_count(bus, "garbage", loop->bus->counts.garbage);
    add_count(bus, "retries", loop->bus->counts.retries);
}

/* Peak memory of this program. (getrusage would include the parent's memory before exec.) */
static double peak_memory_kib(void)
{
    char line[128];
    unsigned long kib = 0;
    FILE *file = fopen("/proc/self/status", "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        if (sscanf(line, "VmHWM: %lu", &kib) == 1) {
            break;
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    return (double)kib;
}

static void add_cost(cJSON *to, const loop_t *loop)
{
    double wall = (double)loop->wall_ns * 1e-9;
    add(to, "wall_s", wall);
    add(to, "realtime_factor", wall > 0 ? loop_seconds(loop) / wall : 0);
    add(to, "max_rss_kib", peak_memory_kib());
}

static cJSON *collect(const options_t *options, const scene_t *scene, const loop_t *loop, const plant_t *plant)
{
    cJSON *root = cJSON_CreateObject();
    add_run(root, options, scene, loop);
    if (loop->encoder_count > 0) {
        add_encoders(root, loop);
    }
    if (has_latencies(loop)) {
        add_deadlines(root, loop);
    }
    if (loop->node_count > 0) {
        add_nodes(root, loop);
    }
    if (loop->encoder_count > 0 && loop->encoders[0].faults != NULL) {
        add_faults(root, loop);
    }
    if (plant != NULL) {
        add_plant(root, plant);
    }
    if (loop->bitrate > 0) {
        add_load(root, loop);
    }
    if (!options->is_virtual) {
        add_histogram(root, "beat_late_us", &loop->late);
    }
    add_bus(root, loop);
    add_cost(root, loop);
    return root;
}

/* text is NULL if memory ran out. */
static bool print_to(FILE *file, const char *text)
{
    bool is_written = text != NULL && fprintf(file, "%s\n", text) > 0;
    return (file == stdout ? fflush(file) == 0 : fclose(file) == 0) && is_written;
}

bool summary_write(const char *path, const options_t *options, const scene_t *scene, const loop_t *loop,
                   const plant_t *plant)
{
    FILE *file = strcmp(path, "-") == 0 ? stdout : fopen(path, "w");
    if (file == NULL) {
        return false;
    }
    cJSON *root = collect(options, scene, loop, plant);
    char *text = cJSON_Print(root);
    errno = ENOMEM;
    bool is_written = print_to(file, text);
    cJSON_free(text);
    cJSON_Delete(root);
    return is_written;
}
