/* Hand-written peers of two controllers, as a firmware engineer writes them: structs, guards, status.
 *
 * sta_rls: recursive least squares of mu = c (exp(-a v) - exp(-b v)) in log c, log a, log(b - a), its
 * peak in closed form, super-twisting slip control, arbitration with the demand (subway_braking).
 * eppfc: adhesion filter by sigma points, slope and gradient search, shaped reference, prescribed
 * performance, arbitration (hst_braking, loop eppfc_gradient).
 *
 * The same guards as in generated C: an input that is NaN, infinite or off range, or a result that is
 * not finite, leaves the state and gives the last good outputs; outputs are put into their ranges.
 */
#include <float.h>
#include <math.h>
#include <string.h>

enum { OK = 0, BAD_INPUT = 1, BAD_RESULT = 2, LIMITED = 16 };

static int finite_all(const double *x, int n) {
  int k;
  for (k = 0; k < n; ++k)
    if (!(fabs(x[k]) <= DBL_MAX)) return 0;
  return 1;
}

static double clamp(double v, double lo, double hi) { return v < lo ? lo : v > hi ? hi : v; }
static double min2(double a, double b) { return a < b ? a : b; }
static double max2(double a, double b) { return a > b ? a : b; }
static double sign(double x) { return x > 0 ? 1.0 : x < 0 ? -1.0 : 0.0; }

static int limited(double *x, double lo, double hi) {
  const double y = clamp(*x, lo, hi);
  const int changed = (y != *x);
  *x = y;
  return changed;
}

/* ---- least squares and super-twisting ------------------------------------------------------- */

typedef struct { double v_s, mu, v, f, W, a_demand; } sr_in;
typedef struct {
  double noise, spread[3], forgetting, jump, cap;            /* least squares */
  double m, J, r, g;                                         /* equivalent torque */
  double share;                                              /* reference */
  double k1, k2, T, lJ, lr;                                  /* law */
  double am, aJ, ar, T_max, v_off, T_low;                    /* arbitration */
} sr_param;
typedef struct {
  double c, a, b, predicted, residual, changed, covariance[9], v_opt;
  double v_ref, T_eq, T_wanted, s, T_b, T_top, S_b, T_out;
} sr_out;
typedef struct { double theta[3], P[9], u_sw; sr_out held; } sr_state;

int sta_rls_step(const sr_in *in, const sr_param *p, sr_state *x, sr_out *out) {
  double theta[3], P[9], h[3], Ph[3], K[3], d[3], S, trace, scale;
  const double c0 = exp(x->theta[0]), a0 = exp(x->theta[1]), d0 = exp(x->theta[2]);
  const double ea = exp(-a0 * in->v_s), eb = exp(-(a0 + d0) * in->v_s);
  sr_out y;
  double u_sw;
  int i, j, status = OK;
  if (!finite_all(&in->v_s, 6)) {
    *out = x->held;
    return BAD_INPUT;
  }
  y.predicted = c0 * (ea - eb);
  y.residual = in->mu - y.predicted;
  y.changed = fabs(y.residual) > p->jump;
  memcpy(P, x->P, sizeof P);
  if (y.changed > 0 || P[0] + P[4] + P[8] == 0) {
    memset(P, 0, sizeof P);
    for (i = 0; i < 3; ++i) P[4 * i] = p->spread[i] * p->spread[i];
  }
  h[0] = y.predicted;
  h[2] = in->v_s * eb * c0 * d0;
  h[1] = in->v_s * eb * c0 * a0 - in->v_s * ea * c0 * a0;
  S = p->forgetting * p->noise * p->noise;
  for (i = 0; i < 3; ++i) {
    Ph[i] = P[i] * h[0] + P[3 + i] * h[1] + P[6 + i] * h[2];
    S += h[i] * Ph[i];
  }
  for (i = 0; i < 3; ++i) {
    K[i] = Ph[i] / S;
    theta[i] = x->theta[i] + K[i] * y.residual;
  }
  for (i = 0; i < 3; ++i)
    for (j = i; j < 3; ++j) {
      P[3 * j + i] = (P[3 * j + i] - K[i] * Ph[j]) / p->forgetting;
      P[3 * i + j] = P[3 * j + i];
    }
  trace = 0;
  for (i = 0; i < 3; ++i) trace += p->spread[i] * p->spread[i];
  scale = min2(1.0, p->cap * trace / (P[0] + P[4] + P[8]));
  for (i = 0; i < 9; ++i) P[i] *= scale;
  y.c = exp(theta[0]);
  y.a = exp(theta[1]);
  d[2] = exp(theta[2]);
  y.b = y.a + d[2];
  { /* covariance of c, a, b: M P M' with rows (c, 0, 0), (0, a, 0), (0, a, d) */
    const double c = y.c, a = y.a, e = d[2];
    double *C = y.covariance;
    C[0] = c * c * P[0];
    C[1] = C[3] = c * a * P[3];
    C[2] = C[6] = C[3] + c * e * P[6];
    C[4] = a * a * P[4];
    C[5] = C[7] = C[4] + a * e * P[7];
    C[8] = C[7] + e * (a * P[7] + e * P[8]);
  }
  y.v_opt = log(y.b / y.a) / (y.b - y.a);
  { /* slip control */
    const double F = in->mu * p->m * p->g, load = in->f + in->W;
    y.T_eq = p->J / p->r * ((F + load) / p->m + F * p->r * p->r / p->J);
    y.v_ref = min2(y.v_opt, p->share * max2(in->v, 0));
    y.s = in->v_s - y.v_ref;
    y.T_wanted = y.T_eq + p->lJ / p->lr * (x->u_sw - p->k1 * sqrt(fabs(y.s)) * sign(y.s));
    y.T_top = max2(0, min2(p->ar * (p->am * in->a_demand - load) + p->aJ * in->a_demand / p->ar,
                           in->v >= p->v_off ? p->T_max : p->T_low));
    y.T_b = min2(y.T_top, in->v >= p->v_off ? max2(0, y.T_wanted) : y.T_top);
    y.S_b = y.T_out = y.T_b;
    u_sw = x->u_sw;
    if (0 <= y.T_wanted && y.T_wanted <= y.T_top) u_sw -= p->T * p->k2 * sign(y.s);
  }
  if (!finite_all(theta, 3) || !finite_all(P, 9) || !finite_all(&u_sw, 1)
      || !finite_all(&y.c, (int)(sizeof y / sizeof(double)))) {
    *out = x->held;
    return BAD_RESULT;
  }
  memcpy(x->theta, theta, sizeof theta);
  memcpy(x->P, P, sizeof P);
  x->u_sw = u_sw;
  if (limited(&y.T_b, 0, 20000) | limited(&y.S_b, 0, 20000) | limited(&y.T_out, 0, 20000)) status = LIMITED;
  x->held = y;
  *out = y;
  return status;
}

