/* SPDX-License-Identifier: MIT */
/* Any bytes from a serial line. A second reader judges each line as a whole: its kind, answer, count and frame. Each frame is
 * written and read back. */
#include <stddef.h>

#include "fuzz.h"
#include "slcan/slcan.h"

/* Members of slcan_counts_t, in their order. */
typedef enum { FINE = -1, TOO_LONG, CUT, NOT_HEX, WRONG_LENGTH, UNKNOWN, CLOSED, FAULTS } fault_t;

typedef struct {
    slcan_event_t event;
    fault_t fault; /* the first one of the line */
    const char *answer;
    dahl_can_frame_t frame;
    int open; /* -1: unchanged */
} verdict_t;

static int hex_of(char c)
{
    const char *digits = "0123456789abcdef0123456789ABCDEF", *at = c == '\0' ? NULL : strchr(digits, c);
    return at == NULL ? -1 : (int)((at - digits) % 16);
}

/* The value of hex digits; -CUT or -NOT_HEX for the first one that is missing or wrong. */
static int64_t number(const char *text, size_t length, size_t from, size_t digits)
{
    int64_t value = 0;
    for (size_t i = from; i < from + digits; i++) {
        if (i >= length || hex_of(text[i]) < 0) {
            return i >= length ? -CUT : -NOT_HEX;
        }
        value = value * 16 + hex_of(text[i]);
    }
    return value;
}

static fault_t read_data(const char *line, size_t length, size_t from, size_t bytes, dahl_can_frame_t *frame)
{
    for (size_t i = 0; i < bytes; i++) {
        int64_t byte = number(line, length, from + 2 * i, 2);
        if (byte < 0) {
            return (fault_t)-byte;
        }
        frame->data[i < 8 ? i : 7] = i < 8 ? (uint8_t)byte : frame->data[7];
    }
    return length == from + 2 * bytes ? FINE : WRONG_LENGTH;
}

