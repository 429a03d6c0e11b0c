@head@

#include "@n@.h"

#include <stdio.h>

int main(void)
{
    @n@_in in;
    @n@_param param;
    @n@_state state;
    @n@_out out;
    int tick;

    @n@_default(&param); /* then change what differs, for example from a calibration */
    if (@n@_init(&param, &state) != @big@_OK) {
        return 1;
    }
@body@
    for (tick = 0; tick < 10; ++tick) {
        const int status = @n@_step(&in, &param, &state, &out);
        (void)printf("%d: status %d", tick, status);
@shown@
        (void)printf("\n");
    }
    return 0;
}
