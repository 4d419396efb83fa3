/* SPDX-License-Identifier: MIT */
/*
 * The board in QEMU, in step with shaft.py: each tick sends torque and frames, then waits for the encoder and frames, through
 * QEMU's standard input and output by semihosting. The flash is the file flash.bin. The tick is a real interrupt: SysTick,
 * pended by software. The watchdog counts ticks. A word can be read and written by address, to measure the stack and to damage
 * memory.
 */
#include <string.h>

#include "board.h"
#include "cortex_m.h"
#include "drive.h"
#include "semihosting.h"

#define PEND_SYSTICK (1u << 26)
#define INTERRUPT_STATE CORTEX_REGISTER(0xE000ED04u)
enum { SYS_OPEN = 1, SYS_CLOSE = 2, SYS_WRITE = 5, SYS_READ = 6, SYS_SEEK = 10, READ = 1, UPDATE = 3, APPEND = 4 };
enum { FRAMES = 8, SLOT_BYTES = 256, WATCHDOG_TICKS = 20, WATCHDOG_STATUS = 3 };

typedef struct {
    uint8_t id[2], length, data[8], unused;
} wire_frame_t;

static struct {
    uint8_t encoder[BOARD_SPI_BYTES];
    uint32_t cause;      /* board_reset_t */
    uint32_t is_stalled; /* the main program hangs: only ticks run */
    uint32_t address, value, is_written;
    uint32_t count;
    wire_frame_t frames[FRAMES];
} in;

static struct {
    float torque;
    uint32_t word; /* at the address of the last input */
    uint32_t count;
    wire_frame_t frames[FRAMES];
} out;

static int32_t input, output;
static wire_frame_t received[FRAMES];
static uint32_t first_received, end_received, unfed_ticks;

static int32_t host(uint32_t operation, uintptr_t a, uintptr_t b, uintptr_t c)
{
    const uintptr_t block[] = {a, b, c};
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = block;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return (int32_t)r0;
}

static int32_t open(const char *name, uintptr_t mode)
{
    return host(SYS_OPEN, (uintptr_t)name, mode, strlen(name));
}

/* Without a shaft the power is off. */
static void exchange(void)
{
    if (host(SYS_WRITE, (uintptr_t)output, (uintptr_t)&out, sizeof out) != 0
        || host(SYS_READ, (uintptr_t)input, (uintptr_t)&in, sizeof in) != 0) {
        semihosting_exit(0);
    }
    volatile uint32_t *word = (volatile uint32_t *)(uintptr_t)in.address;
    if (in.is_written != 0) {
        *word = in.value;
    }
    out.word = *word;
    out.count = 0;
    for (uint32_t k = 0; k < in.count; k++) {
        received[end_received++ % FRAMES] = in.frames[k];
    }
}

void board_start(void)
{
    input = open("/dev/stdin", READ);
    output = open("/dev/stdout", APPEND);
    exchange();
}

board_reset_t board_reset_cause(void)
{
    return (board_reset_t)in.cause;
}

void board_encoder(uint8_t frame[BOARD_SPI_BYTES])
{
    memcpy(frame, in.encoder, BOARD_SPI_BYTES);
}

void board_torque(float torque)
{
    out.torque = torque;
}

void board_watchdog_feed(void)
{
    unfed_ticks = 0;
}

/* The labels are for the count of instructions. */
__attribute__((naked)) void cortex_tick(void)
{
    __asm volatile("push {r3, lr}\n .global tick_site, tick_back\n"
                   "tick_site: bl drive_tick\n"
                   "tick_back: pop {r3, pc}");
}

void board_wait(void)
{
    do {
        exchange();
        unfed_ticks++;
        INTERRUPT_STATE = PEND_SYSTICK;
        __asm volatile("dsb\n isb" ::: "memory");
        if (unfed_ticks > WATCHDOG_TICKS) {
            semihosting_exit(WATCHDOG_STATUS);
        }
    } while (in.is_stalled != 0);
}

bool board_can_receive(dahl_can_frame_t *frame)
{
    if (first_received == end_received) {
        return false;
    }
    const wire_frame_t *wire = &received[first_received++ % FRAMES];
    *frame = (dahl_can_frame_t){.id = (uint32_t)wire->id[0] | (uint32_t)wire->id[1] << 8, .length = wire->length};
    memcpy(frame->data, wire->data, sizeof wire->data);
    return true;
}

void board_can_send(const dahl_can_frame_t *frame)
{
    if (out.count < FRAMES) {
        wire_frame_t *wire = &out.frames[out.count++];
        wire->id[0] = (uint8_t)frame->id;
        wire->id[1] = (uint8_t)(frame->id >> 8);
        wire->length = frame->length;
        memcpy(wire->data, frame->data, sizeof wire->data);
    }
}

static void flash(uint32_t operation, uint32_t slot, const void *data, uint32_t bytes)
{
    int32_t file = open("flash.bin", UPDATE);
    host(SYS_SEEK, (uintptr_t)file, slot * SLOT_BYTES, 0);
    host(operation, (uintptr_t)file, (uintptr_t)data, bytes);
    host(SYS_CLOSE, (uintptr_t)file, 0, 0);
}

void board_flash_read(uint32_t slot, void *to, uint32_t bytes)
{
    flash(SYS_READ, slot, to, bytes);
}

void board_flash_write(uint32_t slot, const void *from, uint32_t bytes)
{
    flash(SYS_WRITE, slot, from, bytes);
}
