/* SPDX-License-Identifier: MIT */
/* Standard output on the first serial port. After main, send byte 4 (end of transmission) and main's result as a digit. */
#include <avr/io.h>
#include <stdio.h>

enum { END_OF_TRANSMISSION = 4 };

void put_status(void) __attribute__((naked, used, section(".fini8")));

static int put(char c, FILE *file)
{
    (void)file;
    while (!(UCSR0A & _BV(UDRE0))) {
    }
    UDR0 = (uint8_t)c;
    return 0;
}

static FILE output = FDEV_SETUP_STREAM(put, NULL, _FDEV_SETUP_WRITE);

static void open_output(void) __attribute__((constructor));

static void open_output(void)
{
    UCSR0B = _BV(TXEN0);
    stdout = &output;
}

static void send_status(int status)
{
    put(END_OF_TRANSMISSION, NULL);
    put((char)('0' + (status & 7)), NULL);
}

/* avr-libc runs into section .fini8 after main, with main's result in r25:r24. */
void put_status(void)
{
    register int status __asm__("r24");
    __asm__ volatile("" : "=r"(status));
    send_status(status);
}
