/* SPDX-License-Identifier: MIT */
/* Compile as a compiler without extensions (compiler.h, multiply.h, cpu_dispatch.h). The system's headers are read before,
 * because they need the extensions. -include puts this file before each source. */
#ifndef COVERAGE_PLAIN_H
#define COVERAGE_PLAIN_H

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#undef __GNUC__
#undef __SIZEOF_INT128__

#endif
