#include "@n@.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

#define TOKEN "@token@"
#define PERIOD @period@ /* s; 0 where the module has no tick */
#define NOW @now@ /* outputs are those of the present state and inputs, not of the last tick */
#define MOST 1e9 /* ticks of one communication step */

typedef @real@ real;

/* Numbers of the variables: inputs, parameters, derived parameters, states, outputs, status. */
enum {
    FIRST_PARAM = @n_in@,
    FIRST_DERIVED = FIRST_PARAM + @n_param@,
    FIRST_STATE = FIRST_DERIVED + @n_derived@,
    FIRST_OUT = FIRST_STATE + @n_state@,
    STATUS = FIRST_OUT + @n_out@,
    TIME = STATUS + 1,
    STATES = @n_state@
};

enum status { FINE, WARNING, DISCARD, WRONG, FATAL };

/* All that changes; a copy of it is a state of the FMU. */
typedef struct {
    @n@_in in;
    @n@_param param;
    @n@_state state;
    @n@_out out;
    double start; /* time of the first tick */
    double now;   /* where the last communication step ended */
    double ticks; /* ticks done */
    int status;   /* of the last communication step */
    bool begun;   /* initialization is over */
    bool fresh;   /* the outputs are up to date */
    bool chosen;  /* a start value was set */
    bool given[STATES + 1];
    real first[STATES + 1]; /* the start values that were set */
    real seen[STATES + 1];  /* numbers of the states, as they were read last */
} model;

typedef struct {
    char token[sizeof(TOKEN)];
    model copy;
} serialized;

typedef void (*any)(void); /* a function of a type that the version of the interface knows */

typedef struct instance {
    model m;
    void *environment;
    any logger;
    void (*say)(const struct instance *c, int status, const char *text);
    bool logging;
    char name[128];
} instance;

static int tell(const instance *c, int status, const char *text)
{
    if (c->logging && (c->logger != NULL)) {
        c->say(c, status, text);
    }
    return status;
}

static void reset(model *m)
{
    (void)memset(m, 0, sizeof(*m));
    @n@_default(&m->param);
@inputs@
}

static instance *made(const char *name, const char *token, bool logging)
{
    instance *c = NULL;
    if ((token != NULL) && (strcmp(token, TOKEN) == 0)) {
        c = (instance *)calloc(1, sizeof(instance));
    }
    if (c != NULL) {
        (void)strncpy(c->name, (name != NULL) ? name : "@n@", sizeof(c->name) - 1U);
        c->logging = logging;
        reset(&c->m);
    }
    return c;
}

//@ if n_state
@access@

//@ end
//@ if helpers
@helpers@

//@ end
/* Start state: of the module, then what was set, then what is computed from either. */
static int start(model *m)
{
    int status = @n@_init(&m->param, &m->state);
    if (m->chosen) {
        int k;
        status = @n@_tune(&m->param, &m->state);
//@ if n_state
        numbers_of(&m->state.kept, m->seen);
//@ end
        for (k = 0; k < STATES; ++k) {
            m->seen[k] = m->given[k] ? m->first[k] : m->seen[k];
        }
//@ if n_state
        take_numbers(m->seen, &m->state.kept);
//@ end
@starts@
        if (@wrong@) {
            status = @big@_BAD_PARAM;
        }
    }
    m->out = m->state.held;
    return status;
}

/* Outputs of the present state and inputs; the state stays. */
static void look(model *m)
{
    if (!m->begun) {
        m->status = start(m);
    }
    if ((NOW != 0) && !m->fresh) {
        @n@_state ahead = m->state;
        (void)@n@_step(&m->in, &m->param, &ahead, &m->out);
        m->fresh = true;
    }
}

static int number_of(uint32_t reference)
{
    return (reference <= (uint32_t)TIME) ? (int)reference : TIME + 1;
}

/* Where real variable k is kept; NULL if it is none. */
static real *place(model *m, int k)
{
    real *found = NULL;
@places@
    return found;
}

static int read_real(instance *c, const uint32_t *variables, size_t count, double *values)
{
    model *const m = &c->m;
    size_t k;
    look(m);
//@ if n_state
    numbers_of(&m->state.kept, m->seen);
//@ end
    for (k = 0; k < count; ++k) {
        const int v = number_of(variables[k]);
        const real *found = place(m, v);
        if (v == TIME) {
            values[k] = m->begun ? m->now : m->start;
        } else if (found == NULL) {
            return tell(c, WRONG, "no real variable has this value reference");
        } else {
            values[k] = (double)*found;
        }
    }
    return FINE;
}

/* Whether variable k can be set now: start values until the initialization is over. */
static bool settable(const model *m, int k)
{
    return (k < FIRST_DERIVED) || (!m->begun && (k >= FIRST_STATE) && (k < FIRST_OUT));
}

