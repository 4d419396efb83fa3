/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE
#include "files.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "stderr_messages.h"

/* Length of the folder part of a path, with its last slash. */
static int folder_length(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL ? 0 : (int)(slash - path) + 1;
}

int files_find_log(char path[FILES_PATH], const options_t *options, const scene_t *scene)
{
    const char *file = options->log_file != NULL ? options->log_file : scene->motion.file;
    const char *folder = options->data != NULL ? options->data : options->scene;
    int length = options->data != NULL ? (int)strlen(folder) : folder_length(folder);
    path[0] = '\0';
    if (!scene->has_motion || scene->motion.kind != MOTION_LOG) {
        return 0;
    }
    if (options->log_file != NULL || file[0] == '/') {
        length = 0;
    }
    bool is_joined = length == 0 || folder[length - 1] == '/';
    length = snprintf(path, FILES_PATH, "%.*s%s%s", length, folder, is_joined ? "" : "/", file);
    return length < (int)FILES_PATH ? 0 : log_error("%s: path too long", file);
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
    if (a->path == NULL || b->path == NULL || has_a != stat_file(b, &other)) {
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

int files_check(const options_t *options, const char *measured_log)
{
    bool is_stdout = options->summary != NULL && strcmp(options->summary, "-") == 0;
    const named_t files[] = {{"--scene", options->scene},
                             {"the measured log", measured_log},
                             {"--log", options->log},
                             {"--trace", options->trace},
                             {"--summary", is_stdout ? NULL : options->summary}};
    for (size_t i = 2; i < sizeof files / sizeof files[0]; i++) {
        if (check_one(&files[i], files, i) != 0) {
            return -1;
        }
    }
    return 0;
}
