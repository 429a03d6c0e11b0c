#ifndef ON_BOARD
#define RECOVERY @recovery@ /* ticks in which every part of the state is reset */
#define TAKEN @taken@ /* ticks after which any input is taken again */
#define N_FIRSTS @firsts@
#define STEPS @steps@ /* after which no further state is broken: some modules take long */
#define SHAKEN @shaken@ /* ticks with numbers that were shaken, */
#define LONGER @longer@ /* of these so many that go on from there for a while */
#define SEVERITY 3

static const int first_of[] = {@places@}; /* place of the first element of each state */
static const double bad[SEVERITY] = {(double)NAN, -1e30, 1e30};
static const double param_of[][2] = {@ends@}; /* ranges of parameters */
//@ if n_in
static const double input_of[N_IN][3] = {@wandered@}; /* and the largest change */
//@ end

/* A number from 0 to 1 that looks like chance. */
static double drawn(void)
{
    static unsigned int seed = 1U;
    seed = (seed * 1664525U) + 1013904223U;
    return (double)(seed >> 8) / 16777216.0;
}

/* One between two ends, often an end. */
static double between(const double *end)
{
    return end[0] + ((end[1] - end[0]) * fmin(fmax((1.5 * drawn()) - 0.25, 0.0), 1.0));
}

//@ if n_state
@take@

//@ end
/* Make a step; whether its outputs are finite. */
static bool stepped(const @n@_in *in, @n@_state *state, int *status)
{
    static @n@_param any; /* those in force are used */
    static @n@_out out;
    static real raw[N_ROW];
    bool finite = true;
    int k;
    *status = @n@_step(in, &any, state, &out);
    copied(raw, &out, (size_t)N_OUT * sizeof(real));
    for (k = 0; k < N_OUT; ++k) {
        finite = finite && (fabs((double)raw[k]) <= DBL_MAX);
    }
    return finite;
}

/* Steps with the same inputs until all is well, which is to come in some ticks. */
static bool recovers(const @n@_in *in, @n@_state *state, int ticks)
{
    int status = @big@_REFUSED;
    int tick;
    bool finite = true;
    for (tick = 0; (tick < ticks) && ((status | @big@_LIMITED) != @big@_LIMITED); ++tick) {
        finite = stepped(in, state, &status) && finite;
    }
    return finite && ((status | @big@_LIMITED) == @big@_LIMITED);
}

/* Parameters that are wrong are refused, and those in force stay. */
static int wrong_parameters(const @n@_param *good, const @n@_state *kept)
{
    static @n@_param param;
    static @n@_param safe;
    static @n@_state state;
    static real raw[N_ROW];
    int wrong = 0;
    int k;
    int j;
    @n@_default(&safe);
    for (k = 0; k < N_PARAM; ++k) {
        for (j = 0; j < (SEVERITY + 2); ++j) {
            copied(raw, good, (size_t)N_PARAM * sizeof(real));
            raw[k] = (real)((j < SEVERITY) ? bad[j] : param_of[k][j - SEVERITY]);
            copied(&param, raw, (size_t)N_PARAM * sizeof(real));
            copied(&state, kept, sizeof(state));
            if (@n@_tune(&param, &state) == @big@_OK) {
                wrong += (j == 0) ? 1 : 0; /* NaN is in no range */
            } else {
                wrong += same(&state, kept, sizeof(state)) ? 0 : 1;
                wrong += (@n@_init(&param, &state) == @big@_BAD_PARAM) ? 0 : 1;
                wrong += same(&state.in_force, &safe, sizeof(safe)) ? 0 : 1;
            }
        }
    }
    return wrong;
}

/* Memory that is broken: a parameter in force, until tune; a state, with outputs finite. */
static int broken_memory(const @n@_in *in, const @n@_param *good, const @n@_state *kept)
{
    static @n@_state state;
    static @n@_param param;
    static real raw[N_ROW];
    bool refused = false;
    int wrong = 0;
    int steps = 0;
    int tick;
    int k;
    int j;
    for (k = 0; k < @damages@; ++k) { /* one, at last all of them */
        int status = @big@_OK;
        copied(&state, kept, sizeof(state));
        copied(raw, good, (size_t)N_PARAM * sizeof(real));
        for (j = 0; j < N_PARAM; ++j) {
            raw[j] = ((j == (k / SEVERITY)) || ((k / SEVERITY) == N_PARAM))
                ? (real)bad[k % SEVERITY] : raw[j];
        }
        copied(&param, raw, (size_t)N_PARAM * sizeof(real));
        state.in_force = param; /* as if a bit of memory had changed: ends of ranges may be NaN */
        (void)stepped(in, &state, &status);
        if (((status & @big@_REFUSED) != 0) && !refused) {
            refused = true; /* once is enough: all parts are reset in turn, and again */
            for (tick = 0; tick < (2 * RECOVERY); ++tick) {
                (void)stepped(in, &state, &status);
            }
        }
        wrong += (@n@_tune(good, &state) == @big@_OK) ? 0 : 1;
        wrong += recovers(in, &state, RECOVERY) ? 0 : 1;
    }
    for (k = 0; (k < N_FIRSTS) && (steps < STEPS); ++k) {
        for (j = 0; j < SEVERITY; ++j) {
            copied(&state, kept, sizeof(state));
//@ if n_state
            numbers_of(&state.kept, raw);
//@ end
            raw[first_of[k]] = (real)bad[j];
//@ if n_state
            take_numbers(raw, &state.kept);
//@ end
            for (tick = 0; (tick < RECOVERY) && !recovers(in, &state, 1); ++tick) {
                ++steps;
            }
            wrong += (tick < RECOVERY) ? 0 : 1;
        }
    }
    return wrong;
}