void sta_rls_replay(int ticks, const sr_in *in, const sr_param *p, sr_state *x, sr_out *out,
                    double *states, int *status) {
  int k;
  for (k = 0; k < ticks; ++k) {
    status[k] = sta_rls_step(&in[k], p, x, &out[k]);
    memcpy(states + 13 * k, x, 13 * sizeof(double));
  }
}

/* ---- prescribed performance with filter and gradient reference ------------------------------ */

typedef struct { double omega, T_b, lam, v, a_demand; } pp_in;
typedef struct {
  double gamma, sigma, prior, drift, floor_, cap, R_w, I_w, r; /* filter */
  double rho_1, rho_2, zeta, gate, P_max, jump, settle, gain, sT;
  double h_1, rate, chi_0, near_, lo, hi, hT;
  double up, share, tau, rnear, v_off, rI, rr, rT;
  double eta_0, eta_inf, k, dl, du, K1, trip, reserve, v_min, lv_off, m, n, I, lr, T;
  double am, an, aI, ar, T_max, av_off, part;
} pp_param;
typedef struct {
  double F, variance, innovation, nis, chi, fresh, best, lam_ref, lrate, wanted, e, lower, upper;
  double lshare, restarts, T_b, T_out;
} pp_out;
typedef struct {
  double F, P, T_b, omega, begun, chi, sP, F_last, lam_f, lam_last, age, best, limited, smooth, eta;
  double count, carried;
  pp_out held;
} pp_state;

static double increment(const pp_param *p, double F, double T_b) {
  return 0.001 * ((T_b - p->r * F) / p->I_w);
}

