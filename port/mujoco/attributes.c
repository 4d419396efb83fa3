/* SPDX-License-Identifier: MIT */
/* attributes: see attributes.h. */
#include "attributes.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WORD_SIZE 64            /* [byte] longest word of a list, with its final 0 */
#define PARAM_MIN 0x1p-64       /* as in dahl_prepare() */
#define PARAM_MAX 0x1.fffffep63 /* largest float below 2^64 */

/* A number, or a list of them. */
typedef struct {
    const char *key;
    const char *model; /* the only one with this key; NULL: any model */
    bool is_needed;
    uint32_t max_values;
    double low, high; /* both allowed */
    size_t offset;    /* of a float or an array, in instance_t */
} range_t;

enum { SIGMA0, FC, THETA, FULL, REST, DAMPRATIO, RANGES };
#define MEMBER(name) offsetof(instance_t, name)
/* full and rest as in host_sim/keys.csv */
static const range_t ranges[RANGES] = {
    [SIGMA0] = {"sigma0", NULL, true, DAHL_SLIP_MAX, PARAM_MIN, PARAM_MAX, MEMBER(friction.params.each.sigma0)},
    [FC] = {"Fc", NULL, true, DAHL_SLIP_MAX, PARAM_MIN, PARAM_MAX, MEMBER(friction.params.each.Fc)},
    [THETA] = {"theta_per_count", NULL, false, 1, PARAM_MIN, PARAM_MAX, MEMBER(friction.params.each.theta_per_count)},
    [FULL] = {"full", "loaded", true, 1, 1e-9, 1e12, MEMBER(full)},
    [REST] = {"rest", "loaded", false, 1, 0.0, 1.0, MEMBER(rest)},
    [DAMPRATIO] = {"dampratio", NULL, false, 1, 0.0, 1.0, MEMBER(dampratio)},
};

typedef struct {
    const mjModel *m;
    mjData *d;
    int instance;
} config_t;

/* Free d as MuJoCo does if init() of an instance fails, and the instances before it, which MuJoCo would lose. */
static void free_data(mjData *d, int instance)
{
    for (int i = 0; i < instance; i++) {
        const mjpPlugin *plugin = mjp_getPluginAtSlot(d->plugin[i]);
        if (plugin->destroy != NULL) {
            plugin->destroy(d, i);
        }
    }
    mju_free(d->buffer);
    mju_free(d->arena);
    mju_free(d);
}

/* mju_error() does not return: it jumps to the compiler of models or to Python, or it ends the program. */
mjPRINTFLIKE(2, 3) static void fail(const config_t *c, const char *format, ...)
{
    char text[500];
    const char *name = mj_id2name(c->m, mjOBJ_PLUGIN, c->instance);
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    free_data(c->d, c->instance);
    mju_error("dahl.friction '%s': %s", name != NULL ? name : "", text);
}

/* Return the text of an attribute, "" if it is absent. */
static const char *text_of(const config_t *c, const char *key)
{
    return mj_getPluginConfig(c->m, c->instance, key);
}

/* Copy the next word and advance the text behind it. Return false at the end. */
static bool next_word(const char **text, char word[WORD_SIZE])
{
    int length = 0;
    if (sscanf(*text, "%63s%n", word, &length) != 1) {
        return false;
    }
    *text += length;
    return true;
}

/* Return true if the attribute has a word. */
static bool is_given(const config_t *c, const char *key)
{
    char word[WORD_SIZE];
    const char *text = text_of(c, key);
    return next_word(&text, word);
}

/* Return the number of values. */
static uint32_t read_numbers(const config_t *c, const range_t *range, float *to)
{
    const char *text = text_of(c, range->key);
    char word[WORD_SIZE], *end;
    uint32_t count = 0;
    while (next_word(&text, word)) {
        const double value = strtod(word, &end);
        if (*end != '\0') {
            fail(c, "%s = %s is not a number; separate several by blanks", range->key, word);
        }
        if (!(value >= range->low && value <= range->high)) {
            fail(c, "%s = %s is outside %g .. %g", range->key, word, range->low, range->high);
        }
        if (count == range->max_values) {
            fail(c, "%s = %s has more than %u values", range->key, text_of(c, range->key), range->max_values);
            return 0;
        }
        to[count++] = (float)value;
    }
    return count;
}

static void check_owner(const config_t *c, const char *model, const char *key, const char *owner, bool is_needed)
{
    const bool is_owner = owner == NULL || strcmp(owner, model) == 0;
    if (is_given(c, key) && !is_owner) {
        fail(c, "%s = %s is for model = %s, not for %s", key, text_of(c, key), owner, model);
    }
    if (is_needed && is_owner && !is_given(c, key)) {
        fail(c, "model = %s needs %s", model, key);
    }
}

/* Return the number of words of `kinds`, and set the bit of each slip element. */
static uint32_t read_kinds(const config_t *c, friction_t *f)
{
    const char *text = text_of(c, "kinds");
    char word[WORD_SIZE];
    uint32_t count = 0;
    for (; next_word(&text, word); count++) {
        const bool is_slip = strcmp(word, "slip") == 0;
        if (!is_slip && strcmp(word, "dahl") != 0) {
            fail(c, "kinds = %s: %s is neither dahl nor slip", text_of(c, "kinds"), word);
        }
        if (count == DAHL_SLIP_MAX) {
            fail(c, "kinds = %s has more than %u words", text_of(c, "kinds"), (unsigned)DAHL_SLIP_MAX);
            return 0;
        }
        f->params.slips |= (uint32_t)is_slip << count;
    }
    return count;
}

