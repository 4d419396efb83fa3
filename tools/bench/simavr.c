/* SPDX-License-Identifier: MIT */
/*
 * Count instructions, cycles and bytes of stack of single calls on an ATmega2560 of simavr. The image, its places and the output
 * are those of plugin.c; the least and the most cycles are equal, as an AVR has neither caches nor wait states. What the image
 * writes to the register GPIOR0 is copied to standard output. At `end` the run is over.
 *
 *   simavr_counts IMAGE SITE BACK MARK END COUNTS     (addresses in bytes)
 */
#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/sim_avr.h>
#include <simavr/sim_core.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_io.h>

enum { GPIOR0_ADDRESS = 0x3e, SITE = 0, BACK, MARK, END, PLACES };

#define MOST_CYCLES UINT64_C(20000000000)
#define ADDRESS_MASK (2u * 1024u * 1024u - 1u)

typedef struct {
    uint64_t cycles_before;
    unsigned count, address;
    uint16_t stack_pointer, last, lowest; /* at the call, after the last instruction, the lowest since the call */
    unsigned steady;                      /* instructions since the stack pointer changed */
    bool counting;
} call_t;

static void put(avr_t *avr, avr_io_addr_t address, uint8_t byte, void *user)
{
    (void)avr, (void)address, (void)user;
    putchar(byte);
}

static void silence(avr_t *avr, const int level, const char *format, va_list arguments)
{
    (void)avr;
    if (level <= LOG_ERROR) {
        vfprintf(stderr, format, arguments);
    }
}

static avr_t *load(const char *name)
{
    elf_firmware_t firmware = {0};
    avr_global_logger_set(silence);
    if (elf_read_firmware(name, &firmware) != 0) {
        return NULL;
    }
    avr_t *avr = avr_make_mcu_by_name("atmega2560");
    if (avr != NULL && avr_init(avr) == 0) {
        avr_load_firmware(avr, &firmware);
        avr_register_io_write(avr, GPIOR0_ADDRESS, put, NULL);
    }
    return avr;
}

/* Execute one instruction. */
static void step(avr_t *avr)
{
    avr->run_cycle_count = 1;
    avr->pc = avr_run_one(avr);
}

/* The instruction at `site` is the call, so counting begins behind it. */
static void begin(call_t *call, avr_t *avr)
{
    call->stack_pointer = call->last = call->lowest = _avr_sp_get(avr);
    step(avr);
    call->cycles_before = avr->cycle;
    call->address = avr->pc & ADDRESS_MASK;
    call->count = 0;
    call->counting = true;
}

static void end(call_t *call, const avr_t *avr, FILE *out)
{
    const uint64_t cycles = avr->cycle - call->cycles_before;
    fprintf(out, "%u %" PRIu64 " %" PRIu64 " %d %u\n", call->count, cycles, cycles, call->stack_pointer - call->lowest,
            call->address);
    call->counting = false;
}

/* A frame is made by a write of the high byte of the stack pointer, a restore of the flags and a write of the low byte: a value
 * in between is not counted. A push or a call moves the stack pointer by up to 3. */
static void count(call_t *call, avr_t *avr)
{
    const uint16_t stack_pointer = _avr_sp_get(avr);
    call->steady = stack_pointer == call->last ? call->steady + 1 : 0;
    const int fall = call->last - stack_pointer;
    const bool is_whole = call->steady >= 2 || (fall >= 1 && fall <= 3);
    if (is_whole && stack_pointer < call->lowest) {
        call->lowest = stack_pointer;
    }
    call->last = stack_pointer;
    call->count++;
}

static bool run(avr_t *avr, const uint32_t place[PLACES], FILE *out)
{
    call_t call = {0};
    while (avr->pc != place[END]) {
        if (avr->cycle > MOST_CYCLES || avr->state == cpu_Crashed) {
            return false;
        }
        if (avr->pc == place[SITE]) {
            begin(&call, avr);
        }
        if (call.counting && avr->pc == place[BACK]) {
            end(&call, avr, out);
        }
        if (avr->pc == place[MARK]) {
            fputs("-\n", out);
        }
        step(avr);
        if (call.counting) {
            count(&call, avr);
        }
    }
    return true;
}

int main(int argc, char **argv)
{
    uint32_t place[PLACES];
    if (argc != 3 + PLACES) {
        return 2;
    }
    for (int i = 0; i < PLACES; i++) {
        place[i] = (uint32_t)strtoul(argv[2 + i], NULL, 0);
    }
    avr_t *avr = load(argv[1]);
    FILE *out = fopen(argv[2 + PLACES], "w");
    if (avr == NULL || out == NULL) {
        fprintf(stderr, "error: %s: not an image for an ATmega2560\n", argv[1]);
        return 1;
    }
    const bool ended = run(avr, place, out);
    return fclose(out) == 0 && ended ? 0 : 70;
}