/* Inputs, parameters, start values; what the module refuses is not taken. */
static int write_real(instance *c, const uint32_t *variables, size_t count, const double *values)
{
    const @n@_param before = c->m.param;
    bool tuned = false;
    size_t k;
    for (k = 0; k < count; ++k) {
        const int v = number_of(variables[k]);
        real *found = place(&c->m, v);
        if ((found == NULL) || !settable(&c->m, v)) {
            return tell(c, WRONG, "this variable cannot be set, or not after the initialization");
        }
        if (v >= FIRST_STATE) {
            c->m.first[v - FIRST_STATE] = (real)values[k];
            c->m.given[v - FIRST_STATE] = true;
            c->m.chosen = true;
        } else {
            *found = (real)values[k];
        }
        tuned = tuned || (v >= FIRST_PARAM);
    }
    c->m.fresh = false;
    if (tuned && c->m.begun && (@n@_tune(&c->m.param, &c->m.state) != 0)) {
        c->m.param = before;
        return tell(c, DISCARD, "a parameter is out of range; the old values stay");
    }
    return FINE;
}

static int begin(instance *c)
{
    c->m.status = start(&c->m);
    if (c->m.status != 0) {
        return tell(c, WRONG, "a parameter or start value is out of range");
    }
    c->m.now = c->m.start;
    c->m.begun = true;
    c->m.fresh = false;
    return FINE;
}

/* Ticks that are done when a communication step ends there: a controller has done those that begin
 * before it, a plant those that end by then. What lies between two ticks holds the last one. */
static double due(const model *m, double end)
{
    const double passed = (end - m->start) / PERIOD;
    const double slack = 1e-6 + (1e-12 * fabs(passed));
    return (NOW != 0) ? floor(passed + slack) : ceil(passed - slack);
}

/* Run the ticks of a communication step of any size. */
static int advance(instance *c, double time, double size)
{
    const double period = PERIOD;
    const double end = time + size;
    double ticks = 1.0;
    int worst = 0;
    if (!c->m.begun) {
        return tell(c, WRONG, "a step before the end of the initialization");
    }
    if (period > 0.0) {
        if (!(fabs(time - c->m.now) <= (0.01 * period) + (1e-12 * fabs(time)))) {
            return tell(c, WRONG, "the communication point is not where the last step ended");
        }
        ticks = due(&c->m, end) - c->m.ticks;
    }
    if (!(size >= 0.0) || !(ticks <= MOST)) {
        return tell(c, WRONG, "the communication step size is no number of seconds");
    }
    for (; ticks > 0.5; ticks -= 1.0) {
        worst |= @n@_step(&c->m.in, &c->m.param, &c->m.state, &c->m.out);
        c->m.ticks += 1.0;
    }
    c->m.now = end;
    c->m.start = (period > 0.0) ? c->m.start : end;
    c->m.status = worst;
    c->m.fresh = false;
    if ((worst & ~(int)@big@_LIMITED) != 0) {
        return tell(c, WARNING, "a tick was refused: its outputs are held or safe, its state is kept");
    }
    return FINE;
}

static int keep(const instance *c, void **state)
{
    model *copy = (*state != NULL) ? (model *)*state : (model *)malloc(sizeof(model));
    if (copy == NULL) {
        return tell(c, FATAL, "out of memory");
    }
    *copy = c->m;
    *state = copy;
    return FINE;
}

static int pack(const instance *c, const void *state, uint8_t *bytes, size_t size)
{
    serialized whole;
    if ((state == NULL) || (size < sizeof(whole))) {
        return tell(c, WRONG, "too few bytes for a state");
    }
    (void)memset(&whole, 0, sizeof(whole));
    (void)memcpy(whole.token, TOKEN, sizeof(TOKEN));
    (void)memcpy(&whole.copy, state, sizeof(model));
    (void)memcpy(bytes, &whole, sizeof(whole));
    return FINE;
}

static int unpack(const instance *c, const uint8_t *bytes, size_t size, void **state)
{
    serialized whole;
    model *copy;
    if (size < sizeof(whole)) {
        return tell(c, WRONG, "too few bytes for a state");
    }
    (void)memcpy(&whole, bytes, sizeof(whole));
    if (memcmp(whole.token, TOKEN, sizeof(TOKEN)) != 0) {
        return tell(c, WRONG, "these are not the bytes of a state of this FMU");
    }
    copy = (*state != NULL) ? (model *)*state : (model *)malloc(sizeof(model));
    if (copy == NULL) {
        return tell(c, FATAL, "out of memory");
    }
    *copy = whole.copy;
    *state = copy;
    return FINE;
}
