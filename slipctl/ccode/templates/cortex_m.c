/* Start of a Cortex-M4 or M7 on the MPS2 board, its timer and serial line, and the few calls of
 * newlib, which go to the debugger or to QEMU by semihosting.
 *
 * SPDX-License-Identifier: Apache-2.0 (see LICENSE)
 */

#include "cortex_m.h"

#include <fcntl.h>
#include <stddef.h>
#include <string.h>
#include <sys/stat.h>

#define REGISTER(address) (*(volatile unsigned long *)(address))
#define COPROCESSORS REGISTER(0xE000ED88UL)
#define TIMER_CONTROL REGISTER(0x40000000UL)
#define TIMER_VALUE REGISTER(0x40000004UL)
#define TIMER_RELOAD REGISTER(0x40000008UL)
#define SERIAL_DATA REGISTER(0x40004000UL)
#define SERIAL_STATE REGISTER(0x40004004UL)
#define SERIAL_CONTROL REGISTER(0x40004008UL)
#define SERIAL_PENDING REGISTER(0x4000400CUL)
#define SERIAL_DIVIDER REGISTER(0x40004010UL)
#define INTERRUPTS REGISTER(0xE000E100UL) /* enabled */
#define INTERRUPTS_PENDING REGISTER(0xE000E280UL)

#define PAINT 0xC5A3C5A3UL
#define PAINTED 4096 /* words below the caller */
#define KEPT 16      /* words left for the functions that paint and look */

extern unsigned char data_begin[], data_end[], data_image[], bss_begin[], bss_end[];

int main(void);
void reset(void);
void _exit(int code);
int _open(const char *name, int flags, int mode);
int _close(int file);
int _read(int file, char *to, int size);
int _write(int file, const char *from, int size);
long _lseek(int file, long offset, int whence);
int _fstat(int file, struct stat *about);
int _isatty(int file);
void *_sbrk(int more);
int _kill(int process, int signal);
int _getpid(void);

static void trap(void)
{
    _exit(3);
}

__attribute__((used, section(".vectors"))) static void (*const vectors[15])(void) = {
    /* the linker script puts the stack's top before them */
    reset, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap, trap,
};

void reset(void)
{
    const ptrdiff_t data = data_end - data_begin;
    const ptrdiff_t bss = bss_end - bss_begin;
    COPROCESSORS |= 0xFUL << 20; /* floating point on */
    __asm volatile("dsb\n isb");
    (void)memcpy(data_begin, data_image, (size_t)data);
    (void)memset(bss_begin, 0, (size_t)bss);
    _exit(main());
}

/* ---- clock and stack ------------------------------------------------------------------------ */

void clock_start(void)
{
    TIMER_CONTROL = 0;
    TIMER_RELOAD = 0xFFFFFFFFUL;
    TIMER_VALUE = 0xFFFFFFFFUL;
    TIMER_CONTROL = 1;
}

unsigned long clock_now(void)
{
    return ~TIMER_VALUE;
}

unsigned long instructions(unsigned long from, unsigned long to)
{
    return ((to - from) * 5UL + 8UL) / 16UL; /* 128 ns are 3.2 ticks of 40 ns */
}

__attribute__((noinline)) void stack_paint(void)
{
    volatile unsigned long *here = (volatile unsigned long *)__builtin_frame_address(0);
    int k;
    for (k = KEPT; k < PAINTED; ++k) {
        here[-k] = PAINT;
    }
}

__attribute__((noinline)) unsigned long stack_used(void)
{
    volatile unsigned long *here = (volatile unsigned long *)__builtin_frame_address(0);
    int k = PAINTED - 1;
    while (k >= KEPT && here[-k] == PAINT) {
        --k;
    }
    return 4UL * (unsigned long)((k < KEPT) ? KEPT : k);
}

/* ---- serial line ---------------------------------------------------------------------------- */

void serial_start(void)
{
    __asm volatile("cpsid i"); /* a byte that comes ends wfi, and nothing else happens */
    INTERRUPTS = 1UL;
    SERIAL_DIVIDER = 16;
    SERIAL_CONTROL = 3UL | 8UL;
}

void serial_put(unsigned char byte)
{
    while ((SERIAL_STATE & 1UL) != 0UL) {
    }
    SERIAL_DATA = byte;
}

int serial_get(unsigned long polls)
{
    unsigned long left = polls;
    unsigned long ready = SERIAL_STATE & 2UL;
    int byte = -1;
    while ((ready == 0UL) && (left > 0UL)) {
        --left;
        __asm volatile("wfi");
        ready = SERIAL_STATE & 2UL;
    }
    if (ready != 0UL) {
        const unsigned long data = SERIAL_DATA & 0xFFUL;
        SERIAL_PENDING = 2UL; /* clears it */
        INTERRUPTS_PENDING = 1UL;
        byte = (int)data;
    }
    return byte;
}

/* ---- semihosting ---------------------------------------------------------------------------- */

static int host(int operation, const void *arguments)
{
    register int r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = arguments;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

void _exit(int code)
{
    unsigned long arguments[2];
    arguments[0] = 0x20026UL;
    arguments[1] = (unsigned long)code;
    (void)host(0x20, arguments);
    for (;;) {
    }
}

int _open(const char *name, int flags, int mode)
{
    unsigned long arguments[3];
    int file;
    (void)mode;
    arguments[0] = (unsigned long)name;
    arguments[1] = ((flags & 3) == O_RDONLY) ? 1UL : 5UL; /* rb, wb */
    arguments[2] = strlen(name);
    file = host(0x01, arguments);
    return (file < 0) ? -1 : file + 3;
}

int _close(int file)
{
    const int handle = file - 3;
    const unsigned long argument = (unsigned long)handle;
    return (file < 3) ? 0 : host(0x02, &argument);
}

int _read(int file, char *to, int size)
{
    const int handle = file - 3;
    unsigned long arguments[3];
    arguments[0] = (unsigned long)handle;
    arguments[1] = (unsigned long)to;
    arguments[2] = (unsigned long)size;
    return (file < 3) ? 0 : size - host(0x06, arguments);
}

int _write(int file, const char *from, int size)
{
    static int console = 0;
    unsigned long arguments[3];
    int handle = file - 3;
    if (file < 3) {
        if (console == 0) {
            console = _open(":tt", O_WRONLY, 0);
        }
        handle = console - 3;
    }
    arguments[0] = (unsigned long)handle;
    arguments[1] = (unsigned long)from;
    arguments[2] = (unsigned long)size;
    return size - host(0x05, arguments);
}

long _lseek(int file, long offset, int whence)
{
    (void)file;
    (void)offset;
    (void)whence;
    return -1;
}

int _fstat(int file, struct stat *about)
{
    const mode_t mode = (file < 3) ? (mode_t)S_IFCHR : (mode_t)S_IFREG;
    (void)memset(about, 0, sizeof(*about));
    about->st_mode = mode;
    about->st_blksize = 16384;
    return 0;
}

int _isatty(int file)
{
    return (file < 3) ? 1 : 0;
}

void *_sbrk(int more)
{
    static unsigned char *end = bss_end;
    unsigned char *begin = end;
    end = &end[more];
    return begin;
}

int _kill(int process, int signal)
{
    (void)process;
    (void)signal;
    return -1;
}

int _getpid(void)
{
    return 1;
}
