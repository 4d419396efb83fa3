/* SPDX-License-Identifier: MIT */
/* System calls of newlib's printf, for the tests: standard output, heap, exit. */
#include <errno.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cortex_m.h"
#include "semihosting.h"

extern char heap_start[], heap_end[];

int _write(int file, const char *text, int length);
int _read(int file, char *text, int length);
int _close(int file);
int _isatty(int file);
int _fstat(int file, struct stat *about);
int _getpid(void);
int _kill(int process, int sign);
off_t _lseek(int file, off_t offset, int from);
void *_sbrk(ptrdiff_t more);

int _write(int file, const char *text, int length)
{
    (void)file;
    semihosting_write(text, (uint32_t)length);
    return length;
}

int _read(int file, char *text, int length)
{
    (void)file, (void)text, (void)length;
    return 0;
}

int _close(int file)
{
    (void)file;
    return 0;
}

int _isatty(int file)
{
    (void)file;
    return 1;
}

int _fstat(int file, struct stat *about)
{
    (void)file;
    about->st_mode = S_IFCHR;
    return 0;
}

int _getpid(void)
{
    return 1;
}

int _kill(int process, int sign)
{
    (void)process, (void)sign;
    cortex_fault();
}

off_t _lseek(int file, off_t offset, int from)
{
    (void)file, (void)offset, (void)from;
    return 0;
}

void *_sbrk(ptrdiff_t more)
{
    static char *end = heap_start;
    char *old = end;
    if (more > heap_end - end) {
        errno = ENOMEM;
        return (void *)-1;
    }
    end += more;
    return old;
}

void _exit(int status)
{
    cortex_exit(status);
}
