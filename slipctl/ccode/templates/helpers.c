/* Small functions that the C of a module may call, each behind those that it calls. */

static double square(double x)
{
    return x * x;
}

static double lesser(double x, double y)
{
    return ((y < x) || (x != x)) ? y : x; /* as fmin */
}

static double greater(double x, double y)
{
    return ((y > x) || (x != x)) ? y : x; /* as fmax */
}

static double below(double x, double bound)
{
    return (x < bound) ? x : bound; /* NaN: bound */
}

static double above(double x, double bound)
{
    return (x > bound) ? x : bound; /* NaN: bound */
}

static double at_most(double x, double bound)
{
    return (x <= bound) ? x : bound;
}

static double at_least(double x, double bound)
{
    return (x >= bound) ? x : bound;
}

/* derivative of the smaller of x and y by x: 1 or 0, and half where they are equal */
static double slope_of_lesser(double x, double y)
{
    return ((x <= y) ? 1.0 : 0.0) / (((y <= x) ? 1.0 : 0.0) + ((x <= y) ? 1.0 : 0.0));
}

/* the element that a number names by its whole part; NaN beyond the ends */
static double element(const double *x, int n, double at)
{
    return ((at > -1.0) && (at < (double)n)) ? x[(int)at] : (double)NAN;
}

/* z = x y, of matrices in columns */
static void matrix_product(const double *x, int rows, int inner, const double *y,
                           int columns, double *z)
{
    for (int i = 0; i < columns; ++i) {
        for (int j = 0; j < rows; ++j) {
            z[j + i * rows] = 0.0;
            for (int k = 0; k < inner; ++k) {
                z[j + i * rows] += x[j + k * rows] * y[k + i * inner];
            }
        }
    }
}

/* z = z + x y, of matrices in columns */
static void add_matrix_product(const double *x, int rows, int inner, const double *y,
                               int columns, double *z)
{
    for (int i = 0; i < columns; ++i) {
        for (int j = 0; j < rows; ++j) {
            for (int k = 0; k < inner; ++k) {
                z[j + i * rows] += x[j + k * rows] * y[k + i * inner];
            }
        }
    }
}

/* z = z + x y: numbers of x column by column, which begin there, in these rows */
static void add_sparse_product(const double *x, const int *begin, const int *row,
                               int columns, const double *y, double *z)
{
    for (int i = 0; i < columns; ++i) {
        for (int k = begin[i]; k < begin[i + 1]; ++k) {
            z[row[k]] += x[k] * y[i];
        }
    }
}

/* last of n rising places that x has reached; the first if none, or if x is NaN */
static int reached(const double *at, int n, double x)
{
    int low = 0;
    int high = n;
    while ((high - low) > 1) {
        const int middle = (low + high) / 2;
        if (x >= at[middle]) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

static double sign_of(double x)
{
    return (x < 0.0) ? -1.0 : ((x > 0.0) ? 1.0 : x);
}

static void copy(double *to, const double *from, int n)
{
    for (int k = 0; k < n; ++k) { to[k] = from[k]; }
}

static void fill(double *x, int n, double value)
{
    for (int k = 0; k < n; ++k) { x[k] = value; }
}

static unsigned int limit(double *x, double lo, double hi)
{
    if ((*x >= lo) && (*x <= hi)) { return 0U; }
    *x = (*x > hi) ? hi : lo; /* NaN: lo */
    return LIMITED_;
}

static unsigned int limit_all(double *x, int n, double lo, double hi)
{
    unsigned int limited = 0U;
    for (int k = 0; k < n; ++k) { limited |= limit(&x[k], lo, hi); }
    return limited;
}

static bool within(double x, double lo, double hi) { return (x >= lo) && (x <= hi); }

static bool all_within(const double *x, int n, double lo, double hi)
{
    for (int k = 0; k < n; ++k) {
        if (!within(x[k], lo, hi)) { return false; }
    }
    return true;
}

static bool rising(const double *x, int n)
{
    for (int k = 1; k < n; ++k) {
        if (!(x[k] > x[k - 1])) { return false; }
    }
    return true;
}

static double zero_of(const double *x, int n)
{
    double zero = 0.0;
    for (int k = 0; k < n; ++k) { zero *= x[k]; }
    return zero;
}

static bool can_follow(double x, double last, double change) { return fabs(x - last) <= change; }

static bool all_can_follow(const double *x, int n, const double *last, double change)
{
    for (int k = 0; k < n; ++k) {
        if (!can_follow(x[k], last[k], change)) { return false; }
    }
    return true;
}

static unsigned int hand_over(double value, double *last)
{
    *last = value;
    return within(value, -DBL_MAX, DBL_MAX) ? 0U : BAD_INPUT_;
}

static unsigned int hand_over_all(const double *value, int n, double *last)
{
    unsigned int told = 0U;
    for (int k = 0; k < n; ++k) { told |= hand_over(value[k], &last[k]); }
    return told;
}

static unsigned int accept(double value, double lo, double hi, double change, double noise,
                           int stale, double *last, int *age, unsigned int *back)
{
    const bool unknown = (*age < 0) || (*age >= FORGOTTEN);
    const bool anything = unknown || (change >= DBL_MAX);
    const double way = fabs(value - *last);
    const bool follows = anything || (way <= noise + change) || (*back == 0U);
    const bool stays = (*age >= 0) && (*age < stale); /* its last good value is taken */
    const bool again = *age > 1; /* it was not good for a while before */
    if ((value >= lo) && (value <= hi)
        && (anything || (way <= noise + change * ((double)*age + 1.0)))) {
        *last = value;
        *age = (*age > 1) ? (*age - 1) : 0;
        *back = 0U;
        if (again) { *back = 1U; }
        return follows ? (again ? UNSURE : 0U) : OFF_RANGE_;
    }
    if ((*age >= 0) && (*age < FORGOTTEN)) { *age += 1; }
    *back = 0U;
    return ((fabs(value) <= DBL_MAX) ? OFF_RANGE_ : BAD_INPUT_) | (stays ? 0U : REFUSED_);
}

static unsigned int accept_all(const double *value, int n, double lo, double hi, double change,
                               double noise, int stale, double *last, int *age, unsigned int *back)
{
    unsigned int told = 0U;
    for (int k = 0; k < n; ++k) {
        told |= accept(value[k], lo, hi, change, noise, stale, &last[k], &age[k], &back[k]);
    }
    return told;
}

static double later(double tick, double missed, double ticks)
{
    const double whole = tick + missed;
    const double rest = whole - ticks * floor(whole / ticks);
    return ((0.0 <= rest) && (rest < ticks)) ? rest : 0.0;
}
