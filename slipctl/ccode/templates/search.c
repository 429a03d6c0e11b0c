#define main own_test
#include "test_@n@.c"
#undef main

#include <stdint.h>
#include <stdlib.h>

#define MOST @most@
#define LONGEST @longest@
#define WAYS 4194304U
#define DEEP 512

static unsigned char seen[WAYS];
static unsigned int fresh[WAYS]; /* ways that the piece has taken first */
static size_t n_fresh;
static size_t n_seen;
static unsigned long long taken; /* ways, each time: the work that was done */
static uintptr_t before; /* block of code, and the one before it */
static uintptr_t earlier;
static uintptr_t callers[DEEP];
static int depth;

void __sanitizer_cov_trace_pc(void);
void __sanitizer_cov_trace_pc(void)
{
    const uintptr_t here = (uintptr_t)__builtin_return_address(0) - (uintptr_t)&@n@_init;
    uint64_t way = ((uint64_t)before << 32) ^ (uint64_t)(here & 0xffffffffU);
    way *= 0x9e3779b97f4a7c15U;
    way >>= 42;
    earlier = before;
    before = here;
    ++taken;
    if (seen[way] == 0U) {
        seen[way] = 1U;
        fresh[n_fresh++] = (unsigned int)way;
        ++n_seen;
    }
}

/* A way is one inside of a function: whoever calls it is another matter. */
void __cyg_profile_func_enter(void *callee, void *caller);
void __cyg_profile_func_enter(void *callee, void *caller)
{
    (void)callee;
    (void)caller;
    callers[depth++] = earlier;
}

void __cyg_profile_func_exit(void *callee, void *caller);
void __cyg_profile_func_exit(void *callee, void *caller)
{
    (void)callee;
    (void)caller;
    before = callers[--depth];
}

static void forgotten(void)
{
    while (n_fresh > 0U) {
        seen[fresh[--n_fresh]] = 0U;
        --n_seen;
    }
}

static uint64_t random_state;

static double share(void) /* between 0 and 1 */
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return (double)(random_state >> 11) / 9007199254740992.0;
}

static int below(int n)
{
    return (int)(share() * (double)n);
}

/* least and greatest value of each input, and what it may change by in a tick */
static const double range[N_IN][3] = {@ranges@};
static const bool whole[N_IN] = {@whole@}; /* numbers without a fraction, and choices */
static real (*run)[N_IN]; /* recorded inputs, then those found */
static int ticks;
static real piece[LONGEST][N_IN];
static @n@_param param;
static @n@_state now; /* behind the run */

/* A value of an input: an end, any, one of the run, or about where it is. */
static double value_of(int k, double at)
{
    const double lo = range[k][0];
    const double hi = range[k][1];
    const double s = share();
    switch (below(4)) {
    case 0: return lo + ((hi - lo) * fmin(fmax((1.5 * s) - 0.25, 0.0), 1.0));
    case 1: return (double)run[below(ticks)][k];
    case 2: return at + ((hi - lo) * (s - 0.5) * pow(10.0, -1.0 - (double)below(4)));
    default: return at * 2.0 * s;
    }
}

/* A piece of the run, its end, or what it ends with, changed in some inputs for some ticks: often
 * from the last one of the run on, behind what was found before. */
static int made_up(void)
{
    const int length = 1 << (1 + below(@bits@));
    const int kind = below(3);
    int from = (kind == 0) ? below(ticks) : ((kind == 1) ? ticks - 1 - below(length) : ticks - 1);
    int changes = 1 + below(3);
    int t;
    int k;
    from = (from > 0) ? from : 0;
    for (t = 0; t < length; ++t) {
        const int at = (from + t < ticks) ? from + t : ticks - 1;
        copied(piece[t], run[at], sizeof(piece[t]));
    }
    for (; changes > 0; --changes) {
        const int which = below(N_IN);
        const bool last = (ticks - 1 - from < length) && (below(2) == 0);
        const int begin = last ? ticks - 1 - from : below(length);
        const int end = begin + 1 + below(below(2) == 0 ? length - begin : 1);
        const double to = value_of(which, (double)piece[begin][which]);
        const double by = to - (double)piece[begin][which];
        const int how = below(3);
        for (t = begin; t < end; ++t) {
            const double part = (double)(t - begin + 1) / (double)(end - begin);
            const double at = (double)piece[t][which];
            piece[t][which] = (real)((how == 0) ? to : ((how == 1) ? at + by
                : at + ((to - at) * part)));
        }
    }
    for (t = 0; t < length; ++t) {
        for (k = 0; k < N_IN; ++k) {
            const double last = (double)((t > 0) ? piece[t - 1][k] : run[ticks - 1][k]);
            const double most = 0.999 * range[k][2];
            const double near = fmin(fmax((double)piece[t][k], last - most), last + most);
            const double wanted = whole[k] ? floor(near + 0.5) : near;
            piece[t][k] = (real)fmin(fmax(wanted, range[k][0]), range[k][1]);
        }
    }
    return length;
}

