/* Loads an FMU's library of FMI 2.0 at run time and prints what it gives, bit for bit.
   arguments: library, token, step in s, then for each tick the value of variable 0; prints the
   value of the variable named by OUT after each step as an exact hexadecimal number. */
#include <stdio.h>
#include <stdlib.h>
#include <windows.h>

typedef void *(*instantiate_t)(const char *, int, const char *, const char *, const void *, int, int);
typedef int (*setup_t)(void *, int, double, double, int, double);
typedef int (*plain_t)(void *);
typedef int (*set_t)(void *, const unsigned *, size_t, const double *);
typedef int (*get_t)(void *, const unsigned *, size_t, double *);
typedef int (*step_t)(void *, double, double, int);

static void logger(void *e, const char *n, int s, const char *c, const char *m, ...) {
    (void)e; (void)n; (void)s; (void)c; fprintf(stderr, "%s\n", m);
}

int main(int argc, char **argv) {
    struct { void *log; void *(*make)(size_t, size_t); void (*drop)(void *); void *f; void *e; }
        callbacks = {(void *)logger, calloc, free, NULL, NULL};
    HMODULE library = LoadLibraryA(argv[1]);
    if (!library) { fprintf(stderr, "cannot load: %lu\n", GetLastError()); return 1; }
    void *c = ((instantiate_t)(void *)GetProcAddress(library, "fmi2Instantiate"))(
        "one", 1, argv[2], "", &callbacks, 0, 0);
    double h = atof(argv[3]), u, y;
    unsigned in = 0, out = (unsigned)atoi(argv[4]);
    if (!c) return 2;
    ((setup_t)(void *)GetProcAddress(library, "fmi2SetupExperiment"))(c, 0, 0.0, 0.0, 0, 0.0);
    ((plain_t)(void *)GetProcAddress(library, "fmi2EnterInitializationMode"))(c);
    ((plain_t)(void *)GetProcAddress(library, "fmi2ExitInitializationMode"))(c);
    for (int k = 5; k < argc; ++k) {
        u = atof(argv[k]);
        if (((set_t)(void *)GetProcAddress(library, "fmi2SetReal"))(c, &in, 1, &u)) return 3;
        if (((step_t)(void *)GetProcAddress(library, "fmi2DoStep"))(c, (k - 5) * h, h, 1)) return 4;
        if (((get_t)(void *)GetProcAddress(library, "fmi2GetReal"))(c, &out, 1, &y)) return 5;
        printf("%a\n", y);
    }
    ((plain_t)(void *)GetProcAddress(library, "fmi2Terminate"))(c);
    return 0;
}