static fault_t read_frame(const char *line, size_t length, dahl_can_frame_t *frame)
{
    static const uint8_t bytes[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    int extended = memchr("TRDB", line[0], 4) != NULL, remote = memchr("rR", line[0], 2) != NULL;
    int fd = memchr("dDbB", line[0], 4) != NULL;
    size_t digits = extended ? 8 : 3;
    int64_t id = number(line, length, 1, digits), count = number(line, length, 1 + digits, 1);
    if (id < 0 || (count < 0 && id <= (extended ? 0x1FFFFFFF : 0x7FF))) {
        return (fault_t)-(id < 0 ? id : count);
    }
    if (id > (extended ? 0x1FFFFFFF : 0x7FF) || count > (fd ? 15 : 8)) {
        return WRONG_LENGTH;
    }
    *frame = (dahl_can_frame_t){.id = (uint32_t)id, .length = (uint8_t)(count < 8 ? count : 8)};
    frame->flags = (uint8_t)((extended ? DAHL_CAN_FRAME_EXTENDED : 0) | (remote ? DAHL_CAN_FRAME_REMOTE : 0) | (fd ? DAHL_CAN_FRAME_FD : 0));
    return read_data(line, length, 2 + digits, remote ? 0 : bytes[count], frame);
}

static verdict_t judge_letter(char letter, int refused)
{
    const struct {
        char letter;
        const char *answer;
        int open;
    } letters[] = {{'O', "\r", 1},       {'L', "\r", 1},       {'C', "\r", 0},      {'V', "V0101\r", -1},
                   {'v', "v0101\r", -1}, {'N', "NDAHL\r", -1}, {'F', refused ? "F80\r" : "F00\r", -1}};
    for (size_t i = 0; i < sizeof letters / sizeof letters[0]; i++) {
        if (letters[i].letter == letter) {
            return (verdict_t){SLCAN_ANSWER, FINE, letters[i].answer, {0}, letters[i].open};
        }
    }
    return (verdict_t){SLCAN_ANSWER, UNKNOWN, "\a", {0}, -1};
}

static fault_t read_bit_rate(const char *line, size_t length)
{
    if (line[0] == 'S') {
        return length == 2 && line[1] != '\0' && strchr("0123456789", line[1]) != NULL ? FINE : UNKNOWN;
    }
    if (length == 1 || length > 9) {
        return UNKNOWN;
    }
    return number(line, length, 1, length - 1) < 0 ? NOT_HEX : FINE;
}

static verdict_t judge(const char *line, size_t length, const slcan_t *now, int refused)
{
    verdict_t v = {SLCAN_ANSWER, length > SLCAN_LINE_MAX ? TOO_LONG : UNKNOWN, "\r", {0}, -1};
    if (length == 0) {
        v.fault = FINE;
    } else if (length <= SLCAN_LINE_MAX && memchr("Ss", line[0], 2) != NULL) {
        v.fault = read_bit_rate(line, length);
    } else if (length <= SLCAN_LINE_MAX && memchr("tTrRdDbB", line[0], 8) != NULL) {
        v.fault = read_frame(line, length, &v.frame);
        v.fault = v.fault == FINE && !now->open ? CLOSED : v.fault;
        v.event = v.fault == FINE ? SLCAN_FRAME : SLCAN_ANSWER;
    } else if (length == 1) {
        return judge_letter(line[0], refused);
    }
    v.answer = v.fault == FINE ? "\r" : "\a";
    return v;
}

static int is_same(const dahl_can_frame_t *a, const dahl_can_frame_t *b)
{
    return a->id == b->id && a->flags == b->flags && a->length == b->length && memcmp(a->data, b->data, 8) == 0;
}

static void check_written(const dahl_can_frame_t *frame)
{
    slcan_t reader = {.open = true};
    char line[SLCAN_TEXT_MAX], answer[SLCAN_TEXT_MAX];
    dahl_can_frame_t back;
    uint32_t length = slcan_write(frame, line);
    if (frame->flags & DAHL_CAN_FRAME_FD) {
        HOLDS(length == 0, "CAN FD is not written");
        return;
    }
    HOLDS(length > 0 && length < SLCAN_TEXT_MAX && line[length] == '\0', "a frame is written as a line");
    for (uint32_t i = 0; i < length; i++) {
        slcan_event_t event = slcan_take(&reader, (uint8_t)line[i], &back, answer);
        HOLDS(event == (i + 1 < length ? SLCAN_NOTHING : SLCAN_FRAME), "a written frame is one line");
    }
    HOLDS(is_same(&back, frame), "a written frame is read back");
}

static void check_line(const slcan_t *before, const slcan_t *after, const verdict_t *v, slcan_event_t event, const char *text,
                       const dahl_can_frame_t *frame)
{
    HOLDS(event == v->event && strcmp(text, v->answer) == 0, "the answer is that of the second reader");
    HOLDS(after->open == (v->open < 0 ? before->open : v->open != 0), "O and L open, C closes, other lines do neither");
    uint32_t counts[FAULTS], counts_before[FAULTS];
    memcpy(counts, &after->counts, sizeof counts);
    memcpy(counts_before, &before->counts, sizeof counts);
    for (int i = 0; i < FAULTS; i++) {
        HOLDS(counts[i] == counts_before[i] + (i == (int)v->fault), "a refusal increases the count of the first fault");
    }
    HOLDS(after->length == 0, "a line ends with its CR");
    if (event == SLCAN_FRAME) {
        HOLDS(is_same(frame, &v->frame) && frame->time_us == 0, "the frame is that of the second reader");
        check_written(frame);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct {
        slcan_t adapter;
        uint8_t guard[8]; /* directly behind the line */
    } self = {.adapter = {.length = 0}};
    char line[SLCAN_LINE_MAX + 2];
    size_t length = 0;
    int refused = 0; /* since the last F */
    for (size_t i = 0; i < size; i++) {
        char text[SLCAN_TEXT_MAX];
        dahl_can_frame_t frame = {.id = UINT32_MAX};
        const slcan_t before = self.adapter;
        slcan_event_t event = slcan_take(&self.adapter, data[i], &frame, text);
        HOLDS(event == SLCAN_FRAME || frame.id == UINT32_MAX, "a line without a frame writes none");
        HOLDS(self.guard[0] == 0, "a long line stays within its buffer");
        if (data[i] == '\r') {
            verdict_t v = judge(line, length, &before, refused);
            check_line(&before, &self.adapter, &v, event, text, &frame);
            refused = v.answer[0] == '\a' || (refused && v.answer[0] != 'F');
            length = 0;
            continue;
        }
        HOLDS(event == SLCAN_NOTHING, "an answer comes at the end of a line");
        if (data[i] != '\n' && length < sizeof line) {
            line[length++] = (char)data[i];
        }
    }
    return 0;
}
