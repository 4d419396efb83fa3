/* SPDX-License-Identifier: MIT */
/*
 * What the proofs take for known of a product of two words, and no more: so they need no multiplication, which decision
 * procedures for bits are slow at. frama_products.c proves it of dahl_mul, over the integers; cbmc_ranges.h puts any number
 * that obeys it in the place of the product.
 */
#ifndef PRODUCTS_H
#define PRODUCTS_H

/* r = a b: at most all but one of either factor; at least half of either where the other has its top bit set. */
#define IS_LIKE_PRODUCT(r, a, b)                                                                                            \
    ((r) <= (a) * 0x100000000 - (a) && (r) <= (b) * 0x100000000 - (b) && ((b) < 0x80000000 || (r) >= (a) * 0x80000000) &&   \
     ((a) < 0x80000000 || (r) >= (b) * 0x80000000))

#endif