/* Step through some ticks of the piece, until one is not taken; how many of them to keep. */
static int tried(@n@_state *kept, int from, int to)
{
    static @n@_state state;
    static @n@_in in;
    static @n@_out out;
    int t;
    int last = from;
    copied(&state, &now, sizeof(state));
    for (t = from; t < to; ++t) {
        const size_t known = n_fresh;
        int status;
        copied(&in, piece[t], sizeof(in));
        status = @n@_step(&in, &param, &state, &out);
        if ((status | @big@_LIMITED) != @big@_LIMITED) {
            while (n_fresh > known) {
                seen[fresh[--n_fresh]] = 0U;
                --n_seen;
            }
            break;
        }
        if (n_fresh > known) {
            copied(kept, &state, sizeof(state));
            last = t + 1;
        }
    }
    return last - from;
}

/* search ROWS TICKS WORK SEED FOUND: what is found goes to a file, in numbers of double. */
int main(int argc, char **argv)
{
    static @n@_state found;
    static @n@_state shorter;
    static @n@_in in;
    static @n@_out out;
    static double row[N_IN];
    static real raw[N_PARAM + N_IN + 1];
    static const double given[] = {@params@};
    FILE *file = fopen(argv[1], "rb");
    const int recorded = (argc == 6) ? atoi(argv[2]) : 0;
    const unsigned long long work = strtoull(argv[3], NULL, 10);
    unsigned long long searched;
    size_t own;
    long pieces = 0;
    int t;
    int k;
    random_state = 88172645463325252U + strtoull(argv[4], NULL, 10);
    run = calloc((size_t)recorded + MOST, sizeof(*run));
    rounded(given, raw, N_PARAM);
    @n@_default(&param);
    copied(&param, raw, N_PARAM * sizeof(real));
    if ((file == NULL) || (run == NULL) || (@n@_init(&param, &now) != @big@_OK)) {
        return 2;
    }
    for (ticks = 0; ticks < recorded; ++ticks) {
        if (fread(row, sizeof(double), N_IN, file) != (size_t)N_IN) {
            return 2;
        }
        rounded(row, run[ticks], N_IN);
        copied(&in, run[ticks], sizeof(in));
        (void)@n@_step(&in, &param, &now, &out);
    }
    (void)misused(&param, &now);
    n_fresh = 0U;
    own = n_seen;
    for (searched = taken; (taken - searched) < work; ++pieces) {
        const int length = made_up();
        const int last = tried(&found, 0, length);
        const size_t new_ones = n_fresh;
        int begin = 0;
        int back;
        if (ticks + last > recorded + MOST) {
            forgotten();
            break;
        }
        if (last == 0) {
            continue;
        }
        for (back = 1; back < last; back *= 2) { /* the end of it may do */
            forgotten();
            if ((tried(&shorter, last - back, last) == back) && (n_fresh == new_ones)) {
                begin = last - back;
                break;
            }
        }
        if (begin == 0) {
            forgotten();
            (void)tried(&shorter, 0, last);
        }
        n_fresh = 0U;
        copied(&now, &shorter, sizeof(now));
        for (t = begin; t < last; ++t) {
            copied(run[ticks++], piece[t], sizeof(piece[t]));
        }
    }
    (void)fclose(file);
    file = fopen(argv[5], "wb");
    if (file == NULL) {
        return 2;
    }
    for (t = recorded; t < ticks; ++t) {
        for (k = 0; k < N_IN; ++k) {
            row[k] = (double)run[t][k];
        }
        if (fwrite(row, sizeof(double), N_IN, file) != (size_t)N_IN) {
            return 2;
        }
    }
    (void)printf("%ld %lu %lu\n", pieces, (unsigned long)own, (unsigned long)(n_seen - own));
    return (fclose(file) == 0) ? 0 : 2;
}
