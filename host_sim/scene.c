/* SPDX-License-Identifier: MIT */
/* Read the file and the --set options by the tables of scene_keys.def, then check the scene as a whole. */
#define _POSIX_C_SOURCE 200809L
#include "scene.h"

#include <errno.h>
#include <ini.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stderr_messages.h"
#include "dahl.h"
#include "utf8.h"

enum { SEGMENTS = MOTION_SEGMENTS, STEERING = MOTION_STEERING, LOG = MOTION_LOG, ANY = SEGMENTS | STEERING | LOG };

typedef enum { NUMBER, WHOLE, LIST, TEXT } value_type_t;
typedef enum { OPTIONAL, REQUIRED, OWN } need_t;

typedef struct {
    const char *section;
    const char *name;
    size_t offset; /* of the value in scene_t */
    value_type_t type;
    double low, high; /* of a number, both allowed */
    need_t need;
    unsigned kinds; /* of [motion] that have the key */
    double usual;   /* number if the key is absent */
} scene_key_t;

#define SCENE_KEY(section, name, member, type, low, high, need, kinds, unit, usual, meaning) \
    {#section, #name, offsetof(scene_t, member), type, low, high, need, kinds, usual},
#define SCENE_FAULT(NAME, name, meaning, counts) \
    {"faults", #name, offsetof(scene_t, faults[FAULT_##NAME]), NUMBER, 0, 1, OPTIONAL, ANY, 0},
static const scene_key_t keys[] = {
#include "scene_keys.def"
};

#define SCENE_SECTION(name, meaning) #name,
static const char *const sections[] = {
#include "scene_keys.def"
};

#define SCENE_PLOT_KEY(section, name, unit, usual, meaning) #name,
static const char *const plot_keys[] = { /* of [measured] */
#include "scene_keys.def"
};

enum { KEYS = sizeof keys / sizeof keys[0], SECTIONS = sizeof sections / sizeof sections[0] };

typedef struct {
    scene_t *scene;
    const char *path;
    FILE *file;
    int line;
    bool has_failed;
    bool is_set;                /* the present line is a --set option, not of the file */
    int section_line[SECTIONS]; /* 0: absent; negative: number of the --set */
    int key_line[KEYS];         /* the same */
} reader_t;

static int present_line(const reader_t *r)
{
    return r->is_set ? -r->line : r->line;
}

static const char *path_of(const reader_t *r, int line)
{
    return line < 0 ? "--set" : r->path;
}

/* The place of a section or key, and the present place: two arguments for "%s:%d". */
#define PLACE(r, line) path_of(r, line), abs(line)
#define HERE(r) PLACE(r, present_line(r))

static int fail(reader_t *r)
{
    r->has_failed = true;
    return 0;
}

static int find_section(const char *name)
{
    for (int i = 0; i < SECTIONS; i++) {
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

static bool is_plot_key(const char *section, const char *name)
{
    for (size_t i = 0; i < sizeof plot_keys / sizeof plot_keys[0]; i++) {
        if (strcmp(section, "measured") == 0 && strcmp(name, plot_keys[i]) == 0) {
            return true;
        }
    }
    return false;
}

static int begin_section(reader_t *r, const char *name)
{
    int i = find_section(name);
    if (i < 0) {
        log_error("%s:%d: unknown section [%s]", HERE(r), name);
        return fail(r);
    }
    r->section_line[i] = present_line(r);
    return 1;
}

/* inih does not report sections without keys, but an empty section is valid. Thus find sections in the raw line. */
static void find_section_start(reader_t *r, const char *text)
{
    char name[SCENE_TEXT];
    const char *start = text + strspn(text, " \t\xEF\xBB\xBF");
    size_t length = strcspn(start, "]");
    if (start[0] != '[') {
        return;
    }
    if (start[length] != ']' || length - 1 >= sizeof name) {
        log_error("%s:%d: a section name without ]", HERE(r));
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
    if (r->has_failed || fgets(text, size, r->file) == NULL) {
        return NULL;
    }
    r->line++;
    if (strchr(text, '\n') == NULL && !feof(r->file)) {
        log_error("%s:%d: line longer than %d characters, or not text", HERE(r), size - 2);
        fail(r);
        return NULL;
    }
    find_section_start(r, text);
    return r->has_failed ? NULL : text;
}

static int read_number(reader_t *r, const scene_key_t *key, const char *value, double *to)
{
    char *end;
    double number = strtod(value, &end);
    if (end == value || *end != '\0' || !isfinite(number)) {
        log_error("%s:%d: [%s] %s = %s: not a finite number", HERE(r), key->section, key->name, value);
        return fail(r);
    }
    if (key->type == WHOLE && fabs(number - trunc(number)) > 0) {
        log_error("%s:%d: [%s] %s = %s: not a whole number", HERE(r), key->section, key->name, value);
        return fail(r);
    }
    if (number < key->low || number > key->high) {
        log_error("%s:%d: [%s] %s = %s: outside %.10g to %.10g", HERE(r), key->section, key->name, value,
                 key->low, key->high);
        return fail(r);
    }
    *to = number;
    return 1;
}

static int read_text(reader_t *r, const scene_key_t *key, const char *value, char *to)
{
    if (value[0] == '\0' || strlen(value) >= SCENE_TEXT) {
        log_error("%s:%d: [%s] %s: %s", HERE(r), key->section, key->name, value[0] ? "too long" : "empty");
        return fail(r);
    }
    if (!utf8_is_valid(value)) {
        log_error("%s:%d: [%s] %s = %s: not UTF-8", HERE(r), key->section, key->name, value);
        return fail(r);
    }
    strcpy(to, value);
    return 1;
}

/* Numbers separated by blanks. */
static int read_list(reader_t *r, const scene_key_t *key, const char *value, scene_list_t *to)
{
    char copy[SCENE_TEXT];
    char *rest = copy;
    to->count = 0;
    if (value[0] == '\0') {
        return read_number(r, key, value, to->value); /* prints the error */
    }
    if (read_text(r, key, value, copy) == 0) {
        return 0;
    }
    for (char *word = strtok_r(copy, " \t", &rest); word != NULL; word = strtok_r(NULL, " \t", &rest)) {
        if (to->count == DAHL_SLIP_MAX) {
            log_error("%s:%d: [%s] %s = %s: more than %d numbers", HERE(r), key->section, key->name, value,
                      DAHL_SLIP_MAX);
            return fail(r);
        }
        if (read_number(r, key, word, &to->value[to->count]) == 0) {
            return 0;
        }
        to->count++;
    }
    return 1;
}

static int read_value(reader_t *r, int i, const char *value)
{
    const scene_key_t *key = &keys[i];
    char *to = (char *)r->scene + key->offset;
    if (r->key_line[i] != 0) {
        log_error("%s:%d: [%s] %s given twice, first in line %d", HERE(r), key->section, key->name,
                 r->key_line[i]);
        return fail(r);
    }
    r->key_line[i] = present_line(r);
    switch (key->type) {
    case TEXT: return read_text(r, key, value, to);
    case LIST: return read_list(r, key, value, (scene_list_t *)(void *)to);
    default: return read_number(r, key, value, (double *)(void *)to);
    }
}

static int on_key(void *user, const char *section, const char *name, const char *value)
{
    reader_t *r = (reader_t *)user;
    int i = find_key(section, name);
    if (r->has_failed) {
        return 0;
    }
    if (is_plot_key(section, name)) {
        return 1;
    }
    if (i < 0) {
        log_error("%s:%d: unknown key \"%s\" in [%s]", HERE(r), name, section);
        return fail(r);
    }
    return read_value(r, i, value);
}

static bool parse(reader_t *r)
{
    int bad_line = ini_parse_stream(next_line, r, on_key, r);
    if (!r->has_failed && bad_line != 0) {
        log_error("%s:%d: neither a [section], nor key = value, nor a comment", r->path, bad_line);
        fail(r);
    }
    return !r->has_failed;
}

static bool find_kind(reader_t *r)
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
        log_error("%s:%d: [motion] has no key \"kind\"", PLACE(r, r->section_line[find_section("motion")]));
    } else {
        log_error("%s:%d: [motion] kind = %s: not one of segments, steering, log",
                  PLACE(r, r->key_line[find_key("motion", "kind")]), motion->kind_name);
    }
    return false;
}

static bool is_needed(const reader_t *r, const scene_key_t *key)
{
    bool is_for_kind = strcmp(key->section, "motion") != 0 || (key->kinds & r->scene->motion.kind) != 0;
    return r->section_line[find_section(key->section)] != 0 && key->need == REQUIRED && is_for_kind;
}

static bool is_out_of_place(const reader_t *r, const scene_key_t *key)
{
    return strcmp(key->section, "motion") == 0 && (key->kinds & r->scene->motion.kind) == 0;
}

static bool check_key(const reader_t *r, int i)
{
    const scene_key_t *key = &keys[i];
    if (r->key_line[i] == 0 && is_needed(r, key)) {
        log_error("%s:%d: [%s] has no key \"%s\"", PLACE(r, r->section_line[find_section(key->section)]), key->section,
                 key->name);
        return false;
    }
    if (r->key_line[i] != 0 && is_out_of_place(r, key)) {
        log_error("%s:%d: [motion] %s has no meaning for kind = %s", PLACE(r, r->key_line[i]), key->name,
                 r->scene->motion.kind_name);
        return false;
    }
    return true;
}

typedef struct {
    const char *name;
    uint32_t sigma0, Fc; /* count of numbers; 0: one for each element */
    const char *key;     /* required for this model, an error for the others; "": the model has no key */
} model_row_t;

#define MODEL_ROW(name, NAME, Class, number, sigma0s, Fcs, plan, key, meaning) {#name, sigma0s, Fcs, key},
#define MODEL_NAME(name, ...) ", " #name
static const model_row_t models[] = {DAHL_FRAMES_MODELS(MODEL_ROW)};
static const char model_names[] = DAHL_FRAMES_MODELS(MODEL_NAME);

enum { MODELS = sizeof models / sizeof models[0] };

static int friction_line(const reader_t *r, const char *key)
{
    return r->key_line[find_key("friction", key)];
}

static bool find_model(reader_t *r)
{
    scene_friction_t *f = &r->scene->friction;
    for (int i = 0; i < MODELS; i++) {
        if (strcmp(f->model_name[0] == '\0' ? "dahl" : f->model_name, models[i].name) == 0) {
            f->model = (scene_model_t)i;
            return true;
        }
    }
    log_error("%s:%d: [friction] model = %s: not one of %s", PLACE(r, friction_line(r, "model")), f->model_name,
              model_names + strlen(", "));
    return false;
}

/* Check a key that belongs to one model only. */
static bool check_own_key(const reader_t *r, const char *key)
{
    bool is_needed_here = strcmp(models[r->scene->friction.model].key, key) == 0, is_given = friction_line(r, key) != 0;
    const char *name = models[r->scene->friction.model].name;
    if (is_needed_here && !is_given) {
        log_error("%s:%d: [friction] model = %s needs the key \"%s\"", PLACE(r, friction_line(r, "model")), name, key);
    } else if (is_given && !is_needed_here) {
        log_error("%s:%d: [friction] %s has no meaning for model = %s", PLACE(r, friction_line(r, key)), key, name);
    }
    return is_given == is_needed_here;
}

static bool check_own_keys(const reader_t *r)
{
    for (int i = 0; i < MODELS; i++) {
        if (models[i].key[0] != '\0' && !check_own_key(r, models[i].key)) {
            return false;
        }
    }
    return true;
}

static const char *expected_numbers(const model_row_t *model)
{
    return model->sigma0 == 0 ? "as many of both, one for each element"
           : model->Fc == 2   ? "one sigma0, and one Fc for each direction"
                              : "one of each";
}

static bool check_numbers_of_elements(const reader_t *r)
{
    const scene_friction_t *f = &r->scene->friction;
    uint32_t sigma0 = models[f->model].sigma0, Fc = models[f->model].Fc;
    bool is_good = sigma0 == 0 ? f->sigma0_of.count == f->Fc_of.count : f->sigma0_of.count == sigma0 && f->Fc_of.count == Fc;
    if (!is_good) {
        log_error("%s:%d: [friction] sigma0 has %u numbers and Fc %u: model %s needs %s", PLACE(r, friction_line(r, "Fc")),
                  f->sigma0_of.count, f->Fc_of.count, models[f->model].name, expected_numbers(&models[f->model]));
    }
    return is_good;
}

/* Read dahl or slip for each element of parallel. */
static bool read_kinds(reader_t *r)
{
    scene_friction_t *f = &r->scene->friction;
    char copy[SCENE_TEXT], *rest = copy;
    uint32_t count = 0;
    strcpy(copy, f->kinds);
    for (char *word = strtok_r(copy, " \t", &rest); word != NULL; word = strtok_r(NULL, " \t", &rest), count++) {
        if (strcmp(word, "slip") != 0 && strcmp(word, "dahl") != 0) {
            log_error("%s:%d: [friction] kinds = %s: %s is not one of dahl, slip", PLACE(r, friction_line(r, "kinds")), f->kinds,
                      word);
            return false;
        }
        f->slips |= count < DAHL_SLIP_MAX && word[0] == 's' ? 1u << count : 0u;
    }
    if (count != f->Fc_of.count) {
        log_error("%s:%d: [friction] kinds has %u words and Fc %u numbers: one word for each element is expected",
                  PLACE(r, friction_line(r, "kinds")), count, f->Fc_of.count);
    }
    return count == f->Fc_of.count;
}

/* Compute the sigma0 and Fc that the ratio on the bus refers to. */
static void sum_elements(scene_friction_t *f)
{
    for (uint32_t k = 0; k < f->sigma0_of.count; k++) {
        f->sigma0 += f->sigma0_of.value[k];
    }
    for (uint32_t k = 0; k < f->Fc_of.count; k++) {
        f->Fc = models[f->model].Fc == 2 ? fmax(f->Fc, f->Fc_of.value[k]) : f->Fc + f->Fc_of.value[k];
    }
}

static bool read_model(reader_t *r)
{
    scene_friction_t *f = &r->scene->friction;
    bool is_good = find_model(r) && check_own_keys(r) && check_numbers_of_elements(r)
                   && (f->model != MODEL_PARALLEL || read_kinds(r));
    sum_elements(f);
    return is_good;
}

static bool check_parameter(const reader_t *r, const char *key, double value)
{
    if ((float)value >= DAHL_TORQUE_MIN && (float)value < DAHL_TORQUE_MAX) {
        return true;
    }
    log_error("%s:%d: [friction] %s = %.9g: outside %.9g to %.9g", PLACE(r, r->key_line[find_key("friction", key)]), key, value,
              (double)DAHL_TORQUE_MIN, (double)DAHL_TORQUE_MAX);
    return false;
}

/* dahl_prepare() decides, with the same floats as the run. */
static bool check_travel(const reader_t *r, double sigma0, double Fc)
{
    const scene_friction_t *f = &r->scene->friction;
    const dahl_params_t params = {(float)sigma0, (float)Fc, (float)f->theta_per_count};
    dahl_plan_t plan;
    if (dahl_prepare(&plan, &params) == DAHL_OK) {
        return true;
    }
    if (check_parameter(r, "sigma0", sigma0) && check_parameter(r, "Fc", Fc) &&
        check_parameter(r, "theta_per_count", f->theta_per_count)) {
        log_error("%s:%d: [friction] theta_per_count = %.9g: sigma0/Fc*theta_per_count = %.9g, outside %.9g to %.9g",
                  PLACE(r, r->key_line[find_key("friction", "theta_per_count")]), f->theta_per_count,
                  sigma0 / Fc * f->theta_per_count, DAHL_TRAVEL_MIN, DAHL_TRAVEL_MAX);
    }
    return false;
}

static double sigma0_of(const scene_friction_t *f, uint32_t k)
{
    return f->sigma0_of.value[k < f->sigma0_of.count ? k : 0];
}

static bool check_friction(reader_t *r)
{
    const scene_friction_t *f = &r->scene->friction;
    if (!read_model(r)) {
        return false;
    }
    for (uint32_t k = 0; k < f->Fc_of.count; k++) {
        if (!check_travel(r, sigma0_of(f, k), f->Fc_of.value[k])) {
            return false;
        }
    }
    return true;
}

static bool has(const reader_t *r, const char *section)
{
    return r->section_line[find_section(section)] != 0;
}

static bool needs(const reader_t *r, const char *section, const char *other)
{
    if (has(r, section) && !has(r, other)) {
        log_error("%s:%d: [%s] needs [%s]", PLACE(r, r->section_line[find_section(section)]), section, other);
        return false;
    }
    return true;
}

/* A load is the motor's torque or a column of the log. */
static bool check_load_source(const reader_t *r)
{
    bool is_from_log = r->scene->motion.kind == MOTION_LOG && !has(r, "rotor"), is_given = r->scene->load.column[0] != '\0';
    int line = r->section_line[find_section("load")], limit_line = r->key_line[find_key("load", "rotor_limit")];
    if (!is_from_log && !has(r, "rotor")) {
        log_error("%s:%d: [load] needs a [rotor], or [motion] kind = log with a column of the load", PLACE(r, line));
        return false;
    }
    if (is_from_log && limit_line != 0) {
        log_error("%s:%d: [load] rotor_limit has no meaning without a [rotor]", PLACE(r, limit_line));
        return false;
    }
    if (is_from_log && !is_given) {
        log_error("%s:%d: [load] has no key \"column\": which column of the log holds the load?", PLACE(r, line));
    } else if (is_given && !is_from_log) {
        log_error("%s:%d: [load] column has no meaning with a [rotor]", PLACE(r, r->key_line[find_key("load", "column")]));
    }
    return is_from_log == is_given;
}

static bool check_load(const reader_t *r)
{
    bool is_loaded = r->scene->friction.model == MODEL_LOADED;
    if (!needs(r, "load", "friction")) {
        return false;
    }
    if (is_loaded && !has(r, "load")) {
        log_error("%s:%d: [friction] model = loaded needs [load]", PLACE(r, friction_line(r, "model")));
        return false;
    }
    if (has(r, "load") && !is_loaded) {
        log_error("%s:%d: [load] has no meaning for model = %s", PLACE(r, r->section_line[find_section("load")]),
                  models[r->scene->friction.model].name);
        return false;
    }
    return !has(r, "load") || check_load_source(r);
}

static bool check_rotor(const reader_t *r)
{
    if (has(r, "rotor") && has(r, "motor") == has(r, "control")) {
        log_error("%s:%d: [rotor] needs one of [motor] and [control]", PLACE(r, r->section_line[find_section("rotor")]));
        return false;
    }
    if (has(r, "motor") && has(r, "motion")) {
        log_error("%s:%d: [motor] moves the shaft, so [motion] has no meaning",
                  PLACE(r, r->section_line[find_section("motion")]));
        return false;
    }
    return needs(r, "rotor", "friction") && needs(r, "motor", "rotor") && needs(r, "control", "rotor") &&
           needs(r, "control", "motion") && needs(r, "hand", "rotor");
}

/* The message prints the limit with 9 digits, and the printed number must be accepted. */
static const double LIMIT_ROUNDING = 1e-8;

static bool check_inertia(const reader_t *r)
{
    const scene_rotor_t *rotor = &r->scene->rotor;
    if (!has(r, "rotor")) {
        return true;
    }
    double least = dahl_rotor_least_inertia(rotor->viscous, rotor->sigma0, &r->scene->hand);
    if (rotor->inertia < least * (1 - LIMIT_ROUNDING)) {
        log_error("%s:%d: [rotor] inertia = %.9g: below %.9g, the least at which steps of %g us are stable with this"
                  " viscous, sigma0 and [hand]", PLACE(r, r->key_line[find_key("rotor", "inertia")]), rotor->inertia, least,
                  (double)ROTOR_STEP_US);
        return false;
    }
    return true;
}

static bool check_faults(const reader_t *r)
{
    double sum = 0;
    for (int i = 0; i < FAULT_KINDS; i++) {
        sum += r->scene->faults[i];
    }
    if (sum > 1) {
        log_error("%s:%d: [faults] rates add up to %.9g: above 1", PLACE(r, r->section_line[find_section("faults")]), sum);
        return false;
    }
    if (has(r, "faults") && !(r->scene->friction.max_step > 0)) {
        log_error("%s:%d: [faults] needs [friction] max_step, so that the node detects a glitch",
                  PLACE(r, r->section_line[find_section("faults")]));
        return false;
    }
    return true;
}

static void note_sections(const reader_t *r)
{
    scene_t *scene = r->scene;
    scene->has_friction = has(r, "friction");
    scene->has_motion = has(r, "motion");
    scene->has_status = has(r, "status");
    scene->has_rotor = has(r, "rotor");
    scene->has_motor = has(r, "motor");
    scene->has_control = has(r, "control");
    scene->has_faults = has(r, "faults");
    scene->has_load = has(r, "load");
    scene->has_hand = has(r, "hand");
}

static bool check_keys(const reader_t *r)
{
    for (int i = 0; i < KEYS; i++) {
        if (!check_key(r, i)) {
            return false;
        }
    }
    return true;
}

static bool check(reader_t *r)
{
    scene_t *scene = r->scene;
    note_sections(r);
    if (!scene->has_friction && !scene->has_motion) {
        log_error("%s: has neither [friction] nor [motion]", r->path);
        return false;
    }
    if (scene->has_motion && !find_kind(r)) {
        return false;
    }
    return check_keys(r) && check_rotor(r) && check_inertia(r) && check_faults(r) && (!scene->has_friction || check_friction(r))
           && check_load(r);
}

/* Read "section.key=value" in place of that key of the file. */
static bool apply_set(reader_t *r, const char *text)
{
    char section[32];
    char name[32];
    int used = 0;
    if (sscanf(text, "%31[a-z].%31[A-Za-z0-9_]=%n", section, name, &used) != 2 || used == 0) {
        log_error("--set %s: not section.key=value", text);
        return false;
    }
    int i = find_key(section, name);
    if (i >= 0) {
        r->key_line[i] = 0;
    }
    if (find_section(section) >= 0 && !has(r, section)) {
        r->section_line[find_section(section)] = present_line(r);
    }
    return on_key(r, section, name, text + used) == 1;
}

static bool apply_sets(reader_t *r, const char *const *sets, int count)
{
    bool is_good = true;
    r->is_set = true;
    for (r->line = 1; is_good && r->line <= count; r->line++) {
        is_good = apply_set(r, sets[r->line - 1]);
    }
    return is_good;
}

static void set_defaults(scene_t *scene)
{
    *scene = (scene_t){0};
    for (int i = 0; i < KEYS; i++) {
        if (keys[i].type == NUMBER || keys[i].type == WHOLE) {
            *(double *)(void *)((char *)scene + keys[i].offset) = keys[i].usual;
        }
    }
}

static bool note_element(const reader_t *r, double sigma0, double Fc)
{
    static const char *const remarks[] = {
        [DAHL_COUNTS_PER_TURN] = "more than a quarter turn; counts per turn in place of rad?",
        [DAHL_DEGREES_PER_COUNT] = "a whole number of counts per turn in degrees; it must be in rad",
        [DAHL_SHORT_PRESLIDING] = "16 presliding lengths Fc/sigma0 or more; degrees in place of rad?",
        [DAHL_LONG_PRESLIDING] = "Fc/sigma0 is 20 turns or more; sigma0 in N m/deg, or exchanged with Fc?",
    };
    const scene_friction_t *f = &r->scene->friction;
    const dahl_params_t params = {(float)sigma0, (float)Fc, (float)f->theta_per_count};
    const dahl_plausible_t remark = dahl_params_plausible(&params);
    if (remark == DAHL_PLAUSIBLE) {
        return false;
    }
    const bool is_long = remark == DAHL_LONG_PRESLIDING;
    const char *key = is_long ? "sigma0" : "theta_per_count";
    log_note("%s:%d: [friction] %s = %.9g: %s", PLACE(r, r->key_line[find_key("friction", key)]), key,
             is_long ? sigma0 : f->theta_per_count, remarks[remark]);
    return true;
}

/* Print the first probable mistake with a unit. The run goes on. */
static void note_units(const reader_t *r)
{
    const scene_friction_t *f = &r->scene->friction;
    for (uint32_t k = 0; k < f->Fc_of.count && !note_element(r, sigma0_of(f, k), f->Fc_of.value[k]); k++) {
    }
}

bool scene_read(scene_t *scene, const char *path, const char *const *sets, int count)
{
    reader_t reader = {.scene = scene, .path = path};
    set_defaults(scene);
    reader.file = fopen(path, "r");
    if (reader.file == NULL) {
        log_error("%s: %s", path, strerror(errno));
        return false;
    }
    bool is_good = parse(&reader) && apply_sets(&reader, sets, count) && check(&reader);
    fclose(reader.file);
    if (is_good) {
        note_units(&reader);
    }
    return is_good;
}