/* States, parameters and inputs as no run has them; outputs are finite. */
static int shaken(const @n@_in *from, const @n@_param *good, const @n@_state *kept)
{
    static const double factor[4][2] = {
        {0.0, 2.0}, {-10.0, 10.0}, {-1e3, 1e3}, {-1e9, 1e9}
    };
    static const double around[] = {0.5, 2.0};
    static @n@_state state;
    static @n@_param param;
    static @n@_in in;
    static real raw[N_ROW];
    int wrong = 0;
    int k;
    int j;
    copied(&in, from, sizeof(in));
    for (k = 0; k < SHAKEN; ++k) {
        int ticks = @most@;
        int shake;
        int status = @big@_OK;
        if (k >= LONGER) {
            ticks = @least@;
        }
        shake = k / ticks;
        if ((k % ticks) == 0) {
            copied(&state, kept, sizeof(state));
            copied(raw, good, (size_t)N_PARAM * sizeof(real));
            for (j = 0; j < N_PARAM; ++j) {
                double x = (double)raw[j] * between(around);
                x = ((shake % 3) > 1) ? between(param_of[j]) : x;
                x = fmin(fmax(x, param_of[j][0]), param_of[j][1]);
                raw[j] = ((shake % 3) > 0) ? (real)x : raw[j];
            }
            copied(&param, raw, (size_t)N_PARAM * sizeof(real));
            (void)@n@_tune(&param, &state); /* which may refuse them */
//@ if n_state
            numbers_of(&state.kept, raw);
//@ end
            for (j = 0; j < N_STATE; ++j) {
                const double x = between(factor[(shake / 3) % 4]);
                const double of = (fabs((double)raw[j]) > 0.0) ? (double)raw[j] : 1.0;
                raw[j] = (drawn() < 0.5) ? raw[j] : (real)(of * (((shake % 2) > 0) ? floor(x) : x));
            }
//@ if n_state
            take_numbers(raw, &state.kept);
//@ end
        }
//@ if n_in
        if (((shake % 2) > 0) || ((k % ticks) == 0)) {
            copied(raw, from, sizeof(in));
            for (j = 0; j < N_IN; ++j) {
                const double x = (double)raw[j] * between(around);
                raw[j] = (real)(((shake % 4) > 1) ? x : between(input_of[j]));
                raw[j] = (real)fmin(fmax((double)raw[j], input_of[j][0]), input_of[j][1]);
            }
            copied(&in, raw, sizeof(in));
            copied(&state.guard.last, raw, sizeof(in)); /* as if they had been so before */
        }
//@ end
        wrong += stepped(&in, &state, &status) ? 0 : 1;
    }
    return wrong;
}

//@ if n_in
/* From good inputs one jumps, to an end or further than it can; then all is well. */
static int jumping(const @n@_in *good, const @n@_state *kept)
{
    static @n@_state state;
    static @n@_in in;
    static real raw[N_IN];
    int wrong = 0;
    int k;
    int j;
    for (k = 0; k < @jumps@; ++k) {
        const double *range = input_of[k / 4];
        int status = @big@_OK;
        double jump;
        copied(&state, kept, sizeof(state));
        for (j = 0; (j < TAKEN) && (state.guard.fresh == 0U); ++j) {
            wrong += stepped(good, &state, &status) ? 0 : 1;
        }
        copied(raw, good, sizeof(in));
        jump = (double)raw[k / 4] + ((((k % 4) == 2) ? 1.5 : -1.5) * range[2]);
        raw[k / 4] = (real)(((k % 4) < 2) ? range[k % 4] : fmin(fmax(jump, range[0]), range[1]));
        copied(&in, raw, sizeof(in));
        wrong += stepped(&in, &state, &status) ? 0 : 1;
        wrong += recovers(good, &state, TAKEN) ? 0 : 1;
    }
    return wrong;
}

