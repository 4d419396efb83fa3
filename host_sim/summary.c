/* SPDX-License-Identifier: MIT */
/* summary: see summary.h. A part that was not run has no entry. */
#include "summary.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>

static void add(cJSON *to, const char *name, double value)
{
    cJSON_AddNumberToObject(to, name, value);
}

static void add_count(cJSON *to, const char *name, uint64_t value)
{
    add(to, name, (double)value);
}

static void add_histogram(cJSON *to, const char *name, const histogram_t *histogram)
{
    cJSON *object = cJSON_AddObjectToObject(to, name);
    add(object, "p50", (double)histogram_quantile(histogram, 0.5) / 1000.0);
    add(object, "p99", (double)histogram_quantile(histogram, 0.99) / 1000.0);
    add(object, "max", (double)histogram->max / 1000.0);
}

static void add_run(cJSON *to, const options_t *options, const scene_t *scene, const loop_t *loop)
{
    cJSON_AddStringToObject(to, "bus", options->bus);
    cJSON_AddStringToObject(to, "scene", options->scene);
    cJSON_AddStringToObject(to, "title", scene->title);
    cJSON_AddStringToObject(to, "time", options->is_virtual ? "virtual" : "real");
    add_count(to, "seed", options->seed);
    add_count(to, "ticks", loop->ticks);
}

static void add_encoder(cJSON *to, const loop_t *loop)
{
    const encoder_t *encoder = loop->encoder;
    add_count(to, "frames_sent", encoder->sent);
    add_count(to, "frames_answered", encoder->answered);
    add_count(to, "frames_lost", encoder->sent - encoder->answered);
    add_count(to, "answers_unmatched", encoder->unmatched);
    add_count(to, "answers_corrupt", encoder->corrupt);
    add_histogram(to, "latency_us", &encoder->latency);
}

static void add_node(cJSON *to, const node_counts_t *counts)
{
    cJSON *node = cJSON_AddObjectToObject(to, "node");
    add_count(node, "ok", counts->ok);
    add_count(node, "repeated", counts->repeated);
    add_count(node, "lost", counts->lost);
    add_count(node, "wrong_sequence", counts->wrong_sequence);
    add_count(node, "crc", counts->crc);
    add_count(node, "format", counts->format);
    add_count(node, "invalid", counts->invalid);
    add_count(node, "stale", counts->stale);
    add_count(node, "ignored", counts->ignored);
}

static void add_bus(cJSON *to, const loop_t *loop)
{
    cJSON *bus = cJSON_AddObjectToObject(to, "bus_counts");
    add_count(bus, "send_failed", loop->send_failed);
    add_count(bus, "dropped", loop->bus->counts.dropped);
    add_count(bus, "garbage", loop->bus->counts.garbage);
    add_count(bus, "retries", loop->bus->counts.retries);
}

/* Most memory that this program ever held. (getrusage would count the parent's, before exec, too.) */
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
    add(to, "realtime_factor", wall > 0 ? (double)(loop->ticks * LOOP_PERIOD_NS) * 1e-9 / wall : 0);
    add(to, "max_rss_kib", peak_memory_kib());
}

static cJSON *collect(const options_t *options, const scene_t *scene, const loop_t *loop)
{
    cJSON *root = cJSON_CreateObject();
    add_run(root, options, scene, loop);
    if (loop->encoder != NULL) {
        add_encoder(root, loop);
    }
    if (loop->node != NULL) {
        add_node(root, &loop->node->counts);
    }
    if (!options->is_virtual) {
        add_histogram(root, "beat_late_us", &loop->late);
    }
    add_bus(root, loop);
    add_cost(root, loop);
    return root;
}

static bool print_to(FILE *file, const char *text)
{
    bool good = fprintf(file, "%s\n", text) > 0;
    return (file == stdout ? fflush(file) == 0 : fclose(file) == 0) && good;
}

bool summary_write(const char *path, const options_t *options, const scene_t *scene, const loop_t *loop)
{
    FILE *file = strcmp(path, "-") == 0 ? stdout : fopen(path, "w");
    if (file == NULL) {
        return false;
    }
    cJSON *root = collect(options, scene, loop);
    char *text = cJSON_Print(root);
    errno = ENOMEM;
    bool good = text != NULL && print_to(file, text);
    cJSON_free(text);
    cJSON_Delete(root);
    return good;
}
