/* SPDX-License-Identifier: MIT */
/** Forms for several instruction sets. DAHL_VARIANTS(name, type, run_avx512, run_avx2, run_plain) defines
 * name(const type *job), which selects one of the three calls by the processor. All functions that they call must be
 * inlined: DAHL_INLINE, DAHL_FOUR (map_table.h) or DAHL_WIDE (wide.h). If the compiler does not support this, only
 * run_plain exists. */
#ifndef DAHL_CPU_DISPATCH_H
#define DAHL_CPU_DISPATCH_H

/* Before a loop. DAHL_AS_VECTORS: use vectors, do not unroll it to single steps. DAHL_UNROLL_8: unroll all of its at most 8
 * passes, which keeps small arrays in registers. DAHL_NO_UNROLL: keep its passes apart. */
#if defined(__GNUC__) && !defined(__clang__)
#define DAHL_AS_VECTORS _Pragma("GCC unroll 1") _Pragma("GCC ivdep")
#define DAHL_UNROLL_8 _Pragma("GCC unroll 8")
#define DAHL_NO_UNROLL _Pragma("GCC unroll 1")
#else
#define DAHL_AS_VECTORS
#define DAHL_UNROLL_8
#define DAHL_NO_UNROLL
#endif

#if defined(__GNUC__) && defined(__x86_64__)

#define DAHL_INLINE static inline __attribute__((always_inline))
#define DAHL_AVX2 __attribute__((target("avx2,fma")))
#define DAHL_AVX512 __attribute__((target("avx2,fma,avx512f,avx512bw,avx512dq,avx512vl")))
#ifndef DAHL_HAS_AVX2 /* 0 as a compiler flag measures the form without it; so does DAHL_HAS_AVX512 */
#define DAHL_HAS_AVX2 (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
#endif
#ifndef DAHL_HAS_AVX512
#define DAHL_HAS_AVX512 \
    (__builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
#endif

/* Let independent chains of AVX-512 take turns. With the 16 registers of AVX2 this would cost more than it saves. */
#if defined(__clang__)
#define DAHL_SCHEDULED
#else
#define DAHL_SCHEDULED __attribute__((optimize("schedule-insns", "sched-pressure")))
#endif

#define DAHL_VARIANTS(name, type, run_avx512, run_avx2, run_plain)                      \
    DAHL_AVX512 DAHL_SCHEDULED                                                          \
    static void name##_avx512(const type *job) { run_avx512; }                          \
    DAHL_AVX2 static void name##_avx2(const type *job) { run_avx2; }                    \
    static void name##_plain(const type *job) { run_plain; }                            \
    static void name(const type *job)                                                   \
    {                                                                                   \
        int wide = DAHL_HAS_AVX512 ? 2 : DAHL_HAS_AVX2;                                 \
        (wide == 2 ? name##_avx512 : wide == 1 ? name##_avx2 : name##_plain)(job);      \
    }

#elif defined(__GNUC__)

#define DAHL_INLINE static inline __attribute__((always_inline))
#define DAHL_VARIANTS(name, type, run_avx512, run_avx2, run_plain) \
    static void name(const type *job) { run_plain; }

#else

#define DAHL_INLINE static inline
#define DAHL_VARIANTS(name, type, run_avx512, run_avx2, run_plain) \
    static void name(const type *job) { run_plain; }

#endif

#endif
