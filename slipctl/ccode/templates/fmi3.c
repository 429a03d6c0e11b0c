@head@

@core@

/* ---- FMI 3.0 for Co-Simulation -------------------------------------------------------------- */

#ifdef FMI3_FUNCTION_PREFIX
#define JOINED(a, b) a##b
#define JOIN(a, b) JOINED(a, b)
#define F(name) JOIN(FMI3_FUNCTION_PREFIX, name)
#else
#define F(name) name
#endif

typedef void (*logged)(void *environment, int status, const char *category, const char *message);

static void say3(const instance *c, int status, const char *text)
{
    ((logged)c->logger)(c->environment, status, "events", text);
}

EXPORT const char *F(fmi3GetVersion)(void)
{
    return "3.0";
}

EXPORT void *F(fmi3InstantiateCoSimulation)(
    const char *name, const char *token, const char *resources, bool visible, bool logging,
    bool events, bool early, const uint32_t between[], size_t n, void *environment, logged log,
    void (*update)(void *, double, bool, bool, bool, bool, bool *, double *))
{
    instance *c = made(name, token, logging);
    if (c != NULL) {
        c->logger = (any)log;
        c->environment = environment;
        c->say = say3;
    }
    return c;
}

EXPORT void *F(fmi3InstantiateModelExchange)(const char *name, const char *token,
                                             const char *resources, bool visible, bool logging,
                                             void *environment, logged log)
{
    return NULL;
}

EXPORT void *F(fmi3InstantiateScheduledExecution)(const char *name, const char *token,
                                                  const char *resources, bool visible, bool logging,
                                                  void *environment, logged log,
                                                  void (*clock)(void *), void (*lock)(void),
                                                  void (*unlock)(void))
{
    return F(fmi3InstantiateModelExchange)(name, token, resources, visible, logging, environment,
                                           log);
}

EXPORT void F(fmi3FreeInstance)(void *c)
{
    free(c);
}

EXPORT int F(fmi3SetDebugLogging)(void *c, bool on, size_t n, const char *const categories[])
{
    ((instance *)c)->logging = on;
    return FINE;
}

EXPORT int F(fmi3EnterInitializationMode)(void *c, bool toleranced, double tolerance, double start,
                                          bool stops, double stop)
{
    ((instance *)c)->m.start = start;
    return FINE;
}

EXPORT int F(fmi3ExitInitializationMode)(void *c)
{
    return begin((instance *)c);
}

EXPORT int F(fmi3Terminate)(void *c)
{
    return FINE;
}

EXPORT int F(fmi3Reset)(void *c)
{
    reset(&((instance *)c)->m);
    return FINE;
}

EXPORT int F(fmi3GetFloat64)(void *c, const uint32_t vr[], size_t n, double v[], size_t k)
{
    return (k == n) ? read_real((instance *)c, vr, n, v)
                    : tell((instance *)c, WRONG, "every variable is one number");
}

EXPORT int F(fmi3SetFloat64)(void *c, const uint32_t vr[], size_t n, const double v[], size_t k)
{
    return (k == n) ? write_real((instance *)c, vr, n, v)
                    : tell((instance *)c, WRONG, "every variable is one number");
}

EXPORT int F(fmi3GetInt32)(void *c, const uint32_t vr[], size_t n, int32_t v[], size_t count)
{
    size_t k;
    for (k = 0; k < n; ++k) {
        if ((vr[k] != (uint32_t)STATUS) || (count != n)) {
            return tell((instance *)c, WRONG, "no integer variable has this value reference");
        }
        v[k] = ((instance *)c)->m.status;
    }
    return FINE;
}

EXPORT int F(fmi3DoStep)(void *c, double time, double size, bool final, bool *event, bool *stop,
                         bool *early, double *reached)
{
    instance *i = (instance *)c;
    const int status = advance(i, time, size);
    *event = false;
    *stop = false;
    *early = false;
    *reached = i->m.now;
    return status;
}

EXPORT int F(fmi3GetFMUState)(void *c, void **state)
{
    return keep((instance *)c, state);
}

EXPORT int F(fmi3SetFMUState)(void *c, void *state)
{
    ((instance *)c)->m = *(model *)state;
    return FINE;
}

EXPORT int F(fmi3FreeFMUState)(void *c, void **state)
{
    free(*state);
    *state = NULL;
    return FINE;
}

EXPORT int F(fmi3SerializedFMUStateSize)(void *c, void *state, size_t *size)
{
    *size = sizeof(serialized);
    return FINE;
}

EXPORT int F(fmi3SerializeFMUState)(void *c, void *state, uint8_t bytes[], size_t size)
{
    return pack((instance *)c, state, bytes, size);
}

EXPORT int F(fmi3DeserializeFMUState)(void *c, const uint8_t bytes[], size_t size, void **state)
{
    return unpack((instance *)c, bytes, size, state);
}

