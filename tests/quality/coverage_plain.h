/* SPDX-License-Identifier: MIT */
/* The forms that a compiler without extensions takes (compiler.h, multiply.h, cpu_dispatch.h). What the system's headers
 * need of the compiler is read before. Put before each source by -include. */
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