int eppfc_step(const pp_in *in, const pp_param *p, pp_state *x, pp_out *out) {
  pp_state z = *x;
  pp_out y;
  int status = OK;
  if (!finite_all(&in->omega, 5)) {
    *out = x->held;
    return BAD_INPUT;
  }
  y.innovation = 0;
  y.nis = 0;
  if (x->begun > 0) { /* filter (22)-(30) */
    const double n = 1 + p->sigma;
    const double P = max2(x->P * min2(1 + p->gamma, max2(p->cap / x->P, 1)) + 0.001 * p->drift, 0);
    const double side = sqrt(n) * sqrt(max2(P, p->floor_));
    const double z0 = increment(p, x->F, x->T_b), zu = increment(p, x->F + side, x->T_b),
                 zd = increment(p, x->F - side, x->T_b);
    const double w0 = p->sigma / n, w = 0.5 / n, mean = w0 * z0 + w * (zu + zd);
    const double S = w0 * (z0 - mean) * (z0 - mean) +
                     w * ((zu - mean) * (zu - mean) + (zd - mean) * (zd - mean)) + 0.001 * p->R_w;
    const double cross = side * w * (zu - zd), K = cross / S;
    y.innovation = in->omega - x->omega - mean;
    y.nis = y.innovation * (y.innovation / S);
    z.F = x->F + K * y.innovation;
    z.P = max2(P - K * cross, p->floor_);
  } else {
    z.P = max2(x->P, p->floor_);
  }
  { /* slope (41)-(42) and search (40) */
    const double moved = p->gain * ((in->lam + x->lam_last) / 2 - x->lam_f), dlam = moved / p->sT;
    const double dF = (z.F - x->F_last) / p->sT, residual = dF - dlam * x->chi;
    const double rho = fabs(dF) > p->zeta ? p->rho_2 : p->rho_1;
    const double beta = x->sP * dlam / (rho + x->sP * dlam * dlam);
    const int changed = fabs(residual) > p->jump;
    int fresh;
    z.age = changed ? 0 : x->age + p->sT;
    fresh = fabs(dlam) > p->gate && z.age > p->settle;
    if (fresh) {
      z.chi = x->chi + beta * residual;
      z.sP = min2(p->P_max, (1 - beta * dlam) * x->sP / rho);
    }
    if (changed) z.sP = p->P_max;
    z.lam_f = x->lam_f + moved;
    if (fresh && fabs(in->lam - x->best) < p->near_)
      z.best = x->best - p->rate * p->hT * clamp(z.chi / p->chi_0, -1, 1);
    z.best = clamp(z.best, p->lo, p->hi);
    y.fresh = fresh;
  }
  { /* reference */
    const double fall = p->share * p->rr * p->rr * fabs(z.F) / (p->rI * max2(in->v, p->v_off));
    const double down = min2(p->up, fall) * p->rT;
    y.e = in->lam - x->smooth;
    if (fabs(y.e) < p->rnear)
      z.limited = x->limited + max2(-down, min2(p->up * p->rT, z.best - x->limited));
    y.lam_ref = x->smooth;
    y.lrate = (z.limited - x->smooth) / (p->tau + p->rT);
    z.smooth = x->smooth + p->rT * y.lrate;
  }
  { /* prescribed performance (10)-(17) */
    const int awake = in->v >= p->lv_off;
    const int tripped = y.e > p->trip * p->du * x->eta || y.e < -p->trip * p->dl * x->eta;
    const double need = max2(y.e / p->du, -(y.e / p->dl)) / p->reserve;
    const double eta = tripped ? max2(p->eta_0, need) : x->eta;
    const double s = clamp(y.e / eta, -0.999999999 * p->dl, 0.999999999 * p->du);
    const double eps = log((s + p->dl) / (p->du - s)) / 2;
    const double pull = p->K1 * eps * eta * (s + p->dl) * (p->du - s) / ((p->dl + p->du) / 2);
    const double over = eta - p->eta_inf, shown =
        awake ? x->eta : max2(eta, fabs(y.e) / min2(p->dl, p->du));
    const double nu = y.lrate - (pull + y.e * (p->k * over) / eta);
    y.wanted = p->lr * z.F - p->I * max2(in->v, p->v_min) / p->lr * nu +
               p->I * p->n * (1 - in->lam) * z.F / (p->m * p->lr);
    z.eta = p->eta_inf + over * exp(-p->k * p->T);
    z.count = x->count + (tripped && awake);
    y.lower = -p->dl * shown;
    y.upper = p->du * shown;
    y.lshare = max2(y.e / y.upper, y.e / y.lower);
  }
  { /* arbitration */
    const int awake = in->v >= p->av_off;
    const double demand = p->ar * p->am * in->a_demand / p->an + p->aI * in->a_demand / p->ar;
    z.carried = awake ? fabs(z.F) : x->carried;
    y.T_b = -min2(demand, awake ? min2(p->T_max, max2(0, -y.wanted)) : p->part * p->ar * z.carried);
  }
  z.T_b = in->T_b;
  z.omega = in->omega;
  z.begun = 1;
  z.F_last = z.F;
  z.lam_last = in->lam;
  y.F = z.F;
  y.variance = z.P;
  y.chi = z.chi;
  y.best = z.best;
  y.restarts = z.count;
  y.T_out = y.T_b;
  if (!finite_all(&z.F, 17) || !finite_all(&y.F, 17)) {
    *out = x->held;
    return BAD_RESULT;
  }
  if (limited(&y.T_b, -20000, 0) | limited(&y.T_out, -20000, 0)) status = LIMITED;
  z.held = y;
  *x = z;
  *out = y;
  return status;
}

void eppfc_replay(int ticks, const pp_in *in, const pp_param *p, pp_state *x, pp_out *out,
                  double *states, int *status) {
  int k;
  for (k = 0; k < ticks; ++k) {
    status[k] = eppfc_step(&in[k], p, x, &out[k]);
    memcpy(states + 17 * k, x, 17 * sizeof(double));
  }
}
