@head@

/* Back to back: replay recorded inputs, carry the state here, compare with the recorded outputs,
 * states and status of the Python model. Exit code 0 when all agree.
 *
 * test_@n@ [vectors.txt]               replay
 * test_@n@ vectors.txt vectors.bin     write the numbers in binary, for a board that reads slowly
 */

#include "@n@.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#ifdef ON_BOARD
#include "cortex_m.h"
#endif

#define N_IN @n_in@
#define N_PARAM @n_param@
#define N_OUT @n_out@
#define N_STATE @n_state@
#define N_SIGNALS @n_signals@
#define N_LIMITS @n_limits@
#define N_ENDS @n_ends@ /* finite ends of the ranges of inputs */
//@ if judged
#define N_GUARDED @n_guarded@ /* inputs that the guard holds; the model judges the others */
//@ end
#define N_TICK @n_tick@ /* numbers of a tick behind its status */
#define N_ROW @n_row@
#define STALE @stale@ /* ticks that the first input@of_the_guard@ is held */
#define COMPARED @mask@ /* bits of the status */
#ifdef ON_BOARD
#define ENOUGH @enough@ /* instructions of all steps after which a board stops, */
#define AT_LEAST @at_least@ /* but not before so many ticks */
#endif
#define CONTENT "@content@"

typedef @real@ real;

@sizes@

static const struct {
    const char *name;
    int size;
} signals[N_SIGNALS] = {
@names@
};

//@ if n_in
static const double range_of[N_IN][2] = {
@ranges@
};

//@ end
//@ if judged
static const int judged_of[N_IN] = {@flags@};

//@ end
static bool binary; /* whether the numbers of the file are those of this machine */

static bool numbers(FILE *file, double *x, int n)
{
    int k;
    if (binary) {
        return fread(x, sizeof(double), (size_t)n, file) == (size_t)n;
    }
    for (k = 0; k < n; ++k) {
        if (fscanf(file, "%lf", &x[k]) != 1) {
            return false;
        }
    }
    return true;
}

static void copied(void *to, const void *from, size_t n)
{
    (void)memcpy(to, from, n);
}

/* Numbers of a tick: the file has the states of every so many ticks, and of the last one. */
static int width(int tick, int ticks, int every)
{
    return (((tick % every) == 0) || (tick == (ticks - 1))) ? N_TICK : (N_TICK - N_STATE);
}

#ifndef ON_BOARD
static int in_binary(FILE *file, FILE *copy, int ticks, int every)
{
    long left = @n_first@L + ticks;
    double x = 0.0;
    int tick;
    for (tick = 0; tick < ticks; ++tick) {
        left += width(tick, ticks, every);
    }
    (void)fprintf(copy, "slipctl-vectors 4 @n@ " CONTENT " binary %d %d %d %d\n", N_PARAM,
            N_SIGNALS, ticks, every);
    for (; left > 0; --left) {
        if (!numbers(file, &x, 1) || (fwrite(&x, sizeof(double), 1, copy) != 1U)) {
            return 2;
        }
    }
    return (fclose(copy) == 0) ? 0 : 2;
}
#endif

//@ if !n_in
#ifndef ON_BOARD
//@ end
static bool same(const void *one, const void *other, size_t n)
{
    const unsigned char *a = (const unsigned char *)one;
    const unsigned char *b = (const unsigned char *)other;
    size_t differ = 0;
    size_t k;
    for (k = 0; k < n; ++k) {
        differ += (a[k] != b[k]) ? 1U : 0U;
    }
    return differ == 0U;
}
//@ if !n_in
#endif
//@ end

//@ if numbers_given
static void rounded(const double *from, real *to, int n)
{
    int k;
    for (k = 0; k < n; ++k) {
        to[k] = (real)from[k];
    }
}

//@ end
//@ if n_state
@numbers@

//@ end
@misuse@

