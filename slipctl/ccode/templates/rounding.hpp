// Arithmetic of float whose roundings are chosen: up, down, to zero, or at random.
//
// Each operation is done in double, where sums and products of floats are exact or nearly so, and
// its result is rounded to one of the two floats beside it; what is a float already stays, so whole
// numbers are exact. The text of a module, compiled with this as its float, gives what float
// arithmetic may give.

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

enum { UP, DOWN, TO_ZERO, AT_RANDOM };

static int rounding_mode = AT_RANDOM;
static uint64_t rounding_state = 88172645463325252ULL;

extern "C" unsigned long long rounding_operations; // so far
unsigned long long rounding_operations = 0;

extern "C" void rounding_choose(int mode, int seed)
{
    rounding_mode = mode;
    rounding_state = 88172645463325252ULL ^ ((uint64_t)(unsigned)seed << 17);
}

static inline double rounding_random()
{
    rounding_state ^= rounding_state << 13;
    rounding_state ^= rounding_state >> 7;
    rounding_state ^= rounding_state << 17;
    return (double)(rounding_state >> 11) * 0x1p-53;
}

// nextafterf of a finite number, without the call
static inline float rounding_next(float f, bool up)
{
    int32_t bits;
    if (f == 0.0f) {
        return up ? 0x1p-149f : -0x1p-149f;
    }
    memcpy(&bits, &f, sizeof(bits));
    bits += ((f > 0.0f) == up) ? 1 : -1;
    memcpy(&f, &bits, sizeof(f));
    return f;
}

static inline float rounding_of(double x)
{
    const float f = (float)x;
    ++rounding_operations;
    if ((double)f == x || !(fabs(x) < (double)FLT_MAX)) {
        return f;
    }
    const float g = rounding_next(f, (double)f < x);
    const float lo = (f < g) ? f : g;
    const float hi = (f < g) ? g : f;
    switch (rounding_mode) {
    case UP: return hi;
    case DOWN: return lo;
    case TO_ZERO: return (x > 0.0) ? lo : hi;
    default: return (rounding_random() * ((double)hi - lo) < x - lo) ? hi : lo;
    }
}

struct Rounded {
    float v;
    Rounded() = default;
    Rounded(float x) : v(x) {}
    Rounded(double x) : v(rounding_of(x)) {}
    Rounded(int x) : v((float)x) {}
    Rounded(unsigned int x) : v((float)x) {}
    explicit operator int() const { return (int)v; }
    explicit operator double() const { return (double)v; }
    Rounded operator-() const { return Rounded(-v); }
};

// 1.5 * 2^23, which rounds what is added to it to a whole number, and 4/3, which finds the spacing of
// numbers (slipctl.wichmann_hill): these two are made for rounding to nearest, and keep it
static inline bool rounding_made(Rounded a)
{
    return fabsf(a.v) == 12582912.0f;
}

static inline Rounded rounding_sum(Rounded a, Rounded b)
{
    if (rounding_made(a) || rounding_made(b)) {
        return Rounded(a.v + b.v);
    }
    return Rounded((double)a.v + b.v);
}

static inline Rounded operator+(Rounded a, Rounded b) { return rounding_sum(a, b); }
static inline Rounded operator-(Rounded a, Rounded b) { return rounding_sum(a, -b); }
static inline Rounded operator*(Rounded a, Rounded b) { return Rounded((double)a.v * b.v); }
static inline Rounded operator/(Rounded a, Rounded b)
{
    return (a.v == 4.0f && b.v == 3.0f) ? Rounded(a.v / b.v) : Rounded((double)a.v / b.v);
}
static inline Rounded &operator+=(Rounded &a, Rounded b) { return a = a + b; }
static inline Rounded &operator-=(Rounded &a, Rounded b) { return a = a - b; }
static inline Rounded &operator*=(Rounded &a, Rounded b) { return a = a * b; }
static inline Rounded &operator/=(Rounded &a, Rounded b) { return a = a / b; }
static inline bool operator<(Rounded a, Rounded b) { return a.v < b.v; }
static inline bool operator<=(Rounded a, Rounded b) { return a.v <= b.v; }
static inline bool operator>(Rounded a, Rounded b) { return a.v > b.v; }
static inline bool operator>=(Rounded a, Rounded b) { return a.v >= b.v; }
static inline bool operator==(Rounded a, Rounded b) { return a.v == b.v; }
static inline bool operator!=(Rounded a, Rounded b) { return a.v != b.v; }

#define ONE(name) \
    static inline Rounded name##f(Rounded a) { return Rounded(name((double)a.v)); }
#define TWO(name) \
    static inline Rounded name##f(Rounded a, Rounded b) \
    { return Rounded(name((double)a.v, (double)b.v)); }
ONE(acos) ONE(acosh) ONE(asin) ONE(asinh) ONE(atan) ONE(atanh) ONE(cbrt) ONE(ceil) ONE(cos)
ONE(cosh) ONE(erf) ONE(erfc) ONE(exp) ONE(exp2) ONE(expm1) ONE(fabs) ONE(floor) ONE(log)
ONE(log10) ONE(log1p) ONE(log2) ONE(round) ONE(sin) ONE(sinh) ONE(sqrt) ONE(tan) ONE(tanh)
ONE(trunc)
TWO(atan2) TWO(copysign) TWO(fdim) TWO(fmax) TWO(fmin) TWO(fmod) TWO(hypot) TWO(pow)
TWO(remainder)
#undef ONE
#undef TWO
#define float Rounded
