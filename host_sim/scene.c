/* SPDX-License-Identifier: MIT */
/* scene: see scene.h. One table says which keys there are, their ranges, and for which kind of motion they are needed;
 * reading fills it in, and the checks afterwards walk over it. */
#include "scene.h"

#include <errno.h>
#include <ini.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "complain.h"
#include "dahl.h"

enum { ANY_KIND = 7, OPTIONAL = 8, MAX_SECTIONS = 5 };

typedef struct {
    const char *section;
    const char *name;
    size_t offset;  /* of the value in scene_t */
    bool is_text;
    double low, high; /* of a number, both allowed */
    int use;          /* motion kinds that need it (ANY_KIND elsewhere), and OPTIONAL */
} scene_key_t;

#define AT(member) offsetof(scene_t, member)
#define TINY 1e-9
#define COUNTS 2147483647.0

static const scene_key_t keys[] = {
    {"scene", "title", AT(title), true, 0, 0, ANY_KIND | OPTIONAL},
    {"friction", "sigma0", AT(friction.sigma0), false, (double)DAHL_TORQUE_MIN, 1.8446742974197924e19, ANY_KIND},
    {"friction", "Fc", AT(friction.Fc), false, (double)DAHL_TORQUE_MIN, 1.8446742974197924e19, ANY_KIND},
    {"friction", "theta_per_count", AT(friction.theta_per_count), false, 1e-37, 1e37, ANY_KIND},
    {"friction", "node", AT(friction.node), false, 0, 15, ANY_KIND | OPTIONAL},
    {"friction", "timeout_ms", AT(friction.timeout_ms), false, 1, 60000, ANY_KIND | OPTIONAL},
    {"motion", "kind", AT(motion.kind_name), true, 0, 0, ANY_KIND},
    {"motion", "start_count", AT(motion.start_count), false, -COUNTS, COUNTS, ANY_KIND | OPTIONAL},
    {"motion", "theta1", AT(motion.theta1), false, -COUNTS, COUNTS, MOTION_SEGMENTS},
    {"motion", "theta2", AT(motion.theta2), false, -COUNTS, COUNTS, MOTION_SEGMENTS},
    {"motion", "theta3", AT(motion.theta3), false, -COUNTS, COUNTS, MOTION_SEGMENTS},
    {"motion", "speed", AT(motion.speed), false, TINY, 1e12, MOTION_SEGMENTS},
    {"motion", "hold_s", AT(motion.hold_s), false, 0, 3600, MOTION_SEGMENTS | MOTION_STEERING | OPTIONAL},
    {"motion", "amplitude", AT(motion.amplitude), false, 0, 1e9, MOTION_STEERING},
    {"motion", "sweep_s", AT(motion.sweep_s), false, 0.001, 3600, MOTION_STEERING},
    {"motion", "tremor", AT(motion.tremor), false, 0, 1e9, MOTION_STEERING},
    {"motion", "tremor_s", AT(motion.tremor_s), false, 0, 3600, MOTION_STEERING},
    {"motion", "seconds", AT(motion.seconds), false, 0.001, 1e9, MOTION_STEERING},
    {"motion", "file", AT(motion.file), true, 0, 0, MOTION_LOG},
    {"motion", "angle", AT(motion.angle), true, 0, 0, MOTION_LOG},
    {"motion", "time", AT(motion.time), true, 0, 0, MOTION_LOG | OPTIONAL},
    {"motion", "counts_per_unit", AT(motion.counts_per_unit), false, -1e15, 1e15, MOTION_LOG},
    {"status", "period_ms", AT(status_period_ms), false, 1, 60000, ANY_KIND},
};

enum { KEYS = sizeof keys / sizeof keys[0] };

static const char *const sections[MAX_SECTIONS] = {"scene", "friction", "motion", "status", "measured"};

typedef struct {
    scene_t *scene;
    const char *path;
    FILE *file;
    int line;
    bool failed;
    int section_line[MAX_SECTIONS]; /* 0: not there */
    int key_line[KEYS];             /* 0: not given */
} reader_t;

