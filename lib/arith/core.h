/* SPDX-License-Identifier: MIT */
/** Target core, from the macros of the compiler. Preprocessor lines only: assembly includes them too. */
#ifndef DAHL_CORE_H
#define DAHL_CORE_H

/** ARMv6-M and ARMv8-M Baseline have only a 32-bit product, and eight registers for most instructions. */
#if defined(__GNUC__) && (defined(__ARM_ARCH_6M__) || defined(__ARM_ARCH_8M_BASE__))
#define DAHL_V6M 1
#else
#define DAHL_V6M 0
#endif

/** ARMv7-M, ARMv7E-M and ARMv8-M Mainline have all of Thumb-2. */
#if defined(__GNUC__) && !DAHL_V6M && defined(__ARM_ARCH_PROFILE)
#define DAHL_THUMB2 (__ARM_ARCH_PROFILE == 'M')
#else
#define DAHL_THUMB2 0
#endif

/** An assembly tick must know whether a float is returned in r0 or in s0. Some builds pass -mfloat-abi to C
 * only. A missing macro thus proves r0 only on ARMv7-M, which has no FPU, or if both get the same flags
 * (DAHL_SAME_FLAGS). */
#if defined(__ARM_PCS_VFP) || defined(__ARM_ARCH_7M__) || defined(DAHL_SAME_FLAGS)
#define DAHL_THUMB2_FLOAT DAHL_THUMB2
#else
#define DAHL_THUMB2_FLOAT 0
#endif

#endif
