@head@

/* A step after each command of the tool, with the inputs that it has written. */

#include "cortex_m.h"
#include "@n@.h"
#include "xcp.h"

extern @n@_param @n@_param_instance;
extern @n@_in @n@_in_instance;
extern @n@_state @n@_state_instance;
extern @n@_out @n@_out_instance;
extern int @n@_status_instance;

@n@_param @n@_param_instance;
@n@_in @n@_in_instance;
@n@_state @n@_state_instance;
@n@_out @n@_out_instance;
int @n@_status_instance;

int main(void);

static xcp_region region(unsigned char *at, uint32_t size, bool writable)
{
    const xcp_region found = {(uint32_t)(uintptr_t)at, at, size, writable};
    return found;
}

static unsigned char next_byte(void)
{
    int byte = -1;
    while (byte < 0) {
        byte = serial_get(0xFFFFFFFFUL);
    }
    return (unsigned char)byte;
}

int main(void)
{
    xcp_region regions[5];
    xcp slave = {regions, 5U, false, false, 0U};
    unsigned char command[256];
    unsigned char answer[XCP_LONGEST];
    unsigned char counter = 0U;

    regions[0] = region((unsigned char *)&@n@_param_instance,
                        (uint32_t)sizeof(@n@_param_instance), true);
    regions[1] = region((unsigned char *)&@n@_in_instance,
                        (uint32_t)sizeof(@n@_in_instance), true);
    regions[2] = region((unsigned char *)&@n@_state_instance,
                        (uint32_t)sizeof(@n@_state_instance), false);
    regions[3] = region((unsigned char *)&@n@_out_instance,
                        (uint32_t)sizeof(@n@_out_instance), false);
    regions[4] = region((unsigned char *)&@n@_status_instance,
                        (uint32_t)sizeof(@n@_status_instance), false);
    serial_start();
    @n@_default(&@n@_param_instance);
    @n@_status_instance = @n@_init(&@n@_param_instance, &@n@_state_instance);
@given@
    for (;;) {
        const unsigned int length = next_byte();
        (void)next_byte(); /* the tool's counter */
        for (unsigned int k = 0U; k < length; ++k) {
            command[k] = next_byte();
        }
        const unsigned int size = xcp_answer(&slave, command, length, answer);
        if (slave.written) { /* parameters take effect together, if they are good */
            slave.written = false;
            @n@_status_instance = @n@_tune(&@n@_param_instance, &@n@_state_instance);
        }
        if (@n@_status_instance != @big@_BAD_PARAM) {
            @n@_status_instance = @n@_step(&@n@_in_instance, &@n@_param_instance,
                                           &@n@_state_instance, &@n@_out_instance);
        }
        if (size > 0U) {
            serial_put((unsigned char)size);
            serial_put(counter);
            ++counter;
            for (unsigned int k = 0U; k < size; ++k) {
                serial_put(answer[k]);
            }
        }
    }
}
