#include "@n@.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef @real@ real;

static const double range_in[][2] = {@range_in@};
static const double range_param[][2] = {@range_param@};
static const double range_out[][2] = {@range_out@};
static const double good[] = {@good@}; /* inputs of recovery */
static const double safe_out[] = {@safe_out@}; /* NaN where none is stated */

static const uint8_t *at;
static size_t left;

static void taken(void *to, size_t n)
{
    const size_t k = (n < left) ? n : left;
    (void)memset(to, 0, n);
    (void)memcpy(to, at, k);
    at += k;
    left -= k;
}

/* Numbers of raw bytes, or, so that many trials come past the guards, numbers in their ranges. */
static void drawn(real *x, const double (*range)[2], int n)
{
    uint8_t raw = 0;
    int k;
    taken(&raw, 1U);
    for (k = 0; k < n; ++k) {
        if ((raw % 8U) == 0U) {
            taken(&x[k], sizeof(real));
        } else {
            uint16_t share = 0;
            taken(&share, sizeof(share));
            if (share != 0U) { /* 0 leaves it as it is */
                const double part = (double)(share - 1U) / 65534.0;
                x[k] = (real)(range[k][0] * (1.0 - part) + range[k][1] * part);
            }
        }
    }
}

static void finite(const real *x, size_t n)
{
    size_t k;
    for (k = 0; k < n; ++k) {
        if (!(fabs((double)x[k]) <= DBL_MAX)) {
            abort();
        }
    }
}

//@ if n_state
@numbers_of@

//@ end
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static @n@_in in;
    static @n@_param param;
    static @n@_state state;
    static @n@_state before;
    static @n@_out out;
    int tick;
    int k;
    uint8_t tuned = 0;
//@ if n_state
    static real numbers[@n_state@];
//@ end
    at = data;
    left = size;
    @n@_default(&param);
    (void)memset(&in, 0, sizeof(in));
    (void)memset(&state, 0, sizeof(state));
    if (@n@_init(&param, &state) != 0) {
        abort(); /* the defaults are good */
    }
    taken(&tuned, 1U);
    if ((tuned % 4U) == 1U) {
        drawn((real *)&param, range_param, @n_param@);
        (void)@n@_init(&param, &state);
    }
//@ if n_state
    numbers_of(&state.kept, numbers);
    finite(numbers, @n_state@);
//@ end
    for (tick = 0; (tick < @ticks@) && (left > 0U); ++tick) {
        int status;
        if ((tuned % 4U) == 2U) {
            drawn((real *)&param, range_param, @n_param@);
            (void)@n@_tune(&param, &state);
        }
        drawn((real *)&in, range_in, @n_in@);
        (void)memcpy(&before, &state, sizeof(state));
        status = @n@_step(&in, &param, &state, &out);
//@ if n_state
        numbers_of(&state.kept, numbers);
    finite(numbers, @n_state@);
//@ end
        finite((const real *)&out, @n_out@);
        for (k = 0; k < @n_out@; ++k) {
            const double y = (double)((const real *)&out)[k];
            if (!(y >= range_out[k][0]) || !(y <= range_out[k][1])) {
                abort();
            }
            if (((status & (int)@big@_REFUSED) != 0) && !isnan(safe_out[k])
                && (y != (double)(real)safe_out[k])) {
                abort();
            }
        }
        if (((status & ((int)@big@_REFUSED | (int)@big@_RESET)) == (int)@big@_REFUSED)
//@ if n_state
            && (memcmp(&before.kept, &state.kept, sizeof(state.kept)) != 0)) {
//@ else
            && (0 != 0)) {
//@ end
            abort();
        }
    }
    if ((tuned / 4U) % @often@U == 1U) { /* whatever came: good inputs end every fault */
        int status = 0;
        @n@_default(&param);
        if (@n@_tune(&param, &state) != 0) {
            abort();
        }
        for (k = 0; k < @n_in@; ++k) {
            ((real *)&in)[k] = (real)good[k];
        }
        for (tick = 0; tick < @settled@; ++tick) {
            status = @n@_step(&in, &param, &state, &out);
        }
        if ((status & ~(int)@big@_LIMITED) != 0) {
            abort();
        }
    }
    return 0;
}
