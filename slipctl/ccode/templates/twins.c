#include "@n@.h"

#include <string.h>

int @n@_twin_init(const @n@_param *param, @n@_state *state);
int @n@_twin_step(const @n@_in *in, const @n@_param *param, @n@_state *state, @n@_out *out);

static @n@_in in;
static @n@_param param;
static @n@_state a, b;
static @n@_out x, y;

int main(void)
{
    int same;
    @n@_default(&param);
    same = @n@_init(&param, &a) == @n@_twin_init(&param, &b);
    same = same && @n@_step(&in, &param, &a, &x) == @n@_twin_step(&in, &param, &b, &y);
    return (same && memcmp(&x, &y, sizeof(x)) == 0) ? 0 : 1;
}
