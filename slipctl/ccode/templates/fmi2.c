@head@

@core@

/* ---- FMI 2.0 for Co-Simulation -------------------------------------------------------------- */

#ifdef FMI2_FUNCTION_PREFIX
#define JOINED(a, b) a##b
#define JOIN(a, b) JOINED(a, b)
#define F(name) JOIN(FMI2_FUNCTION_PREFIX, name)
#else
#define F(name) name
#endif

typedef void (*logged)(void *environment, const char *name, int status, const char *category,
                       const char *message, ...);

typedef struct {
    logged log;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *object);
    void (*finished)(void *environment, int status);
    void *environment;
} callbacks;

static void say2(const instance *c, int status, const char *text)
{
    ((logged)c->logger)(c->environment, c->name, status, "events", "%s", text);
}

EXPORT const char *F(fmi2GetTypesPlatform)(void)
{
    return "default";
}

EXPORT const char *F(fmi2GetVersion)(void)
{
    return "2.0";
}

EXPORT void *F(fmi2Instantiate)(const char *name, int type, const char *guid, const char *resources,
                                const callbacks *functions, int visible, int logging)
{
    instance *c = (type == 1) ? made(name, guid, logging != 0) : NULL;
    if (c != NULL) {
        c->logger = (functions != NULL) ? (any)functions->log : NULL;
        c->environment = (functions != NULL) ? functions->environment : NULL;
        c->say = say2;
    }
    return c;
}

EXPORT void F(fmi2FreeInstance)(void *c)
{
    free(c);
}

EXPORT int F(fmi2SetDebugLogging)(void *c, int on, size_t n, const char *const categories[])
{
    ((instance *)c)->logging = (on != 0);
    return FINE;
}

EXPORT int F(fmi2SetupExperiment)(void *c, int toleranced, double tolerance, double start,
                                  int stops, double stop)
{
    ((instance *)c)->m.start = start;
    return FINE;
}

EXPORT int F(fmi2EnterInitializationMode)(void *c)
{
    return FINE;
}

EXPORT int F(fmi2ExitInitializationMode)(void *c)
{
    return begin((instance *)c);
}

EXPORT int F(fmi2Terminate)(void *c)
{
    return FINE;
}

EXPORT int F(fmi2Reset)(void *c)
{
    reset(&((instance *)c)->m);
    return FINE;
}

EXPORT int F(fmi2GetReal)(void *c, const uint32_t vr[], size_t n, double v[])
{
    return read_real((instance *)c, vr, n, v);
}

EXPORT int F(fmi2SetReal)(void *c, const uint32_t vr[], size_t n, const double v[])
{
    return write_real((instance *)c, vr, n, v);
}

EXPORT int F(fmi2GetInteger)(void *c, const uint32_t vr[], size_t n, int v[])
{
    size_t k;
    for (k = 0; k < n; ++k) {
        if (vr[k] != (uint32_t)STATUS) {
            return tell((instance *)c, WRONG, "no integer variable has this value reference");
        }
        v[k] = ((instance *)c)->m.status;
    }
    return FINE;
}

EXPORT int F(fmi2DoStep)(void *c, double time, double size, int final)
{
    return advance((instance *)c, time, size);
}

EXPORT int F(fmi2GetRealStatus)(void *c, int kind, double *v)
{
    const model *m = &((instance *)c)->m;
    *v = m->begun ? m->now : m->start;
    return (kind == 2) ? FINE : DISCARD; /* last successful time */
}

EXPORT int F(fmi2GetBooleanStatus)(void *c, int kind, int *v)
{
    *v = 0;
    return (kind == 3) ? FINE : DISCARD; /* terminated */
}

EXPORT int F(fmi2GetFMUstate)(void *c, void **state)
{
    return keep((instance *)c, state);
}

EXPORT int F(fmi2SetFMUstate)(void *c, void *state)
{
    ((instance *)c)->m = *(model *)state;
    return FINE;
}

EXPORT int F(fmi2FreeFMUstate)(void *c, void **state)
{
    free(*state);
    *state = NULL;
    return FINE;
}

EXPORT int F(fmi2SerializedFMUstateSize)(void *c, void *state, size_t *size)
{
    *size = sizeof(serialized);
    return FINE;
}

EXPORT int F(fmi2SerializeFMUstate)(void *c, void *state, uint8_t bytes[], size_t size)
{
    return pack((instance *)c, state, bytes, size);
}

EXPORT int F(fmi2DeSerializeFMUstate)(void *c, const uint8_t bytes[], size_t size, void **state)
{
    return unpack((instance *)c, bytes, size, state);
}

/* What this module has no use for. */
#define ABSENT(name, arguments) EXPORT int F(name) arguments { return WRONG; }
#define THESE void *c, const uint32_t vr[], size_t n

ABSENT(fmi2GetBoolean, (THESE, int v[]))
ABSENT(fmi2GetString, (THESE, const char *v[]))
ABSENT(fmi2SetInteger, (THESE, const int v[]))
ABSENT(fmi2SetBoolean, (THESE, const int v[]))
ABSENT(fmi2SetString, (THESE, const char *const v[]))
ABSENT(fmi2GetDirectionalDerivative,
       (THESE, const uint32_t known[], size_t k, const double seed[], double v[]))
ABSENT(fmi2SetRealInputDerivatives, (THESE, const int order[], const double v[]))
ABSENT(fmi2GetRealOutputDerivatives, (THESE, const int order[], double v[]))
ABSENT(fmi2CancelStep, (void *c))
ABSENT(fmi2GetStatus, (void *c, int kind, int *v))
ABSENT(fmi2GetIntegerStatus, (void *c, int kind, int *v))
ABSENT(fmi2GetStringStatus, (void *c, int kind, const char **v))
