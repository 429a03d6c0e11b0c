#define _POSIX_C_SOURCE 199309L
#include "@n@.h"

#include <time.h>

void clocked(int ticks, const @n@_in *in, const @n@_param *param, @n@_state *state, double *taken);

void clocked(int ticks, const @n@_in *in, const @n@_param *param, @n@_state *state, double *taken)
{
    @n@_out out;
    for (int k = 0; k < ticks; ++k) {
        struct timespec a;
        struct timespec b;
        (void)clock_gettime(CLOCK_MONOTONIC, &a);
        (void)@n@_step(&in[k], param, state, &out);
        (void)clock_gettime(CLOCK_MONOTONIC, &b);
        taken[k] = (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec);
    }
}
