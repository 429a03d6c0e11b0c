/* Hand-written peer of the loop `sta` of subway_braking: plant by RK4 in ten substeps, super-
   twisting slip control, everything logged that the toolkit logs. Same equations, same order. */
#include <math.h>

typedef struct {
  double c, a, b;          /* adhesion: height [1], decays [s/m] */
  double k0, k1, k2;       /* air: [N], [N s/m], [N s^2/m^2] */
  double kappa, lr, lt, kc;/* curve: [1/m], [m], [m], [m] */
  double m, J, r, g;       /* [kg], [kg m^2], [m], [m/s^2] */
  double omega0, T_max;    /* [rad/s], [N m] */
  double K1, K2, T;        /* super-twisting gains, sample period [s] */
  double share, v_off, T_low;
} peer_param;

static double clamp(double v, double lo, double hi) { return fmin(hi, fmax(lo, v)); }

static void rate(const peer_param* q, const double* x, double T_b, double W, double* d) {
  const double vs = x[1] - q->r * x[2];
  const double mu = q->c * (exp(-q->a * vs) - exp(-q->b * vs));
  const double F = mu * q->m * q->g;
  const double f = q->k0 + q->k1 * x[1] + q->k2 * x[1] * x[1];
  d[0] = x[1];
  d[1] = -(F + f + W) / q->m;
  d[2] = (q->r * F - T_b * clamp(x[2] / q->omega0, -1, 1)) / q->J;
  d[3] = x[2];
}

/* x: position, speed, wheel speed, wheel angle, integral. y: 17 outputs a tick. */
void peer_loop(long ticks, double* x, const double* v_opt, const double* mu_max,
               const peer_param* q, double* xlog, double* ylog) {
  const double h = q->T / 10;
  long k;
  for (k = 0; k < ticks; ++k) {
    double* y = ylog + 17 * k;
    const double vs = x[1] - q->r * x[2];
    const double mu = q->c * (exp(-q->a * vs) - exp(-q->b * vs));
    const double W = q->kc * q->kappa * fmin(1, q->lr / q->lt) * q->m * q->g;
    const double f = q->k0 + q->k1 * x[1] + q->k2 * x[1] * x[1];
    const double F = mu * q->m * q->g;
    const double v_ref = fmin(v_opt[k], q->share * fmax(x[1], 0));
    const double Phi = -(F + f + W) / q->m - F * q->r * q->r / q->J;
    const double T_eq = -(q->J / q->r) * Phi;
    const double s = vs - v_ref;
    const double sg = (s > 0) - (s < 0);
    const double wanted = T_eq + (q->J / q->r) * (-q->K1 * sqrt(fabs(s)) * sg + x[4]);
    const double a_dem = 10.0;
    const double T_dem = q->r * (q->m * a_dem - f - W) + q->J * a_dem / q->r;
    const int awake = x[1] >= q->v_off;
    const double top = fmax(0, fmin(T_dem, awake ? q->T_max : q->T_low));
    const double T_cmd = fmin(top, awake ? fmax(0, wanted) : top);
    const double T_b = clamp(T_cmd, 0, q->T_max);
    double k1[4], k2[4], k3[4], k4[4], z[4];
    int i, j;
    for (i = 0; i < 5; ++i) xlog[5 * k + i] = x[i];
    y[0] = vs; y[1] = F; y[2] = (F + f + W) / q->m; y[3] = mu; y[4] = f; y[5] = W; y[6] = T_b;
    y[7] = v_opt[k]; y[8] = mu_max[k]; y[9] = v_ref; y[10] = T_eq; y[11] = wanted; y[12] = s;
    y[13] = T_cmd; y[14] = top; y[15] = T_cmd; y[16] = mu;
    if (wanted >= 0 && wanted <= top) x[4] -= q->T * q->K2 * sg;
    for (j = 0; j < 10; ++j) {
      rate(q, x, T_b, W, k1);
      for (i = 0; i < 4; ++i) z[i] = x[i] + h / 2 * k1[i];
      rate(q, z, T_b, W, k2);
      for (i = 0; i < 4; ++i) z[i] = x[i] + h / 2 * k2[i];
      rate(q, z, T_b, W, k3);
      for (i = 0; i < 4; ++i) z[i] = x[i] + h * k3[i];
      rate(q, z, T_b, W, k4);
      for (i = 0; i < 4; ++i) x[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    }
  }
}
