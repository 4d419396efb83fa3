/* SPDX-License-Identifier: MIT */
/* Any bytes from a serial line. A second reader judges each line as a whole: its kind, answer, count and frame. Each frame is
 * written and read back. */
#include <stddef.h>

#include "fuzz.h"
#include "slcan/slcan.h"

typedef struct {
    slcan_event_t event;
    const char *answer;
    dahl_can_frame_t frame;
    int open; /* -1: unchanged */
} verdict_t;

static int hex_of(char c)
{
    const char *digits = "0123456789abcdef0123456789ABCDEF", *at = c == '\0' ? NULL : strchr(digits, c);
    return at == NULL ? -1 : (int)((at - digits) % 16);
}

/* The value of hex digits; -1 if one is missing or wrong. */
static int64_t number(const char *text, size_t length, size_t from, size_t digits)
{
    int64_t value = 0;
    for (size_t i = from; i < from + digits; i++) {
        if (i >= length || hex_of(text[i]) < 0) {
            return -1;
        }
        value = value * 16 + hex_of(text[i]);
    }
    return value;
}

static int read_data(const char *line, size_t length, size_t from, size_t bytes, dahl_can_frame_t *frame)
{
    for (size_t i = 0; i < bytes; i++) {
        int64_t byte = number(line, length, from + 2 * i, 2);
        if (byte < 0) {
            return 0;
        }
        frame->data[i < 8 ? i : 7] = i < 8 ? (uint8_t)byte : frame->data[7];
    }
    return length == from + 2 * bytes;
}

static int is_between(int64_t value, int64_t least, int64_t most)
{
    return value >= least && value <= most;
}

static int read_frame(const char *line, size_t length, dahl_can_frame_t *frame)
{
    static const uint8_t bytes[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    int extended = memchr("TRDB", line[0], 4) != NULL, remote = memchr("rR", line[0], 2) != NULL;
    int fd = memchr("dDbB", line[0], 4) != NULL;
    size_t digits = extended ? 8 : 3;
    int64_t id = number(line, length, 1, digits), count = number(line, length, 1 + digits, 1);
    if (!is_between(id, 0, extended ? 0x1FFFFFFF : 0x7FF) || !is_between(count, 0, fd ? 15 : 8)) {
        return 0;
    }
    *frame = (dahl_can_frame_t){.id = (uint32_t)id, .length = (uint8_t)(count < 8 ? count : 8)};
    frame->flags = (uint8_t)((extended ? DAHL_CAN_FRAME_EXTENDED : 0) | (remote ? DAHL_CAN_FRAME_REMOTE : 0) | (fd ? DAHL_CAN_FRAME_FD : 0));
    return remote ? length == 2 + digits : read_data(line, length, 2 + digits, bytes[count], frame);
}

static verdict_t judge_letter(char letter, int refused)
{
    const struct {
        char letter;
        const char *answer;
        int open;
    } letters[] = {{'O', "\r", 1},       {'L', "\r", 1},       {'C', "\r", 0},      {'V', "V0101\r", -1},
                   {'v', "v0101\r", -1}, {'N', "NDAHL\r", -1}, {'S', "\r", -1},     {'s', "\r", -1},
                   {'F', refused ? "F80\r" : "F00\r", -1}};
    for (size_t i = 0; i < sizeof letters / sizeof letters[0]; i++) {
        if (letters[i].letter == letter) {
            return (verdict_t){SLCAN_ANSWER, letters[i].answer, {0}, letters[i].open};
        }
    }
    return (verdict_t){SLCAN_ANSWER, "\a", {0}, -1};
}

static verdict_t judge(const char *line, size_t length, const slcan_t *now, int refused)
{
    verdict_t v = {SLCAN_ANSWER, "\a", {0}, -1};
    if (length == 1) {
        return judge_letter(line[0], refused);
    }
    if (length == 0 || (length <= SLCAN_LINE_MAX && memchr("Ss", line[0], 2) != NULL)) {
        v.answer = "\r";
    } else if (now->open && memchr("tTrRdDbB", line[0], 8) != NULL && read_frame(line, length, &v.frame)) {
        v.answer = "\r";
        v.event = SLCAN_FRAME;
    }
    return v;
}

static uint64_t refusals(const slcan_counts_t *n)
{
    return (uint64_t)n->too_long + n->cut + n->not_hex + n->wrong_length + n->unknown + n->closed;
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
        LAW(length == 0, "CAN FD is not written");
        return;
    }
    LAW(length > 0 && length < SLCAN_TEXT_MAX && line[length] == '\0', "a frame is written as a line");
    for (uint32_t i = 0; i < length; i++) {
        slcan_event_t event = slcan_take(&reader, (uint8_t)line[i], &back, answer);
        LAW(event == (i + 1 < length ? SLCAN_NOTHING : SLCAN_FRAME), "a written frame is one line");
    }
    LAW(is_same(&back, frame), "a written frame is read back");
}

static void check_line(const slcan_t *before, const slcan_t *after, const verdict_t *v, slcan_event_t event, const char *text,
                       const dahl_can_frame_t *frame)
{
    LAW(event == v->event && strcmp(text, v->answer) == 0, "the answer is that of the second reader");
    LAW(after->open == (v->open < 0 ? before->open : v->open != 0), "O and L open, C closes, other lines do neither");
    LAW(refusals(&after->counts) == refusals(&before->counts) + (v->answer[0] == '\a'), "a refusal increases one count");
    LAW(after->length == 0, "a line ends with its CR");
    if (event == SLCAN_FRAME) {
        LAW(is_same(frame, &v->frame) && frame->time_us == 0, "the frame is that of the second reader");
        check_written(frame);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    slcan_t self = {0};
    char line[SLCAN_LINE_MAX + 2];
    size_t length = 0;
    int refused = 0; /* since the last F */
    for (size_t i = 0; i < size; i++) {
        char text[SLCAN_TEXT_MAX];
        dahl_can_frame_t frame;
        const slcan_t before = self;
        slcan_event_t event = slcan_take(&self, data[i], &frame, text);
        if (data[i] == '\r') {
            verdict_t v = judge(line, length, &before, refused);
            check_line(&before, &self, &v, event, text, &frame);
            refused = v.answer[0] == '\a' || (refused && v.answer[0] != 'F');
            length = 0;
            continue;
        }
        LAW(event == SLCAN_NOTHING, "an answer comes at the end of a line");
        if (data[i] != '\n' && length < sizeof line) {
            line[length++] = (char)data[i];
        }
    }
    return 0;
}
