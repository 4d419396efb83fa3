/* SPDX-License-Identifier: MIT */
/* Types of the FMI 2.0 standard (section 2.1), platform "default", for co-simulation. If fmi2Functions.h of the standard is
 * included first, its declarations are used and the compiler compares them with ours. */
#ifndef DAHL_FMI2_H
#define DAHL_FMI2_H

#include <stddef.h>

#ifndef fmi2Functions_h
typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String instance, fmi2Status, fmi2String category, fmi2String message, ...);
    void *(*allocateMemory)(size_t count, size_t size);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
#endif

#if defined(_WIN32)
#define FMI2_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI2_EXPORT __attribute__((visibility("default")))
#define FMI2_PRINTF(text, first) __attribute__((format(printf, text, first)))
#else
#define FMI2_EXPORT
#endif
#ifndef FMI2_PRINTF
#define FMI2_PRINTF(text, first)
#endif

/* A tool that links several source FMUs into one program defines FMI2_FUNCTION_PREFIX as MODELIDENTIFIER_. */
#ifndef FMI2_FUNCTION_PREFIX
#define FMI2_FUNCTION_PREFIX
#endif
#define FMI2_PASTE(prefix, name) prefix##name
#define FMI2_NAME(prefix, name) FMI2_PASTE(prefix, name)

/* Declare an exported function and begin its definition. */
#define FMI2_FUNCTION(type, name, ...)                                                                                         \
    FMI2_EXPORT type FMI2_NAME(FMI2_FUNCTION_PREFIX, name)(__VA_ARGS__);                                                       \
    FMI2_EXPORT type FMI2_NAME(FMI2_FUNCTION_PREFIX, name)(__VA_ARGS__)

#endif
