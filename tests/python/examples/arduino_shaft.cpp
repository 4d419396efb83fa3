// SPDX-License-Identifier: MIT
// A shaft with a quadrature encoder on a board of Arduino's: what the sketch QuadratureEncoder asks of either. Turns 300 edges
// forward, then 500 back, two a millisecond, and prints `EDGES TORQUE` where the sketch prints.
#include <cstdint>
#include <cstdio>

enum { INPUT_PULLUP, CHANGE };

static const int GRAY[4] = {0, 1, 3, 2}; // bit 0: A, bit 1: B; A leads in forward motion
static void (*edge_of[2])();
static int place = 4000;
static uint32_t clock_us;

static int digitalRead(int pin)
{
    return GRAY[place % 4] >> (pin - 2) & 1;
}

static uint32_t micros()
{
    return clock_us;
}

static int digitalPinToInterrupt(int pin)
{
    return pin - 2;
}

static void attachInterrupt(int number, void (*call)(), int)
{
    edge_of[number] = call;
}

static void pinMode(int, int)
{
}

static void noInterrupts()
{
}

static void interrupts()
{
}

static struct {
    void begin(long) {}
    void println(const char *text) { std::printf("%s\n", text); }
    void println(double value, int digits) { std::printf("%d %.*f\n", place - 4000, digits, value); }
} Serial;

#include SKETCH

static void turn(int by)
{
    const int before = GRAY[place % 4];
    place += by;
    edge_of[(before ^ GRAY[place % 4]) == 2](); // of the pin that changed
}

int main()
{
    setup();
    for (int edge = 0; edge < 800; edge++) {
        turn(edge < 300 ? 1 : -1);
        clock_us += 500;
        loop();
    }
    return 0;
}