static int fail(reader_t *r)
{
    r->failed = true;
    return 0;
}

static int find_section(const char *name)
{
    for (int i = 0; i < MAX_SECTIONS; i++) {
        if (strcmp(sections[i], name) == 0) {
            return i;
        }
    }
    return -1;
}

static int find_key(const char *section, const char *name)
{
    for (int i = 0; i < KEYS; i++) {
        if (strcmp(keys[i].section, section) == 0 && strcmp(keys[i].name, name) == 0) {
            return i;
        }
    }
    return -1;
}

static int begin_section(reader_t *r, const char *name)
{
    int i = find_section(name);
    if (i < 0) {
        complain("%s:%d: unknown section [%s]", r->path, r->line, name);
        return fail(r);
    }
    r->section_line[i] = r->line;
    return 1;
}

/* inih does not tell of sections without keys, yet such a one names a part: look for it in the raw line. */
static void look_for_section(reader_t *r, const char *text)
{
    char name[SCENE_TEXT];
    const char *start = text + strspn(text, " \t\xEF\xBB\xBF");
    size_t length = strcspn(start, "]");
    if (start[0] != '[') {
        return;
    }
    if (start[length] != ']' || length - 1 >= sizeof name) {
        complain("%s:%d: a section name without ]", r->path, r->line);
        fail(r);
        return;
    }
    memcpy(name, start + 1, length - 1);
    name[length - 1] = '\0';
    begin_section(r, name);
}

static char *next_line(char *text, int size, void *stream)
{
    reader_t *r = (reader_t *)stream;
    if (r->failed || fgets(text, size, r->file) == NULL) {
        return NULL;
    }
    r->line++;
    if (strchr(text, '\n') == NULL && !feof(r->file)) {
        complain("%s:%d: line longer than %d characters, or not text", r->path, r->line, size - 2);
        fail(r);
        return NULL;
    }
    look_for_section(r, text);
    return r->failed ? NULL : text;
}

static int take_number(reader_t *r, const scene_key_t *key, const char *value, double *to)
{
    char *end;
    double number = strtod(value, &end);
    if (end == value || *end != '\0' || !isfinite(number)) {
        complain("%s:%d: [%s] %s = %s: not a finite number", r->path, r->line, key->section, key->name, value);
        return fail(r);
    }
    if (number < key->low || number > key->high) {
        complain("%s:%d: [%s] %s = %s: outside %.9g to %.9g", r->path, r->line, key->section, key->name, value,
                 key->low, key->high);
        return fail(r);
    }
    *to = number;
    return 1;
}

static int take_text(reader_t *r, const scene_key_t *key, const char *value, char *to)
{
    if (value[0] == '\0' || strlen(value) >= SCENE_TEXT) {
        complain("%s:%d: [%s] %s: %s", r->path, r->line, key->section, key->name, value[0] ? "too long" : "empty");
        return fail(r);
    }
    strcpy(to, value);
    return 1;
}

static int take(reader_t *r, int i, const char *value)
{
    const scene_key_t *key = &keys[i];
    char *to = (char *)r->scene + key->offset;
    if (r->key_line[i] != 0) {
        complain("%s:%d: [%s] %s given twice, first in line %d", r->path, r->line, key->section, key->name,
                 r->key_line[i]);
        return fail(r);
    }
    r->key_line[i] = r->line;
    return key->is_text ? take_text(r, key, value, to) : take_number(r, key, value, (double *)(void *)to);
}

static int on_key(void *user, const char *section, const char *name, const char *value)
{
    reader_t *r = (reader_t *)user;
    int i = find_key(section, name);
    if (r->failed) {
        return 0;
    }
    if (strcmp(section, "measured") == 0) {
        return 1;
    }
    if (i < 0) {
        complain("%s:%d: unknown key \"%s\" in [%s]", r->path, r->line, name, section);
        return fail(r);
    }
    return take(r, i, value);
}

