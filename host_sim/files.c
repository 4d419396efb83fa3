/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE
#include "files.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "stderr_messages.h"

int files_find_counts(char path[FILES_PATH], const char *run_file, const char *counts)
{
    const char *slash = strrchr(run_file, '/');
    int folder = slash == NULL || counts[0] == '/' ? 0 : (int)(slash - run_file) + 1;
    int length = snprintf(path, FILES_PATH, "%.*s%s", folder, run_file, counts);
    return length < (int)FILES_PATH ? 0 : log_error("%s: path too long", counts);
}

typedef struct {
    const char *option;
    const char *path; /* NULL or "": not used */
} named_t;

static bool stat_file(const named_t *file, struct stat *status)
{
    return file->path != NULL && file->path[0] != '\0' && stat(file->path, status) == 0;
}

static bool stat_folder(const char *path, struct stat *status)
{
    char folder[FILES_PATH];
    const char *slash = strrchr(path, '/');
    int length = snprintf(folder, sizeof folder, "%.*s", slash == NULL ? 1 : (int)(slash - path) + 1,
                          slash == NULL ? "." : path);
    return length < (int)sizeof folder && stat(folder, status) == 0;
}

static const char *name_in(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL ? path : slash + 1;
}

static bool is_same_inode(const struct stat *a, const struct stat *b)
{
    return a->st_dev == b->st_dev && a->st_ino == b->st_ino;
}

/* A file that does not exist yet is identified by its folder and its name. */
static bool is_same_path(const char *a, const char *b)
{
    struct stat one;
    struct stat other;
    return strcmp(name_in(a), name_in(b)) == 0 && stat_folder(a, &one) && stat_folder(b, &other) &&
           is_same_inode(&one, &other);
}

static bool is_same(const named_t *a, const named_t *b)
{
    struct stat one;
    struct stat other;
    bool has_a = stat_file(a, &one);
    bool is_used = a->path != NULL && b->path != NULL && a->path[0] != '\0';
    if (!is_used || has_a != stat_file(b, &other)) {
        return false;
    }
    if (!has_a) {
        return is_same_path(a->path, b->path);
    }
    return is_same_inode(&one, &other) && S_ISREG(one.st_mode);
}

static int check_one(const named_t *written, const named_t *others, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (is_same(written, &others[i])) {
            return log_error("%s %s: that is the file of %s %s", written->option, written->path, others[i].option,
                             others[i].path);
        }
    }
    return 0;
}

int files_check(const options_t *options, const char *counts)
{
    bool is_stdout = options->counters != NULL && strcmp(options->counters, "-") == 0;
    const named_t files[] = {{"run file", options->run_file},
                             {"counts", counts},
                             {"--log", options->log},
                             {"--trace", options->trace},
                             {"--counters", is_stdout ? NULL : options->counters}};
    for (size_t i = 2; i < sizeof files / sizeof files[0]; i++) {
        if (check_one(&files[i], files, i) != 0) {
            return -1;
        }
    }
    return 0;
}
