#include "@n@.h"

#include "cortex_m.h"

#include <string.h>

#define FOREVER 0xFFFFFFFFUL
#define SIZE(x) ((unsigned long)sizeof(x))

int main(void);

static @n@_in in;
static @n@_param param;
static @n@_state state;
static @n@_out out;
static unsigned int sums[2];

static void add(unsigned int byte)
{
    sums[0] = (sums[0] + byte) % 255U;
    sums[1] = (sums[1] + sums[0]) % 255U;
}

static unsigned char take(void)
{
    int byte = -1;
    while (byte < 0) {
        byte = serial_get(FOREVER);
    }
    add((unsigned int)byte);
    return (unsigned char)byte;
}

static void give(unsigned char byte)
{
    add(byte);
    serial_put(byte);
}

static void receive(void *to, unsigned long size)
{
    unsigned char *bytes = to;
    while (size-- > 0) {
        *bytes++ = take();
    }
}

static void send(const void *from, unsigned long size)
{
    const unsigned char *bytes = from;
    while (size-- > 0) {
        give(*bytes++);
    }
}

static void begin(void)
{
    sums[0] = 0;
    sums[1] = 0;
}

/* Whether the two bytes that follow are the sums so far. */
static int checked(void)
{
    const unsigned int first = sums[0];
    const unsigned int second = sums[1];
    const unsigned int low = take();
    return take() == second && low == first;
}

int main(void)
{
    unsigned char expected = 0;
    unsigned char tick;
    unsigned char now;
    unsigned char low;
    unsigned long from;
    unsigned long empty; /* of reading the clock twice */
    unsigned long count;
    int status;
    int k;
    serial_start();
    clock_start();
    from = clock_now();
    empty = instructions(from, clock_now());
    @n@_default(&param);
    for (;;) {
        const unsigned char kind = take();
        begin();
        count = 0;
        if (kind == 0xA4U) { /* parameters: start anew */
            receive(&param, SIZE(param));
            status = checked() ? @n@_init(&param, &state) : @broken@;
            memset(&out, 0, sizeof(out));
            expected = 0;
            tick = 0;
        } else if (kind == 0xA5U) {
            static @n@_in fresh;
            tick = take();
            now = take();
            receive(&fresh, SIZE(fresh));
            if (checked()) {
                in = fresh;
                from = clock_now();
                status = @n@_step(&in, &param, &state, &out);
                count = instructions(from, clock_now()) - empty;
                status |= (tick != expected) ? @lost@ : 0;
                status |= (tick != now) ? @late@ : 0;
                expected = (unsigned char)(tick + 1U);
            } else {
                status = @broken@;
            }
        } else {
            continue;
        }
        serial_put(0x5AU);
        begin();
        give(tick);
        give((unsigned char)(status & 0xFF));
        give((unsigned char)((status >> 8) & 0xFF));
        for (k = 0; k < 4; ++k) {
            give((unsigned char)((count >> (8 * k)) & 0xFFUL));
        }
        send(&out, SIZE(out));
        low = (unsigned char)sums[0];
        now = (unsigned char)sums[1];
        serial_put(low);
        serial_put(now);
    }
}
