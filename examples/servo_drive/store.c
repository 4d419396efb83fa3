/* SPDX-License-Identifier: MIT */
#include "store.h"

#include <stddef.h>
#include <string.h>

#include "board.h"

#define LAYOUT 0x53560001u /* change it with store_params_t */
#define ERASED 0xFFFFFFFFu

typedef struct {
    uint32_t layout, sequence;
    store_params_t params;
    uint32_t crc; /* of all before */
} record_t;

static uint32_t newest_slot = 1, newest_sequence; /* the first save goes to slot 0 */

uint32_t store_crc(const void *from, uint32_t bytes)
{
    const uint8_t *byte = from;
    uint32_t crc = 0xFFFFFFFFu;
    for (uint32_t k = 0; k < 8 * bytes; k++) {
        crc ^= k % 8 == 0 ? byte[k / 8] : 0u;
        crc = crc >> 1 ^ ((crc & 1u) != 0 ? 0xEDB88320u : 0u);
    }
    return ~crc;
}

static bool read_record(uint32_t slot, record_t *record)
{
    board_flash_read(slot, record, sizeof *record);
    return record->layout == LAYOUT && record->crc == store_crc(record, offsetof(record_t, crc));
}

store_result_t store_load(store_params_t *params)
{
    uint32_t good = 0, damaged = 0;
    for (uint32_t slot = 0; slot < BOARD_SLOTS; slot++) {
        record_t record;
        if (!read_record(slot, &record)) {
            damaged += record.layout != ERASED;
        } else if (good++ == 0 || (int32_t)(record.sequence - newest_sequence) > 0) {
            newest_slot = slot;
            newest_sequence = record.sequence;
            *params = record.params;
        }
    }
    return damaged == 0 ? (good > 0 ? STORE_GOOD : STORE_EMPTY) : (good > 0 ? STORE_TORN : STORE_CORRUPT);
}

bool store_save(const store_params_t *params)
{
    uint32_t slot = BOARD_SLOTS - 1 - newest_slot;
    record_t record = {.layout = LAYOUT, .sequence = newest_sequence + 1, .params = *params}, copy;
    record.crc = store_crc(&record, offsetof(record_t, crc));
    board_flash_write(slot, &record, sizeof record);
    if (!read_record(slot, &copy) || memcmp(&copy, &record, sizeof record) != 0) {
        return false;
    }
    newest_slot = slot;
    newest_sequence = record.sequence;
    return true;
}
