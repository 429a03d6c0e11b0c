/* Hand-written peers of the search over an adhesion curve: 50 members, 300 generations. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#define NP 50
#define GM 300
#define LO 0.01
#define HI 10.0
#define CROSSOVER 0.6
#define F0 0.5
#define LN2 0.69314718055994530942
#define X 30269u
#define Y 30307u
#define Z 30323u

typedef struct { uint32_t x, y, z; } generator;

static double mu(double v, const double *c) { return c[0] * (exp(-c[1] * v) - exp(-c[2] * v)); }

#define WICHMANN_HILL                                                                             \
    (g.x = 171 * g.x % X, g.y = 172 * g.y % Y, g.z = 170 * g.z % Z, x = g.x, y = g.y, z = g.z)

/* xorshift32 of Marsaglia, one call a member; its bits are split into three numbers */
#define XORSHIFT                                                                                  \
    (g.x ^= g.x << 13, g.x ^= g.x >> 17, g.x ^= g.x << 5, x = ((g.x & 0x7fff) * X) >> 15,         \
     y = ((g.x >> 9 & 0x7fff) * Y) >> 15, z = ((g.x >> 17) * Z) >> 15)

#define NAME every_trial
#define SKIP 0
#define DRAW WICHMANN_HILL
#include "de_loop.h"

#define NAME without_copies
#define SKIP 1
#define DRAW WICHMANN_HILL
#include "de_loop.h"

#define NAME faster_generator
#define SKIP 0
#define DRAW XORSHIFT
#include "de_loop.h"

/* which: 0 every trial, 1 without copies, 2 every trial with a faster generator.
   curves: rows of (c, a, b); found: rows of (place, value); rng: state before and after. */
void peer_de(int which, long searches, double *rng, const double *curves, double *found)
{
    double (*const peers[3])(generator *, const double *, double *) = {
        every_trial, without_copies, faster_generator
    };
    generator g = {(uint32_t)rng[0], (uint32_t)rng[1], (uint32_t)rng[2]};
    long k;
    for (k = 0; k < searches; ++k)
        found[2 * k] = peers[which](&g, curves + 3 * k, &found[2 * k + 1]);
    rng[0] = g.x;
    rng[1] = g.y;
    rng[2] = g.z;
}
