/* SPDX-License-Identifier: MIT */
/* dahl_encoder_move for any encoder, initialised or zero, and any reading. */
#include "library.c" /* the core, written by test_cbmc.py */

int32_t any_way(uint32_t before, uint32_t now, uint32_t modulus)
{
    int32_t way;
    (void)before;
    (void)now;
    (void)modulus;
    return way;
}

static dahl_encoder_t any_encoder(uint32_t modulus, int sign, uint32_t largest_step, int is_homed, uint32_t last)
{
    dahl_encoder_t encoder = {0};
    (void)!dahl_encoder_init(&encoder, modulus, sign, largest_step);
    if (is_homed) {
        dahl_encoder_home(&encoder, last);
    }
    return encoder;
}

void check_encoder_move(uint32_t modulus, int sign, uint32_t largest_step, int is_homed, uint32_t last, uint32_t jumps,
                        uint32_t reading)
{
    dahl_encoder_t encoder = any_encoder(modulus, sign, largest_step, is_homed, last), before;
    encoder.jumps = jumps;
    before = encoder;
    int64_t move = dahl_encoder_move(&encoder, reading);
    int64_t largest = before.largest_step;
    __CPROVER_assert(largest == 0 || (-largest <= move && move <= largest), "no motion beyond the largest step");
    __CPROVER_assert(move == 0 || (is_homed && before.sign != 0), "no motion from the first reading, or of zeros");
    int is_jump = before.primed && !encoder.primed;
    __CPROVER_assert(encoder.last == reading && encoder.primed == (before.sign != 0 && !is_jump), "the next move starts here");
    __CPROVER_assert(!is_jump || (move == 0 && encoder.reach == 0), "a jump is no motion, and the next reading a first one");
    __CPROVER_assert(encoder.jumps == before.jumps || (is_jump && encoder.jumps == before.jumps + 1), "jumps are counted");
    __CPROVER_assert(encoder.jumps >= before.jumps, "their number does not wrap");
}

/* If the modulus is 2^bits, the move is the low bits of the difference, as a signed number. */
void check_encoder_way(unsigned bits, int sign, uint32_t last, uint32_t reading)
{
    __CPROVER_assume(2 <= bits && bits <= 32 && (sign == 1 || sign == -1));
    uint32_t modulus = bits == 32 ? 0 : (uint32_t)1 << bits;
    dahl_encoder_t encoder = any_encoder(modulus, sign, 0, 1, last);
    int64_t wheel = (int64_t)1 << bits, way = (int64_t)((sign > 0 ? reading - last : last - reading) & (uint32_t)(wheel - 1));
    __CPROVER_assert(dahl_encoder_move(&encoder, reading) == (way < wheel / 2 ? way : way - wheel), "the shortest way");
}
