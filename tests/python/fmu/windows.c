/* SPDX-License-Identifier: MIT */
/* Run an FMU in Windows: windows.exe DLL VERSION GUID < ANGLES. It prints the bits of the torque after each angle [rad]. The
 * references of angle and torque are those of port/fmu/variables.h. */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <windows.h>

enum { ANGLE = 0, TORQUE = 2 };

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *allocate, *release, *finished, *environment;
} callbacks_t;
typedef void *make2_t(const char *, int, const char *, const char *, const callbacks_t *, int, int);
typedef int setup2_t(void *, int, double, double, int, double);
typedef int values2_t(void *, const unsigned *, size_t, double *);
typedef int step2_t(void *, double, double, int);
typedef void *make3_t(const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t, void *, void *,
                      void *);
typedef int enter3_t(void *, bool, double, double, bool, double);
typedef int values3_t(void *, const unsigned *, size_t, double *, size_t);
typedef int step3_t(void *, double, double, bool, bool *, bool *, bool *, double *);
typedef int plain_t(void *);

static HMODULE library;
static int version;
static void *fmu;

static void *function(const char *name)
{
    char full[64];
    snprintf(full, sizeof full, "fmi%d%s", version, name);
    void *found = (void *)GetProcAddress(library, full);
    if (found == NULL) {
        printf("no %s: error %lu\n", full, GetLastError());
        exit(1);
    }
    return found;
}

static int access(const char *verb, unsigned reference, double *value)
{
    char name[32];
    snprintf(name, sizeof name, "%s%s", verb, version == 2 ? "Real" : "Float64");
    return version == 2 ? ((values2_t *)function(name))(fmu, &reference, 1, value)
                        : ((values3_t *)function(name))(fmu, &reference, 1, value, 1);
}

static int start(const char *guid)
{
    static const callbacks_t callbacks;
    if (version == 2) {
        fmu = ((make2_t *)function("Instantiate"))("one", 1, guid, NULL, &callbacks, 0, 0);
        return ((setup2_t *)function("SetupExperiment"))(fmu, 0, 0, 0, 0, 0) |
               ((plain_t *)function("EnterInitializationMode"))(fmu);
    }
    make3_t *make = (make3_t *)function("InstantiateCoSimulation");
    fmu = make("one", guid, NULL, false, false, false, true, NULL, 0, NULL, NULL, NULL);
    return ((enter3_t *)function("EnterInitializationMode"))(fmu, false, 0, 0, false, 0);
}

static int step(void)
{
    bool flags[3];
    double last;
    return version == 2 ? ((step2_t *)function("DoStep"))(fmu, 0, 1e-3, 0)
                        : ((step3_t *)function("DoStep"))(fmu, 0, 1e-3, true, flags, flags + 1, flags + 2, &last);
}

int main(int argc, char **argv)
{
    double angle, torque;
    version = argc == 4 ? atoi(argv[2]) : 2;
    library = LoadLibraryA(argc == 4 ? argv[1] : "");
    int code = start(argv[3]) | ((plain_t *)function("ExitInitializationMode"))(fmu);
    while (scanf("%la", &angle) == 1) {
        uint64_t bits;
        code |= access("Set", ANGLE, &angle) | step() | access("Get", TORQUE, &torque);
        memcpy(&bits, &torque, 8);
        printf("%016llx\n", (unsigned long long)bits);
    }
    return code;
}
