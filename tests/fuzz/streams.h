/* SPDX-License-Identifier: MIT */
/* A file whose content is the fuzzer's input, and the text that a reader prints on stderr. fopen is renamed to play_fopen. */
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

/* Each reader refuses a file with one line, or accepts all of it, perhaps with a note on its units; it closes the file. */
static inline void streams_check(int good)
{
    size_t length = strlen(streams.words);
    HOLDS(streams.open == 0, "files are closed");
    HOLDS(good ? length == 0 || strncmp(streams.words, "note: ", 6) == 0 : strncmp(streams.words, "error: ", 7) == 0,
          "a refused file prints an error, an accepted one nothing or a note");
    HOLDS(good || strchr(streams.words, '\n') == streams.words + length - 1, "an error is one line");
}

#endif
