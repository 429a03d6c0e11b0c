#include <float.h>
#include <math.h>
#include <string.h>
#include <time.h>

static int rounding_mode;
static unsigned rounding_state;

extern "C" void rounding_choose(int mode, int seed)
{
    rounding_mode = mode;
    rounding_state = 2463534242u + (unsigned)seed;
}

static double rounding_beside(double y)
{
    int side = 0;
    switch (rounding_mode) {
    case 0: side = 1; break;
    case 1: side = -1; break;
    case 2: side = (y > 0.0) ? -1 : 1; break;
    default:
        rounding_state ^= rounding_state << 13;
        rounding_state ^= rounding_state >> 17;
        rounding_state ^= rounding_state << 5;
        side = (int)(rounding_state % 3u) - 1;
    }
    return (side == 0) ? y : nextafter(y, (side > 0) ? HUGE_VAL : -HUGE_VAL);
}
@moved@
