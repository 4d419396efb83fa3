/* SPDX-License-Identifier: MIT */
/* The product of lib/multiply.h does what products.h says of it: for the WP plug-in of Frama-C, over the integers. */
#include <stdint.h>
#include "products.h"

/*@ assigns \nothing;
    ensures \result == a * b;
    ensures IS_LIKE_PRODUCT(\result, a, b); */
static inline uint64_t dahl_mul(uint32_t a, uint32_t b);

#include "multiply.h"