/* Check the numbers of sigma0, Fc and kinds against the model. */
static void check_counts(const config_t *c, const friction_model_t *model, uint32_t sigma0s, uint32_t Fcs, uint32_t kinds)
{
    const dahl_model_q30_t *calls = model->calls->q30;
    const uint32_t needed_Fcs = calls->Fcs != 0 ? calls->Fcs : Fcs;
    const uint32_t needed_sigma0s = calls->sigma0s != 0 ? calls->sigma0s : Fcs;
    if (sigma0s != needed_sigma0s || Fcs != needed_Fcs) {
        fail(c, "model = %s does not fit %u sigma0 and %u Fc", model->name, sigma0s, Fcs);
    }
    if (kinds != 0 && kinds != Fcs) {
        fail(c, "kinds = %s has %u words for %u Fc", text_of(c, "kinds"), kinds, Fcs);
    }
}

static void read_range(const config_t *c, instance_t *self, const range_t *range, uint32_t *count)
{
    check_owner(c, friction_models[self->friction.model].name, range->key, range->model, range->is_needed);
    *count = read_numbers(c, range, (float *)(void *)((char *)self + range->offset));
}

/* Read the own keys of all models. That of another model is refused. */
static void read_own_keys(const config_t *c, instance_t *self)
{
    for (uint32_t i = 0; i < FRICTION_MODELS; i++) {
        const friction_model_t *owner = &friction_models[i];
        const range_t own = {owner->key, owner->name, true, 1, owner->low, owner->high, MEMBER(friction.params.own)};
        uint32_t count;
        if (owner->high > 0) {
            read_range(c, self, &own, &count);
        } else if (owner->key[0] != '\0') {
            check_owner(c, friction_models[self->friction.model].name, owner->key, owner->name, true);
        }
    }
}

static void read_friction(const config_t *c, instance_t *self)
{
    friction_t *f = &self->friction;
    const friction_model_t *model = &friction_models[f->model];
    uint32_t counts[RANGES];
    for (int i = 0; i < RANGES; i++) {
        read_range(c, self, &ranges[i], &counts[i]);
    }
    read_own_keys(c, self);
    check_counts(c, model, counts[SIGMA0], counts[FC], read_kinds(c, f));
    f->params.each.elements = counts[FC];
    if (friction_prepare(f) != DAHL_OK) {
        fail(c, "theta_per_count = %g is outside 2^-30 .. 2^20 of Fc/sigma0", (double)f->params.each.theta_per_count);
    }
}

/* Return the id of the joint or tendon that an attribute names; -1 if the attribute is absent. */
static int find_object(const config_t *c, int type, const char *key)
{
    const char *name = text_of(c, key);
    const int id = mj_name2id(c->m, type, name);
    if (*name != '\0' && id < 0) {
        fail(c, "%s = %s is not in the model", key, name);
    }
    return id;
}

/* Refuse a second friction, which the user forgot to remove. */
static void check_frictionloss(const config_t *c, const instance_t *self)
{
    const char *key = self->joint >= 0 ? "joint" : "tendon";
    const double loss = self->joint >= 0 ? c->m->dof_frictionloss[c->m->jnt_dofadr[self->joint]]
                                         : c->m->tendon_frictionloss[self->tendon];
    if (loss > 0.0) {
        fail(c, "%s = %s also has frictionloss = %g, which would add to Fc; set it to 0", key, text_of(c, key), loss);
    }
}

static void read_object(const config_t *c, instance_t *self)
{
    self->joint = find_object(c, mjOBJ_JOINT, "joint");
    self->tendon = find_object(c, mjOBJ_TENDON, "tendon");
    if ((self->joint < 0) == (self->tendon < 0)) {
        fail(c, "needs either joint or tendon");
    }
    if (self->joint >= 0 && c->m->jnt_type[self->joint] != mjJNT_HINGE && c->m->jnt_type[self->joint] != mjJNT_SLIDE) {
        fail(c, "joint = %s is neither a hinge nor a slide", text_of(c, "joint"));
    }
    if (self->tendon >= 0 && self->friction.model == FRICTION_LOADED) {
        fail(c, "tendon = %s: model = loaded needs a joint", text_of(c, "tendon"));
    }
    check_frictionloss(c, self);
}

int attributes_list(const char *names[ATTRIBUTES_MAX])
{
    int count = 0;
    names[count++] = "joint";
    names[count++] = "tendon";
    names[count++] = "model";
    for (int i = 0; i < RANGES; i++) {
        names[count++] = ranges[i].key;
    }
    for (uint32_t i = 0; i < FRICTION_MODELS; i++) {
        if (friction_models[i].key[0] != '\0') {
            names[count++] = friction_models[i].key;
        }
    }
    return count;
}

uint32_t attributes_read_model(const mjModel *m, int instance)
{
    const char *name = mj_getPluginConfig(m, instance, "model");
    return *name != '\0' ? friction_find(name) : FRICTION_DAHL;
}

#define NAME(name, ...) " " #name

void attributes_read(const mjModel *m, mjData *d, int instance, instance_t *self)
{
    const config_t c = {m, d, instance};
    *self = (instance_t){.friction.model = attributes_read_model(m, instance)};
    if (self->friction.model == FRICTION_MODELS) {
        fail(&c, "model = %s is none of" DAHL_MODELS(NAME), text_of(&c, "model"));
        return;
    }
    read_object(&c, self);
    read_friction(&c, self);
}
