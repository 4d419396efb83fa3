/* SPDX-License-Identifier: MIT */
/* Read each line by the table of run_keys.def, then check that each part has what it needs. */
#include "run_file.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lines.h"
#include "stderr_messages.h"

enum { SEGMENTS = MOTION_SEGMENTS, STEERING = MOTION_STEERING, COUNTS = MOTION_COUNTS, ANY = SEGMENTS | STEERING | COUNTS };

typedef enum { NUMBER, WHOLE, LIST, TEXT } value_type_t;
typedef enum { OPTIONAL, REQUIRED, OWN } need_t;

typedef struct {
    const char *section;
    const char *name; /* with its section */
    size_t offset;    /* of the value in run_t */
    value_type_t type;
    double low, high; /* of a number, both allowed */
    need_t need;
    double usual;   /* number if the key is absent */
    unsigned kinds; /* of motion that have the key */
} run_key_t;

/* NOLINTBEGIN(bugprone-macro-parentheses): offsetof() takes no parentheses around a member */
#define RUN_KEY(section, name, type, low, high, need, usual, kinds) \
    {#section, #section "." #name, offsetof(run_t, section.name), type, low, high, need, usual, kinds},
/* NOLINTEND(bugprone-macro-parentheses) */
#define RUN_OWN(name, low, high) {"friction", "friction." #name, offsetof(run_t, friction.own), NUMBER, low, high, OWN, 0, ANY},
#define RUN_FAULT(NAME, name) \
    {"faults", "faults." #name, offsetof(run_t, faults[FAULT_##NAME]), NUMBER, 0, 1, OPTIONAL, 0, ANY},
static const run_key_t keys[] = {
#include "run_keys.def"
};

typedef struct {
    const char *name, *needs; /* needs: sections, separated by blanks */
    size_t offset;            /* of its has_ in run_t */
} run_section_t;

#define RUN_SECTION(name, needs) {#name, needs, offsetof(run_t, has_##name)},
static const run_section_t sections[] = {
#include "run_keys.def"
};

enum { KEYS = sizeof keys / sizeof keys[0], SECTIONS = sizeof sections / sizeof sections[0] };

typedef struct {
    run_t *run;
    const char *path;
    int line;           /* present one */
    int key_line[KEYS]; /* 0: absent */
} reader_t;

/* name: of a section that exists. */
static bool *has_section(run_t *run, const char *name)
{
    int i = 0;
    while (i < SECTIONS - 1 && strcmp(sections[i].name, name) != 0) {
        i++;
    }
    return (bool *)((char *)run + sections[i].offset);
}

static int find_key(const char *name)
{
    int i = 0;
    while (i < KEYS && strcmp(keys[i].name, name) != 0) {
        i++;
    }
    return i;
}

static int line_of(const reader_t *r, const char *name)
{
    return r->key_line[find_key(name)];
}

/* --- values --------------------------------------------------------------------------------------------------------------- */

static bool read_number(const reader_t *r, const run_key_t *key, const char *value, double *to)
{
    char *end;
    double number = strtod(value, &end);
    bool is_decimal = value[strspn(value, "0123456789+-.eE")] == '\0';
    const char *why = end == value || *end != '\0' || !is_decimal || !isfinite(number) ? "not a finite decimal number"
                      : key->type == WHOLE && fabs(number - trunc(number)) > 0 ? "not a whole number" : NULL;
    if (why != NULL) {
        log_error("%s:%d: %s = %.80s: %s", r->path, r->line, key->name, value, why);
        return false;
    }
    if (number < key->low || number > key->high) {
        log_error("%s:%d: %s = %.80s: outside %.10g to %.10g", r->path, r->line, key->name, value, key->low, key->high);
        return false;
    }
    *to = number;
    return true;
}

static bool read_text(const reader_t *r, const run_key_t *key, const char *value, char *to)
{
    if (value[0] == '\0' || strlen(value) >= RUN_TEXT) {
        log_error("%s:%d: %s: %s", r->path, r->line, key->name, value[0] != '\0' ? "longer than 1023 bytes" : "empty");
        return false;
    }
    strcpy(to, value);
    return true;
}

static bool read_list(const reader_t *r, const run_key_t *key, const char *value, run_list_t *to)
{
    char copy[RUN_TEXT];
    char *rest = copy;
    if (!read_text(r, key, value, copy)) {
        return false;
    }
    for (char *word = strtok_r(copy, " \t", &rest); word != NULL; word = strtok_r(NULL, " \t", &rest)) {
        if (to->count == DAHL_SLIP_MAX) {
            log_error("%s:%d: %s = %.80s: more than %d numbers", r->path, r->line, key->name, value, DAHL_SLIP_MAX);
            return false;
        }
        if (!read_number(r, key, word, &to->value[to->count])) {
            return false;
        }
        to->count++;
    }
    return true;
}

static bool read_value(reader_t *r, int i, const char *value)
{
    const run_key_t *key = &keys[i];
    char *to = (char *)r->run + key->offset;
    if (r->key_line[i] != 0) {
        log_error("%s:%d: %s is given twice, first in line %d", r->path, r->line, key->name, r->key_line[i]);
        return false;
    }
    r->key_line[i] = r->line;
    *has_section(r->run, key->section) = true;
    switch (key->type) {
    case TEXT: return read_text(r, key, value, to);
    case LIST: return read_list(r, key, value, (run_list_t *)(void *)to);
    default: return read_number(r, key, value, (double *)(void *)to);
    }
}

/* --- lines ---------------------------------------------------------------------------------------------------------------- */

static const char BLANKS[] = " \t\r";

/* Remove blanks at both ends. */
static char *trim(char *text)
{
    text += strspn(text, BLANKS);
    size_t length = strlen(text);
    while (length > 0 && strchr(BLANKS, text[length - 1]) != NULL) {
        length--;
    }
    text[length] = '\0';
    return text;
}

static void cut_comment(char *line)
{
    for (size_t i = 0; line[i] != '\0'; i++) {
        if ((line[i] == '#' || line[i] == ';') && (i == 0 || strchr(BLANKS, line[i - 1]) != NULL)) {
            line[i] = '\0';
            return;
        }
    }
}

static bool read_line(reader_t *r, char *line)
{
    cut_comment(line);
    line = trim(line);
    char *equals = strchr(line, '=');
    if (line[0] == '\0') {
        return true;
    }
    if (equals == NULL) {
        log_error("%s:%d: %.80s: not section.key = value", r->path, r->line, line);
        return false;
    }
    *equals = '\0';
    const char *name = trim(line);
    int i = find_key(name);
    if (i == KEYS) {
        log_error("%s:%d: unknown key \"%.80s\"", r->path, r->line, name);
        return false;
    }
    return read_value(r, i, trim(equals + 1));
}

static bool read_lines(reader_t *r, lines_t *lines)
{
    int result = 1;
    while (result == 1) {
        result = lines_next(lines);
        r->line = (int)lines->line;
        if (result == 1 && !read_line(r, lines->text)) {
            return false;
        }
    }
    return result == 0;
}

/* --- the whole ------------------------------------------------------------------------------------------------------------ */

static bool find_kind(const reader_t *r)
{
    static const char *const names[] = {"segments", "steering", "counts"};
    run_motion_t *motion = &r->run->motion;
    for (unsigned i = 0; i < sizeof names / sizeof names[0]; i++) {
        if (strcmp(motion->kind, names[i]) == 0) {
            motion->number = (motion_kind_t)(1u << i);
            return true;
        }
    }
    log_error("%s:%d: motion.kind = %.80s: not one of segments, steering, counts", r->path, line_of(r, "motion.kind"), motion->kind);
    return false;
}

static bool check_keys(const reader_t *r)
{
    for (int i = 0; i < KEYS; i++) {
        const run_key_t *key = &keys[i];
        bool is_for_kind = key->kinds == ANY || (key->kinds & r->run->motion.number) != 0;
        if (*has_section(r->run, key->section) && key->need == REQUIRED && is_for_kind && r->key_line[i] == 0) {
            log_error("%s: %s is missing", r->path, key->name);
            return false;
        }
        if (!is_for_kind && r->key_line[i] != 0) {
            log_error("%s:%d: %s has no meaning for motion.kind = %s", r->path, r->key_line[i], key->name, r->run->motion.kind);
            return false;
        }
    }
    return true;
}

static bool check_needs(const reader_t *r, const run_section_t *section)
{
    char needs[80];
    char *rest = needs;
    snprintf(needs, sizeof needs, "%s", section->needs);
    for (char *word = strtok_r(needs, " ", &rest); word != NULL; word = strtok_r(NULL, " ", &rest)) {
        if (*has_section(r->run, section->name) && !*has_section(r->run, word)) {
            log_error("%s: %s needs %s", r->path, section->name, word);
            return false;
        }
    }
    return true;
}

/* What moves the shaft: a motion, a motor, or a controller that follows a motion. */
static bool check_motion(const reader_t *r)
{
    const run_t *run = r->run;
    if (!run->has_friction && !run->has_motion) {
        log_error("%s: has neither friction nor motion", r->path);
        return false;
    }
    if (run->has_rotor && run->has_motor == run->has_control) {
        log_error("%s: rotor needs one of motor and control", r->path);
        return false;
    }
    if (run->has_motor && run->has_motion) {
        log_error("%s: motor moves the shaft, so motion has no meaning", r->path);
        return false;
    }
    return true;
}

static bool check_sections(const reader_t *r)
{
    for (int i = 0; i < SECTIONS; i++) {
        if (!check_needs(r, &sections[i])) {
            return false;
        }
    }
    return check_motion(r);
}

/* The message prints the limit with 9 digits, and the printed number must be accepted. */
static const double LIMIT_ROUNDING = 1e-8;

static bool check_inertia(const reader_t *r)
{
    const run_rotor_t *rotor = &r->run->rotor;
    double least = dahl_rotor_least_inertia(rotor->viscous, rotor->sigma0, &r->run->hand);
    if (r->run->has_rotor && rotor->inertia < least * (1 - LIMIT_ROUNDING)) {
        log_error("%s:%d: rotor.inertia = %.9g: below %.9g, the least at which steps of %g us are stable with this viscous, sigma0"
                  " and hand", r->path, line_of(r, "rotor.inertia"), rotor->inertia, least, (double)ROTOR_STEP_US);
        return false;
    }
    return true;
}

typedef struct {
    const char *name;
    uint32_t sigma0, Fc; /* count of numbers; 0: one for each element */
    const char *own;     /* its own key; "friction." if it has none */
} model_row_t;

#define MODEL_ROW(name, NAME, Class, number, sigma0s, Fcs, plan, key, ...) {#name, sigma0s, Fcs, "friction." key},
static const model_row_t models[] = {DAHL_MODELS(MODEL_ROW)};
#define MODEL_NAME(name, ...) ", " #name
static const char model_names[] = DAHL_MODELS(MODEL_NAME);

static bool find_model(const reader_t *r)
{
    run_friction_t *f = &r->run->friction;
    for (int i = 0; i < RUN_MODELS; i++) {
        if (strcmp(f->model[0] == '\0' ? "dahl" : f->model, models[i].name) == 0) {
            f->number = (run_model_t)i;
            return true;
        }
    }
    log_error("%s:%d: friction.model = %.80s: not one of %s", r->path, line_of(r, "friction.model"), f->model, model_names + 2);
    return false;
}

static bool check_numbers_of_elements(const reader_t *r)
{
    const run_friction_t *f = &r->run->friction;
    uint32_t sigma0s = models[f->number].sigma0, Fcs = models[f->number].Fc;
    bool is_good = f->sigma0.count == (sigma0s == 0 ? f->Fc.count : sigma0s) && (Fcs == 0 || f->Fc.count == Fcs);
    if (!is_good) {
        log_error("%s:%d: friction.sigma0 has %u numbers and friction.Fc %u: not those of model %s", r->path,
                  line_of(r, "friction.Fc"), f->sigma0.count, f->Fc.count, models[f->number].name);
    }
    return is_good;
}

/* The model's own key must be there, and no key of another model. */
static bool check_own_keys(const reader_t *r)
{
    const model_row_t *model = &models[r->run->friction.number];
    for (const model_row_t *owner = models; owner < models + RUN_MODELS; owner++) {
        int i = find_key(owner->own);
        if (i < KEYS && owner == model && r->key_line[i] == 0) {
            log_error("%s: %s is missing: friction.model = %s needs it", r->path, owner->own, owner->name);
            return false;
        }
        if (i < KEYS && owner != model && r->key_line[i] != 0) {
            log_error("%s:%d: %s has no meaning for friction.model = %s", r->path, r->key_line[i], owner->own, model->name);
            return false;
        }
    }
    return true;
}

/* Read dahl or slip for each element of parallel. */
static bool read_kinds(const reader_t *r)
{
    run_friction_t *f = &r->run->friction;
    char copy[RUN_TEXT], *rest = copy;
    uint32_t count = 0;
    bool is_good = true;
    strcpy(copy, f->kinds);
    for (char *word = strtok_r(copy, " \t", &rest); word != NULL; word = strtok_r(NULL, " \t", &rest), count++) {
        is_good = is_good && (strcmp(word, "slip") == 0 || strcmp(word, "dahl") == 0);
        f->slips |= count < DAHL_SLIP_MAX && word[0] == 's' ? 1u << count : 0u;
    }
    is_good = is_good && count == f->Fc.count;
    if (!is_good) {
        log_error("%s:%d: friction.kinds = %.80s: not dahl or slip for each of %u elements", r->path, line_of(r, "friction.kinds"),
                  f->kinds, f->Fc.count);
    }
    return is_good;
}

static bool read_model(const reader_t *r)
{
    return find_model(r) && check_numbers_of_elements(r) && check_own_keys(r) &&
           (r->run->friction.number != MODEL_PARALLEL || read_kinds(r));
}

static bool check(const reader_t *r)
{
    const run_t *run = r->run;
    return (!run->has_motion || run->motion.kind[0] == '\0' || find_kind(r)) && check_keys(r) && check_sections(r) &&
           check_inertia(r) && (!run->has_friction || read_model(r));
}

static void set_defaults(run_t *run)
{
    *run = (run_t){0};
    for (int i = 0; i < KEYS; i++) {
        if (keys[i].type == NUMBER || keys[i].type == WHOLE) {
            *(double *)(void *)((char *)run + keys[i].offset) = keys[i].usual;
        }
    }
}

bool run_file_read(run_t *run, const char *path)
{
    reader_t reader = {.run = run, .path = path};
    lines_t lines;
    set_defaults(run);
    if (!lines_open(&lines, path)) {
        return false;
    }
    bool is_good = read_lines(&reader, &lines) && check(&reader);
    lines_close(&lines);
    return is_good;
}
