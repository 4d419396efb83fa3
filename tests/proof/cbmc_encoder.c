/* SPDX-License-Identifier: MIT */
/* dahl_encoder_move for any encoder, also one that no init made, any reading, and any way between two readings. */
#include "lib/model/encoder.c"

int32_t any_way(uint32_t before, uint32_t now, uint32_t modulus)
{
    int32_t way;
    (void)before;
    (void)now;
    (void)modulus;
    return way;
}

void check_encoder_move(dahl_encoder_t encoder, uint32_t reading)
{
    dahl_encoder_t before = encoder;
    int64_t move = dahl_encoder_move(&encoder, reading);
    int64_t largest = before.largest_step;
    __CPROVER_assert(largest == 0 || (-largest <= move && move <= largest), "no motion beyond the largest step");
    __CPROVER_assert(move == 0 || (before.primed && before.sign != 0), "no motion from the first reading, or of zeros");
    __CPROVER_assert(encoder.last == reading && encoder.primed, "the next move starts at this reading");
    __CPROVER_assert(encoder.jumps == before.jumps || (move == 0 && encoder.jumps == before.jumps + 1), "a jump is no motion");
    __CPROVER_assert(encoder.jumps >= before.jumps, "and their number never wraps");
}
