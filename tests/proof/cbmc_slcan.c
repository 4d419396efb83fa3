/* SPDX-License-Identifier: MIT */
/*
 * The slcan parser: from any reachable state, any byte leads to a reachable state, without undefined behaviour, and the text
 * keeps its bounds. By induction this holds for any stream of bytes. Any frame, also an invalid one, is written within the
 * text.
 */
#include "slcan/slcan.c"

static bool is_slcan(const slcan_t *self)
{
    return self->length <= SLCAN_LINE_MAX + 1u;
}

void check_slcan_take(slcan_t self, uint8_t byte)
{
    dahl_can_frame_t frame;
    char text[SLCAN_TEXT_MAX];
    __CPROVER_assume(is_slcan(&self));
    slcan_event_t event = slcan_take(&self, byte, &frame, text);
    __CPROVER_assert(is_slcan(&self), "the state is reachable");
    if (event != SLCAN_NOTHING) {
        size_t length = strlen(text);
        __CPROVER_assert(1 <= length && length <= 6, "an answer of 1 to 6 characters");
    }
    if (event == SLCAN_FRAME) {
        __CPROVER_assert(frame.length <= 8 && frame.id <= 0x1FFFFFFFu, "a frame that a bus carries");
    }
}

void check_slcan_write(dahl_can_frame_t frame)
{
    char text[SLCAN_TEXT_MAX];
    uint32_t length = slcan_write(&frame, text);
    __CPROVER_assert(length < SLCAN_TEXT_MAX, "a line fits");
    __CPROVER_assert(length == 0 || text[length] == '\0', "a line is terminated");
}