static bool parse(reader_t *r)
{
    int bad_line = ini_parse_stream(next_line, r, on_key, r);
    if (!r->failed && bad_line != 0) {
        complain("%s:%d: neither a [section], nor key = value, nor a comment", r->path, bad_line);
        fail(r);
    }
    return !r->failed;
}

static bool take_kind(reader_t *r)
{
    scene_motion_t *motion = &r->scene->motion;
    static const struct {
        const char *name;
        motion_kind_t kind;
    } kinds[] = {{"segments", MOTION_SEGMENTS}, {"steering", MOTION_STEERING}, {"log", MOTION_LOG}};
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        if (strcmp(motion->kind_name, kinds[i].name) == 0) {
            motion->kind = kinds[i].kind;
            return true;
        }
    }
    if (r->key_line[find_key("motion", "kind")] == 0) {
        complain("%s:%d: [motion] has no key \"kind\"", r->path, r->section_line[find_section("motion")]);
    } else {
        complain("%s:%d: [motion] kind = %s: not one of segments, steering, log", r->path,
                 r->key_line[find_key("motion", "kind")], motion->kind_name);
    }
    return false;
}

static bool is_needed(const reader_t *r, const scene_key_t *key)
{
    bool for_kind = strcmp(key->section, "motion") != 0 || (key->use & (int)r->scene->motion.kind) != 0;
    return r->section_line[find_section(key->section)] != 0 && (key->use & OPTIONAL) == 0 && for_kind;
}

static bool is_out_of_place(const reader_t *r, const scene_key_t *key)
{
    return strcmp(key->section, "motion") == 0 && (key->use & (int)r->scene->motion.kind) == 0;
}

static bool check_key(const reader_t *r, int i)
{
    const scene_key_t *key = &keys[i];
    if (r->key_line[i] == 0 && is_needed(r, key)) {
        complain("%s:%d: [%s] has no key \"%s\"", r->path, r->section_line[find_section(key->section)], key->section,
                 key->name);
        return false;
    }
    if (r->key_line[i] != 0 && is_out_of_place(r, key)) {
        complain("%s:%d: [motion] %s has no meaning for kind = %s", r->path, r->key_line[i], key->name,
                 r->scene->motion.kind_name);
        return false;
    }
    return true;
}

static bool check_travel(const reader_t *r)
{
    const scene_friction_t *f = &r->scene->friction;
    double travel = f->sigma0 / f->Fc * f->theta_per_count;
    if (travel < DAHL_TRAVEL_MIN || travel >= DAHL_TRAVEL_MAX) {
        complain("%s:%d: [friction] theta_per_count = %.9g: sigma0/Fc*theta_per_count = %.9g, outside %.9g to %.9g",
                 r->path, r->key_line[find_key("friction", "theta_per_count")], f->theta_per_count, travel,
                 DAHL_TRAVEL_MIN, DAHL_TRAVEL_MAX);
        return false;
    }
    return true;
}

static bool check(reader_t *r)
{
    scene_t *scene = r->scene;
    scene->has_friction = r->section_line[find_section("friction")] != 0;
    scene->has_motion = r->section_line[find_section("motion")] != 0;
    scene->has_status = r->section_line[find_section("status")] != 0;
    if (!scene->has_friction && !scene->has_motion) {
        complain("%s: names neither [friction] nor [motion]: nothing to run", r->path);
        return false;
    }
    if (scene->has_motion && !take_kind(r)) {
        return false;
    }
    for (int i = 0; i < KEYS; i++) {
        if (!check_key(r, i)) {
            return false;
        }
    }
    return !scene->has_friction || check_travel(r);
}

bool scene_read(scene_t *scene, const char *path)
{
    reader_t reader = {.scene = scene, .path = path};
    *scene = (scene_t){0};
    reader.file = fopen(path, "r");
    if (reader.file == NULL) {
        complain("%s: %s", path, strerror(errno));
        return false;
    }
    bool good = parse(&reader) && check(&reader);
    fclose(reader.file);
    return good;
}