/* What this module has no use for. */
#define ABSENT(name, arguments) EXPORT int F(name) arguments { return WRONG; }
#define THESE void *c, const uint32_t vr[], size_t n
#define NO_VARIABLES(get, set, type) \
    ABSENT(get, (THESE, type v[], size_t k)) ABSENT(set, (THESE, const type v[], size_t k))

NO_VARIABLES(fmi3GetFloat32, fmi3SetFloat32, float)
NO_VARIABLES(fmi3GetInt8, fmi3SetInt8, int8_t)
NO_VARIABLES(fmi3GetUInt8, fmi3SetUInt8, uint8_t)
NO_VARIABLES(fmi3GetInt16, fmi3SetInt16, int16_t)
NO_VARIABLES(fmi3GetUInt16, fmi3SetUInt16, uint16_t)
NO_VARIABLES(fmi3GetUInt32, fmi3SetUInt32, uint32_t)
NO_VARIABLES(fmi3GetInt64, fmi3SetInt64, int64_t)
NO_VARIABLES(fmi3GetUInt64, fmi3SetUInt64, uint64_t)
NO_VARIABLES(fmi3GetBoolean, fmi3SetBoolean, bool)

ABSENT(fmi3SetInt32, (THESE, const int32_t v[], size_t k))
ABSENT(fmi3GetString, (THESE, const char *v[], size_t k))
ABSENT(fmi3SetString, (THESE, const char *const v[], size_t k))
ABSENT(fmi3GetBinary, (THESE, size_t sizes[], const uint8_t *v[], size_t k))
ABSENT(fmi3SetBinary, (THESE, const size_t sizes[], const uint8_t *const v[], size_t k))
ABSENT(fmi3GetClock, (THESE, bool v[]))
ABSENT(fmi3SetClock, (THESE, const bool v[]))
ABSENT(fmi3GetNumberOfVariableDependencies, (void *c, uint32_t vr, size_t *n))
ABSENT(fmi3GetVariableDependencies, (void *c, uint32_t vr, size_t i[], uint32_t known[], size_t j[],
                                     int kinds[], size_t n))
ABSENT(fmi3GetDirectionalDerivative, (THESE, const uint32_t known[], size_t k, const double seed[],
                                      size_t seeds, double v[], size_t values))
ABSENT(fmi3GetAdjointDerivative, (THESE, const uint32_t known[], size_t k, const double seed[],
                                  size_t seeds, double v[], size_t values))
ABSENT(fmi3EnterEventMode, (void *c))
ABSENT(fmi3EnterConfigurationMode, (void *c))
ABSENT(fmi3ExitConfigurationMode, (void *c))
ABSENT(fmi3GetIntervalDecimal, (THESE, double v[], int kinds[]))
ABSENT(fmi3GetIntervalFraction, (THESE, uint64_t v[], uint64_t resolutions[], int kinds[]))
ABSENT(fmi3GetShiftDecimal, (THESE, double v[]))
ABSENT(fmi3GetShiftFraction, (THESE, uint64_t v[], uint64_t resolutions[]))
ABSENT(fmi3SetIntervalDecimal, (THESE, const double v[]))
ABSENT(fmi3SetIntervalFraction, (THESE, const uint64_t v[], const uint64_t resolutions[]))
ABSENT(fmi3SetShiftDecimal, (THESE, const double v[]))
ABSENT(fmi3SetShiftFraction, (THESE, const uint64_t v[], const uint64_t resolutions[]))
ABSENT(fmi3EvaluateDiscreteStates, (void *c))
ABSENT(fmi3UpdateDiscreteStates, (void *c, bool *update, bool *stop, bool *nominals, bool *values,
                                  bool *timed, double *next))
ABSENT(fmi3EnterContinuousTimeMode, (void *c))
ABSENT(fmi3CompletedIntegratorStep, (void *c, bool final, bool *event, bool *stop))
ABSENT(fmi3SetTime, (void *c, double time))
ABSENT(fmi3SetContinuousStates, (void *c, const double x[], size_t n))
ABSENT(fmi3GetContinuousStateDerivatives, (void *c, double d[], size_t n))
ABSENT(fmi3GetEventIndicators, (void *c, double z[], size_t n))
ABSENT(fmi3GetContinuousStates, (void *c, double x[], size_t n))
ABSENT(fmi3GetNominalsOfContinuousStates, (void *c, double x[], size_t n))
ABSENT(fmi3GetNumberOfEventIndicators, (void *c, size_t *n))
ABSENT(fmi3GetNumberOfContinuousStates, (void *c, size_t *n))
ABSENT(fmi3EnterStepMode, (void *c))
ABSENT(fmi3GetOutputDerivatives, (THESE, const int32_t orders[], double v[], size_t k))
ABSENT(fmi3ActivateModelPartition, (void *c, uint32_t clock, double time))
