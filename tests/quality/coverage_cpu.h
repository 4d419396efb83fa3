/* SPDX-License-Identifier: MIT */
/* The environment answers for the processor in cpu_dispatch.h, so that one machine runs each branch. DAHL_CPU has the names of
 * the features. -include puts this file before each source. It includes no header, because a source may first define macros for the
 * system's headers. */
#ifndef COVERAGE_CPU_H
#define COVERAGE_CPU_H

char *getenv(const char *name);
char *strstr(const char *text, const char *part);

static inline int coverage_cpu(const char *feature)
{
    const char *features = getenv("DAHL_CPU");
    return features != 0 && strstr(features, feature) != 0;
}

#define __builtin_cpu_supports(feature) coverage_cpu(feature)

#endif
