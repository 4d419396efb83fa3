/* SPDX-License-Identifier: MIT */
/* Model, names, limits and start values of the FMU (fmu_start_t in variables.h). `dahl fmu` writes this file for each FMU. */
#define FMU_START {"dahl fmu start", "", "dahl", 1, 1, 0, 0, {{"", 0, 0, 0}}}
