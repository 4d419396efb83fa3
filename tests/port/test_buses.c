/* SPDX-License-Identifier: MIT */
/* Loopback, the queue of frames, and the bus over a serial port. */
#include <string.h>
#include <unity.h>

#include "dahl_frames.h"
#include "frame_queue.h"
#include "loopback/loopback.h"
#include "slcan/serial_bus.h"

static uint64_t clock_ns;
static uint32_t waited_us;

static uint64_t now(void *context)
{
    (void)context;
    return clock_ns;
}

static void wait_us(void *context, uint32_t us)
{
    (void)context;
    waited_us += us;
}

static loopback_t loopback;

void setUp(void)
{
    clock_ns = 5000;
    waited_us = 0;
    loopback_open(&loopback, (dahl_can_clock_t){.now_ns = now, .wait_us = wait_us});
}

void tearDown(void)
{
}

/* As many as there is room for, in the order of sending, each with the time of sending. */
static void test_loopback_gives_back_in_order_what_it_has_room_for(void)
{
    dahl_can_frame_t in = {.length = 8}, out;
    for (uint32_t i = 0; i < LOOPBACK_ROOM; i++) {
        clock_ns = i * UINT64_C(1000000);
        in.id = LOOPBACK_ROOM - i;
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &in));
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&loopback.bus, &in));
    TEST_ASSERT_EQUAL(1, loopback.bus.counts.dropped);
    for (uint32_t i = 0; i < LOOPBACK_ROOM; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&loopback.bus, &out, 0));
        TEST_ASSERT_EQUAL(LOOPBACK_ROOM - i, out.id);
        TEST_ASSERT_EQUAL(i * 1000u, out.time_us);
        TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_OWN, out.flags);
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 0));
}

/* Also when the ring's free-running numbers wrap. */
static void test_a_frame_queue_gives_back_in_order_what_it_has_room_for(void)
{
    static frame_queue_t queue;
    dahl_can_frame_t frame = {.length = 8};
    queue.head = queue.tail = UINT32_MAX - 3;
    for (frame.id = 0; frame.id < FRAME_QUEUE_SIZE; frame.id++) {
        TEST_ASSERT_EQUAL(FRAME_QUEUE_SIZE - frame.id, frame_queue_room(&queue));
        TEST_ASSERT_TRUE(frame_queue_put(&queue, &frame));
    }
    TEST_ASSERT_FALSE(frame_queue_put(&queue, &frame));
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        TEST_ASSERT_TRUE(frame_queue_take(&queue, &frame));
        TEST_ASSERT_EQUAL(i, frame.id);
    }
    TEST_ASSERT_FALSE(frame_queue_take(&queue, &frame));
}

/* With a clock that cannot wait, as in firmware, it returns at once. It has no peers, and a close keeps the sent frames. */
static void test_an_empty_loopback_waits_by_the_clock(void)
{
    dahl_can_frame_t in = {.id = 5, .length = 1, .data = {9}}, out;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 0));
    TEST_ASSERT_EQUAL(0, waited_us);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 700));
    TEST_ASSERT_EQUAL(700, waited_us);
    loopback_open(&loopback, (dahl_can_clock_t){.now_ns = now});
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 700));
    TEST_ASSERT_EQUAL(700, waited_us);
    TEST_ASSERT_EQUAL(0, loopback.bus.ops->peers(&loopback.bus));
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &in));
    loopback.bus.ops->close(&loopback.bus);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&loopback.bus, &out, 0));
    TEST_ASSERT_EQUAL(5, out.id);
    TEST_ASSERT_EQUAL(9, out.data[0]);
}

static dahl_can_frame_t taken;
static const char *to_read; /* sent by the host, unread */
static char written[200];

static bool read_port(uint8_t *byte)
{
    *byte = (uint8_t)*to_read;
    return *to_read != '\0' && to_read++ != NULL;
}

static void write_port(uint8_t byte)
{
    size_t length = strlen(written);
    TEST_ASSERT_LESS_THAN(sizeof written - 1, length);
    written[length] = (char)byte;
}

/* Receive lines from the host, and compare the answers that the bus writes. */
static dahl_can_result_t receive(serial_bus_t *serial, const char *lines, const char *answers)
{
    memset(written, 0, sizeof written);
    to_read = lines;
    dahl_can_result_t result = dahl_can_bus_receive(&serial->bus, &taken, 1000);
    TEST_ASSERT_EQUAL_STRING(answers, written);
    return result;
}

static const dahl_can_frame_t small = {.id = 0x100, .length = 2, .data = {0xAB, 0x12}};

static serial_bus_t opened(void)
{
    serial_bus_t serial;
    memset(&serial, 0xA5, sizeof serial);
    serial_bus_open(&serial, (serial_port_t){read_port, write_port}, (dahl_can_clock_t){.now_ns = now});
    return serial;
}

static void test_a_serial_bus_returns_one_frame_at_a_time_with_its_time(void)
{
    serial_bus_t serial = opened();
    clock_ns = 7654321;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, receive(&serial, "O\rV\rt10", "\rV0101\r"));
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, receive(&serial, "02AB12\rt7FF0\r", "\r"));
    TEST_ASSERT_EQUAL_HEX32(0x100, taken.id);
    TEST_ASSERT_EQUAL_MEMORY(small.data, taken.data, 8);
    TEST_ASSERT_EQUAL(7654, taken.time_us);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, receive(&serial, to_read, "\r"));
    TEST_ASSERT_EQUAL_HEX32(0x7FF, taken.id);
    TEST_ASSERT_EQUAL(0, serial.bus.counts.garbage);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, receive(&serial, "z\rtx\r\r", "\a\a\r"));
    TEST_ASSERT_EQUAL(2, serial.bus.counts.garbage);
}

static void test_a_serial_bus_sends_only_while_it_is_open(void)
{
    const dahl_can_frame_t fd = {.id = 1, .flags = DAHL_CAN_FRAME_FD};
    serial_bus_t serial = opened();
    for (uint32_t times = 0; times < 2; times++) {
        TEST_ASSERT_EQUAL(0, serial.bus.ops->peers(&serial.bus));
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&serial.bus, &small));
        TEST_ASSERT_EQUAL(2 * times + 1, serial.bus.counts.dropped);
        receive(&serial, "O\r", "\r");
        TEST_ASSERT_EQUAL(1, serial.bus.ops->peers(&serial.bus));
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&serial.bus, &small));
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&serial.bus, &fd));
        TEST_ASSERT_EQUAL_STRING("\rt1002AB12\r", written);
        TEST_ASSERT_EQUAL(2 * times + 2, serial.bus.counts.dropped);
        serial.bus.ops->close(&serial.bus);
    }
    TEST_ASSERT_EQUAL(0, serial.bus.ops->peers(&serial.bus));
}