#ifdef ON_BOARD
int main(void)
#else
int main(int argc, char **argv)
#endif
{
    static double row[N_ROW];
//@ if !n_in !n_param
//@ else
    static real raw[N_ROW];
//@ end
    static real given[@n_answers@]; /* outputs and states as they were last looked at */
    static double limits[N_LIMITS]; /* largest difference; 1 if only of the envelope */
    static double worst[N_SIGNALS];
    static double largest[N_SIGNALS];
    static double ends[@n_answers@][4]; /* least wanted and got, greatest wanted and got */
    static @n@_in in;
    static @n@_param param;
    static @n@_state state;
    static @n@_out out;
//@ if rates
#ifndef ON_BOARD
    static @n@_state pieces; /* stepped rate by rate */
    static @n@_out out_pieces;
    int got_pieces;
    int differently = 0;
#endif
//@ end
#ifdef ON_BOARD
    const char *path = "vectors.bin";
    unsigned long from = 0;
    unsigned long count = 0;
    unsigned long empty = 0; /* of reading the clock twice */
    unsigned long slowest = 0;
    unsigned long depth = 0;
    unsigned long deepest = 0;
    double sum = 0.0;
#else
    const char *path = (argc > 1) ? argv[1] : "vectors.txt";
#endif
    FILE *file = fopen(path, "rb");
    char line[200] = {0};
    char content[64] = {0};
    char form[64] = {0};
    int params = 0;
    int compared = 0;
    bool ours = false;
    int ticks = 0;
    int every = 0;
    int tick;
    double wanted_status = 0.0;
    int faults = 0;
    int refused = 0;
    int held = 0;
    bool still = (N_IN == 0); /* a stale input refuses the tick */
    int wrong = 0;
    int misuses = 0;
    const int first = N_IN;
    int at = 0;
    int got_status;
    int k;
    int j;
    unsigned int differing;
    bool guarded;
    double most = 0.0;

    if (file == NULL) {
        (void)printf("cannot read %s\n", path);
        return 2;
    }
    if (fgets(line, (int)sizeof(line), file) != NULL) {
        ours = (sscanf(line, "slipctl-vectors 4 @n@ %63s %63s %d %d %d %d", content, form, &params,
                       &compared, &ticks, &every) == 6);
    }
    if (!ours || (strcmp(content, CONTENT) != 0) || (params != N_PARAM)
        || (compared != N_SIGNALS) || (every < 1)) {
        (void)printf("%s does not belong to @n@ " CONTENT "\n", path);
        return 2;
    }
    binary = (strcmp(form, "binary") == 0);
#ifndef ON_BOARD
    if (argc > 2) {
        FILE *copy = fopen(argv[2], "wb");
        return (copy == NULL) ? 2 : in_binary(file, copy, ticks, every);
    }
#endif
    if (!numbers(file, row, N_PARAM) || !numbers(file, limits, N_LIMITS)) {
        (void)printf("%s has no parameters and limits\n", path);
        return 2;
    }
    @n@_default(&param);
//@ if n_param
    rounded(row, raw, N_PARAM);
    copied(&param, raw, sizeof(param));
//@ end
    if (@n@_init(&param, &state) != @big@_OK) {
        (void)printf("init refuses the parameters\n");
        return 1;
    }
//@ if rates
#ifndef ON_BOARD
    pieces = state;
#endif
//@ end
#ifdef ON_BOARD
    clock_start();
    from = clock_now();
    empty = instructions(from, clock_now());
#endif
    for (tick = 0; tick < ticks; ++tick) {
        int signal;
        const int now = width(tick, ticks, every);
        if (!numbers(file, &wanted_status, 1) || !numbers(file, row, now)) {
            (void)printf("%s ends at tick %d\n", path, tick);
            return 2;
        }
//@ if n_in
        rounded(row, raw, N_IN);
        copied(&in, raw, sizeof(in));
//@ end
        k = (int)wanted_status;
#ifdef ON_BOARD
        stack_paint();
        from = clock_now();
#endif
        got_status = @n@_step(&in, &param, &state, &out);
#ifdef ON_BOARD
        count = instructions(from, clock_now()) - empty;
        depth = stack_used();
        deepest = (depth > deepest) ? depth : deepest;
        slowest = (count > slowest) ? count : slowest;
        sum += (double)count;
#endif
//@ if rates
#ifndef ON_BOARD
@pieces@
        differently += ((got_pieces == got_status) && same(&out_pieces, &out, sizeof(out))
                        && same(&pieces.kept, &state.kept, sizeof(state.kept))) ? 0 : 1;
#endif
//@ end
        differing = ((unsigned int)got_status ^ (unsigned int)k) & COMPARED;
        faults += ((k < 0) || (differing == 0U)) ? 0 : 1; /* -1: roundings decide */
        copied(given, &out, (size_t)N_OUT * sizeof(real));
//@ if n_state
        if (now == N_TICK) {
            numbers_of(&state.kept, &given[N_OUT]);
        }
//@ end
        at = 0;
        for (signal = 0; signal < N_SIGNALS; ++signal) {
            for (k = 0; k < signals[signal].size; ++k) {
                const double wanted = row[first + at];
                const double got = (double)given[at];
                const double difference = fabs(got - wanted);
                worst[signal] = (difference <= worst[signal]) ? worst[signal] : difference;
                largest[signal] = (fabs(wanted) > largest[signal]) ? fabs(wanted) : largest[signal];
                ends[at][0] = ((tick > 0) && (ends[at][0] < wanted)) ? ends[at][0] : wanted;
                ends[at][1] = ((tick > 0) && (ends[at][1] < got)) ? ends[at][1] : got;
                ends[at][2] = ((tick > 0) && (ends[at][2] > wanted)) ? ends[at][2] : wanted;
                ends[at][3] = ((tick > 0) && (ends[at][3] > got)) ? ends[at][3] : got;
                ++at;
            }
        }
#ifdef ON_BOARD
        if ((sum > ENOUGH) && (tick >= (AT_LEAST - 1))) {
            ticks = tick + 1; /* the last one */
        }
#endif
    }
    (void)fclose(file);
    (void)printf("%-32s %12s %12s %12s\n", "signal", "difference", "relative", "limit");
    at = 0;
    for (k = 0; k < N_SIGNALS; ++k) {
        const double relative = (largest[k] > 0.0) ? worst[k] / largest[k] : worst[k];
        const bool envelope = (limits[(2 * k) + 1] > 0.0);
        double most_of = envelope ? 0.0 : worst[k];
        for (j = 0; j < signals[k].size; ++j) {
            const double low = fabs(ends[at][0] - ends[at][1]);
            const double high = fabs(ends[at][2] - ends[at][3]);
            most_of = (envelope && !(low <= most_of)) ? low : most_of;
            most_of = (envelope && !(high <= most_of)) ? high : most_of;
            ++at;
        }
        (void)printf("%-32s %12.3g %12.3g %12.3g%s\n", signals[k].name, worst[k], relative,
               limits[2 * k], envelope ? " (of least and greatest value)" : "");
        most = (envelope || (relative <= most)) ? most : relative;
        wrong += (most_of <= limits[2 * k]) ? 0 : 1;
    }
//@ if n_in
    for (k = 0; (k < N_IN) && (ticks > 0); ++k) {
//@ if judged
        if (judged_of[k] != 0) {
            static @n@_state unspoilt;
            @n@_in spoilt = state.guard.last;
            unspoilt = state;
            copied(raw, &spoilt, sizeof(spoilt));
            raw[k] = (real)NAN;
            copied(&spoilt, raw, sizeof(spoilt));
            got_status = @n@_step(&spoilt, &param, &state, &out);
            faults += ((got_status & @big@_REFUSED) == 0) ? 0 : 1;
            copied(raw, &out, (size_t)N_OUT * sizeof(real));
            for (j = 0; j < N_OUT; ++j) {
                faults += isfinite(raw[j]) ? 0 : 1;
            }
            state = unspoilt;
            continue;
        }
//@ end
        for (j = -1; j < 2; ++j) {
            static @n@_state before;
            static @n@_state plain;
            static @n@_out good;
            const double end = (j < 0) ? (double)NAN : range_of[k][j];
            const double far = ((j > 0) ? 1.0 : -1.0) * (1.0 + (0.001 * fabs(end)));
            const double beyond = end + far;
            const int wanted = (j < 0) ? @big@_BAD_INPUT : @big@_OFF_RANGE;
            @n@_in last = state.guard.last;
            int as_last;
            if ((j >= 0) && (fabs(end) > DBL_MAX)) {
                continue;
            }
            before = state;
            as_last = @n@_step(&last, &param, &state, &good);
            plain = state;
            state = before;
            copied(raw, &last, sizeof(last));
            raw[k] = (real)beyond;
            copied(&last, raw, sizeof(last));
            got_status = @n@_step(&last, &param, &state, &out);
            if ((got_status == (as_last | wanted))
//@ if n_state
                && same(&plain.kept, &state.kept, sizeof(state.kept))
//@ else
                && same(&plain, &state, 0U)
//@ end
                && same(&good, &out, sizeof(out))) {
                refused += (j < 0) ? 1 : 0;
                held += (j >= 0) ? 1 : 0;
            }
            state = before;
        }
    }
//@ if guarded
    for (k = 0; (k <= STALE) && (ticks > 0); ++k) {
        static @n@_state before;
        static @n@_out good;
        @n@_in last = state.guard.last;
        copied(raw, &last, sizeof(last));
        raw[@first_guarded@] = (real)NAN;
        copied(&last, raw, sizeof(last));
        before = state;
        got_status = @n@_step(&last, &param, &state, &out);
        good = state.held;
@safe@
        still = (got_status == (@big@_BAD_INPUT | @big@_REFUSED))
//@ if n_state
            && same(&before.kept, &state.kept, sizeof(state.kept))
//@ else
            && same(&before, &state, 0U)
//@ end
            && same(&good, &out, sizeof(out));
    }
//@ else
    still = true; /* the model judges all of them */
//@ end
//@ end
#ifndef ON_BOARD
    misuses = misused(&param, &state);
    (void)printf("wrong parameters, states, calls and inputs: %d trials went wrong\n", misuses);
#endif
//@ if rates
#ifndef ON_BOARD
    (void)printf("stepped rate by rate: %d ticks differ\n", differently);
    wrong += differently;
#endif
//@ end
    (void)printf("%d ticks, %d faults, ", ticks, faults);
    (void)printf("%d of %d inputs are held when NaN, %d of %d beyond their ends, ", refused, @held@,
           held, N_ENDS);
    (void)printf("largest relative difference %.3g\n", most);
#ifdef ON_BOARD
    (void)printf("instructions per step: mean %.1f, most %lu; bytes of stack: at most %lu\n",
           sum / (double)((ticks > 0) ? ticks : 1), slowest, deepest);
#endif
    guarded = (ticks == 0) || (still && (refused == @held@) && (held == N_ENDS));
    return ((wrong == 0) && (faults == 0) && (misuses == 0) && guarded) ? 0 : 1;
}
