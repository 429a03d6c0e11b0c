#include "@n@.h"

static @n@_in in;
static @n@_param param;
static @n@_state state;
static @n@_out out;

int main(void);

int main(void)
{
    @n@_default(&param);
    return @n@_init(&param, &state) | @n@_tune(&param, &state)
           | @n@_step(&in, &param, &state, &out);
}