/* Inputs wander, some NaN or infinite, at last all NaN; outputs are finite. */
static int wandering(const @n@_in *from, @n@_state *state)
{
    static const double rate[4] = {0.9, 0.1, 0.01, 10.0};
    static double target[N_IN];
    static double now[N_IN];
    static real raw[N_IN];
    static @n@_in in;
    int wrong = 0;
    int status = 0;
    int tick;
    int k;
    copied(raw, from, sizeof(raw));
    for (k = 0; k < N_IN; ++k) {
        now[k] = (double)raw[k];
    }
    for (tick = 0; tick < @ticks@; ++tick) {
        for (k = 0; k < N_IN; ++k) {
            const double most = input_of[k][2] * rate[(tick / 50) % 4];
            const double share = drawn();
            target[k] = ((tick % 50) == 0) ? between(input_of[k]) : target[k];
            now[k] = fmin(fmax(target[k], now[k] - most), now[k] + most);
            raw[k] = (real)((share < 0.002) ? (double)NAN : now[k]);
            raw[k] = (share > 0.999) ? (real)INFINITY : raw[k];
        }
        if ((tick % 50) == 25) { /* a jump of one of them, for a tick */
            k = (tick / 200) % N_IN;
            raw[k] = (real)(((now[k] - input_of[k][0]) > (input_of[k][1] - now[k])) ? input_of[k][0]
                : input_of[k][1]);
        }
        copied(&in, raw, sizeof(in));
        wrong += stepped(&in, state, &status) ? 0 : 1;
//@ if coupled
        if ((status & @big@_OFF_RANGE) != 0) { /* on from what fits the others */
            copied(raw, &state->guard.last, sizeof(raw));
            for (k = 0; k < N_IN; ++k) {
                now[k] = (double)raw[k];
            }
        }
//@ end
    }
    for (k = 0; k < N_IN; ++k) {
        raw[k] = (real)NAN;
    }
    copied(&in, raw, sizeof(in));
    for (tick = 0; tick < TAKEN; ++tick) { /* until the last good ones are forgotten */
        wrong += stepped(&in, state, &status) ? 0 : 1;
    }
    return wrong;
}

//@ end
//@ if counter
/* Calls by the number of their tick: in turn, twice, behind the largest, late, back. */
static int miscounted(const @n@_in *in, const @n@_state *kept)
{
    static const unsigned int tick[9] = {7U, 8U, 8U, 0xFFFFFFFFU, 0U, 0U, 3U, 2U, 3U};
    static const bool again[9] = {false, false, true, false, false, true, false, false, false};
    static const bool timely[9] = {true, true, false, false, true, false, false, false, true};
    static @n@_param any; /* those in force are used */
    static @n@_state plain;
    static @n@_state state;
    static @n@_state before;
    static @n@_out good;
    static @n@_out out;
    int wrong = 0;
    int k;
    copied(&state, kept, sizeof(state));
    for (k = 0; k < 9; ++k) {
        int wanted = @big@_TIMING | @big@_REFUSED;
        int got;
        copied(&before, &state, sizeof(state));
        copied(&plain, &state, sizeof(state));
        got = @n@_step_counted(in, &any, &state, &out, tick[k]);
        if (again[k]) {
            wrong += same(&before, &state, sizeof(state)) ? 0 : 1;
        } else {
//@ if late
            if (!timely[k]) { /* as if the ticks between had gone by without inputs */
                const unsigned int since = tick[k] - tick[k - 1] - 1U;
//@ if n_in
                int j;
                for (j = 0; j < N_IN; ++j) {
                    const unsigned int left = @memory@U - (unsigned int)plain.guard.age[j];
                    const int older = (since < left) ? (plain.guard.age[j] + (int)since) : @memory@;
                    plain.guard.age[j] = (plain.guard.age[j] < 0) ? -1 : older;
                    plain.guard.back[j] = 0U;
                }
                plain.guard.fresh = 0U;
//@ end
//@ if counters
                plain.guard.missed += since;
//@ end
            }
//@ end
            wanted = @n@_step(in, &any, &plain, &good);
            wanted |= timely[k] ? 0 : @big@_TIMING;
            wrong += same(&out, &good, sizeof(out)) ? 0 : 1;
//@ if n_state
            wrong += same(&plain.kept, &state.kept, sizeof(state.kept)) ? 0 : 1;
//@ else
            wrong += same(&plain, &state, 0U) ? 0 : 1;
//@ end
        }
        wrong += (got == wanted) ? 0 : 1;
    }
    return wrong;
}

//@ end
/* Use the module wrongly in every way; how many trials did not go as they should. */
static int misused(const @n@_param *param, const @n@_state *kept)
{
    static @n@_state state;
    const @n@_in in = @last@;
    int wrong = 0;
    int trials;
    int status = 0;
    bool able;
    (void)memset(&state, 0x55, sizeof(state));
    wrong += stepped(&in, &state, &status) ? 0 : 1;
    wrong += (status == (@big@_NO_INIT | @big@_REFUSED)) ? 0 : 1;
    wrong += wrong_parameters(param, kept);
    wrong += (@n@_init(param, &state) == @big@_OK) ? 0 : 1;
    able = recovers(&in, &state, 1); /* a fresh instance can do something with these inputs */
    trials = broken_memory(&in, param, kept);
    trials += shaken(&in, param, kept);
//@ if n_in
    trials += jumping(&in, kept);
    copied(&state, kept, sizeof(state));
    trials += wandering(&in, &state);
    trials += recovers(&in, &state, TAKEN) ? 0 : 1;
//@ end
//@ if counter
    trials += miscounted(&in, kept);
//@ end
    return wrong + (able ? trials : 0);
}
#endif
