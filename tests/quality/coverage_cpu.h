/* SPDX-License-Identifier: MIT */
/* What cpu_dispatch.h asks of the processor, answered by the environment: so that one machine takes every road of it.
 * DAHL_CPU holds the names of the features that there are. Put before each source by -include; so it includes nothing itself,
 * since a source may first define what it wants of the system's headers. */
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
