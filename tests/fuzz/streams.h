/* SPDX-License-Identifier: MIT */
/* A file that is the fuzzer's input: readers are compiled with fopen renamed to play_fopen. And what they print on stderr. */
#ifndef FUZZ_STREAMS_H
#define FUZZ_STREAMS_H

#include "fuzz.h"

typedef struct {
    const uint8_t *data;
    size_t size;
    int open;
    int listens;
    char words[4096]; /* on stderr since streams_begin */
} streams_t;

extern streams_t streams;

void streams_listen(void);

static inline void streams_begin(const uint8_t *data, size_t size)
{
    streams_listen();
    streams.data = data;
    streams.size = size;
    memset(streams.words, 0, sizeof streams.words);
}

/* What every reader does: whole, or one line that says why not; and no file left open. */
static inline void streams_check(int good)
{
    size_t length = strlen(streams.words);
    LAW(streams.open == 0, "files are closed");
    LAW(good ? length == 0 : strncmp(streams.words, "error: ", 7) == 0, "whole, or one complaint");
    LAW(good || strchr(streams.words, '\n') == streams.words + length - 1, "a complaint is one line");
}

#endif
