/* SPDX-License-Identifier: MIT */
/* fmu: one friction model in a simulator, for any version of FMI. A communication step moves the friction from the angle of the
 * last step to the present angle. Without damping its duration does not matter, so a step may be split.
 * `call` is the name of the FMI function and begins each message. Each bool is false after an error, which changes nothing. */
#ifndef FMU_H
#define FMU_H

#include <stddef.h>

#include "../simulators/friction.h"
#include "variables.h"

#if defined(_WIN32)
#define FMU_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define FMU_EXPORT __attribute__((visibility("default")))
#define FMU_PRINTF(text, first) __attribute__((format(printf, text, first)))
#else
#define FMU_EXPORT
#endif
#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter" /* the standard fixes the parameters */
#endif
#ifndef FMU_PRINTF
#define FMU_PRINTF(text, first)
#endif

/* Declare an exported function and begin its definition. */
#define FMU_FUNCTION(type, name, parameters)                                                                                   \
    FMU_EXPORT type name parameters;                                                                                           \
    FMU_EXPORT type name parameters
#define FMU_PASTE(prefix, name) prefix##name
#define FMU_NAME(prefix, name) FMU_PASTE(prefix, name)

/* Modes of an instance, in the order of a simulation. */
enum { FMU_INSTANTIATED, FMU_INITIALIZING, FMU_STEPPING, FMU_TERMINATED };

/* All that may change after the instantiation; the content of a saved state and of its serialized form. */
typedef struct {
    char guid[40]; /* a state of another FMU is rejected by it */
    uint64_t mode;
    double position; /* [rad], or [counts] if theta_per_count is not 0: where the last step ended */
    double value[FMU_VALUES];
    friction_state_t state;
} fmu_state_t;

typedef struct fmu fmu_t;

/* Sends a message to the simulator; it may change the text. */
typedef void fmu_log_t(const fmu_t *m, char *message);

typedef struct {
    fmu_log_t *log;
    void (*callback)(void); /* of the simulator, NULL if it has none; `log` knows its type */
    void *environment;      /* argument of the callback */
} fmu_logger_t;

struct fmu {
    fmu_logger_t logger;
    char name[64];
    fmu_start_t start;
    friction_t friction;
    double largest_torque; /* [N m] at load 1 */
    fmu_state_t now;
};

/* Send an error to the simulator in one line and return false. An instance that is NULL has no logger. */
FMU_PRINTF(2, 3)
bool fmu_fail(const fmu_t *m, const char *format, ...);

/* Return true if there are n = 0 variables, else send the reason and return false. */
bool fmu_deny(const fmu_t *m, const char *call, size_t n, const char *reason);

/* Return a new instance, or NULL if the GUID is wrong or `refusal` is not NULL; it is then the message. */
fmu_t *fmu_create(const char *call, const fmu_logger_t *logger, const volatile fmu_start_t *start, const char *name,
                  const char *guid, const char *refusal);
bool fmu_reset(fmu_t *m);
bool fmu_is_in_mode(const fmu_t *m, const char *call, uint64_t mode);
bool fmu_set_time(fmu_t *m, const char *call, double time);

/* Go from a mode to the next. */
bool fmu_advance(fmu_t *m, const char *call, uint64_t from);

bool fmu_get(const fmu_t *m, const char *call, const uint32_t vr[], size_t n, double value[]);
bool fmu_set(fmu_t *m, const char *call, const uint32_t vr[], size_t n, const double value[]); /* all values or none */
bool fmu_step(fmu_t *m, const char *call, double time, double duration);

bool fmu_save(const fmu_t *m, const char *call, void **state);
bool fmu_restore(fmu_t *m, const char *call, const void *state);
bool fmu_free_state(void **state);
bool fmu_state_size(const fmu_t *m, const char *call, size_t *size);
bool fmu_serialize(const fmu_t *m, const char *call, const void *state, void *bytes, size_t size);
bool fmu_deserialize(const fmu_t *m, const char *call, const void *bytes, size_t size, void **state);

#endif
