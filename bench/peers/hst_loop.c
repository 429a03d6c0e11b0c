/* Hand-written peer of the loop `eppfc_gradient` of hst_braking: plant by RK4 in ten substeps,
   adhesion filter by sigma points, slope and gradient search, shaped reference, prescribed
   performance, arbitration. Same equations and order; it logs as many numbers as the toolkit. */
#include <math.h>

typedef struct {
  double m, n, I, r, g, v_0, omega_0;              /* plant, SI units */
  double a0, a1, a2, c0, c1, c2, vf, theta, P_max; /* adhesion, resistance, brake */
  double sigma_w;                                  /* noise of the wheel speed */
  double gamma, sigma, floor_, R_w;                /* filter */
  double rho_1, rho_2, zeta, gate, P_top, jump, settle, gain;
  double rate, chi_0, near_, lo, hi;               /* search */
  double up, share, tau, near_ref, v_off;          /* shaper */
  double eta_0, eta_inf, k, dl, du, K1, trip, reserve, v_min;
  double T_max, part, T;
} peer_param;

enum { NX = 20, NY = 27 };

static double clamp(double v, double lo, double hi) { return fmin(hi, fmax(lo, v)); }

static double slip_ratio(const peer_param* q, double v, double omega) {
  return (v - q->r * omega) / fmax(fabs(v), q->v_0);
}

static double adhesion(const peer_param* q, double lam) {
  return -(q->a0 * (1 - exp(-q->a1 * lam)) - q->a2 * lam);
}

static double resistance(const peer_param* q, double v) {
  return (q->c0 + q->c1 * v + q->c2 * v * v) * clamp(v / q->vf, -1, 1);
}

static void rates(const peer_param* q, const double* x, double T_b, double* d) {
  const double F = q->m * q->g / q->n * adhesion(q, slip_ratio(q, x[1], x[2]));
  const double T = T_b * clamp(x[2] / q->omega_0, -1, 1);
  d[0] = x[1];
  d[1] = (q->n * F - resistance(q, x[1])) / q->m;
  d[2] = (T - q->r * F) / q->I;
}

static double model(const peer_param* q, double F, double T_b) {
  return (T_b - q->r * F) / q->I * q->T;
}

/* x: 0 position, 1 speed, 2 wheel speed, 3 F, 4 P, 5 torque held, 6 wheel speed held, 7 begun,
   8 chi, 9 P of the slope, 10 F last, 11 slip lagged, 12 slip last, 13 age, 14 best, 15 limited,
   16 smooth, 17 eta, 18 restarts, 19 carried. */
void peer_loop(long ticks, double* x, const double* lam_opt, const double* noise, double a_demand,
               const peer_param* q, double* xlog, double* ylog) {
  const double T = q->T, h = T / 10, decay = exp(-q->k * T);
  long tick;
  int i, j;
  for (tick = 0; tick < ticks; ++tick) {
    double* y = ylog + NY * tick;
    const double v = x[1];
    const double lam = slip_ratio(q, v, x[2]), mu = adhesion(q, lam), F_R = resistance(q, v);
    const double F_z = q->m * q->g / q->n, F_true = F_z * mu;
    const double omega = x[2] + q->sigma_w * noise[tick];
    double F = x[3], P = x[4], innovation = 0, nis = 0;
    for (i = 0; i < NX; ++i) xlog[NX * tick + i] = x[i];
    if (x[7] > 0.5) { /* filter (22)-(30) */
      const double P_minus = (1 + q->gamma) * P, side = sqrt((1 + q->sigma) * P_minus);
      const double w0 = q->sigma / (1 + q->sigma), w = 1 / (2 * (1 + q->sigma));
      const double z0 = model(q, F, x[5]), zu = model(q, F + side, x[5]),
                   zd = model(q, F - side, x[5]);
      const double z = w0 * z0 + w * (zu + zd);
      const double cross = w * side * (zu - zd);
      const double S = w0 * (z0 - z) * (z0 - z) + w * ((zu - z) * (zu - z) + (zd - z) * (zd - z)) +
                       q->R_w * T;
      const double K = cross / S;
      innovation = omega - x[6] - z;
      nis = innovation * innovation / S;
      F += K * innovation;
      P = fmax(P_minus - K * cross, q->floor_);
    }
    { /* slope (41)-(42) and search (40) */
      const double mean = (lam + x[12]) / 2, lam_f = x[11] + q->gain * (mean - x[11]);
      const double dF = (F - x[10]) / T, dlam = (lam_f - x[11]) / T, residual = dF - dlam * x[8];
      const double rho = fabs(dF) > q->zeta ? q->rho_2 : q->rho_1;
      const int changed = fabs(residual) > q->jump;
      const double age = changed ? 0 : x[13] + T;
      const int moving = fabs(dlam) > q->gate && age > q->settle;
      const double beta = x[9] * dlam / (rho + x[9] * dlam * dlam);
      const double chi = moving ? x[8] + beta * residual : x[8];
      const double P_now = moving ? fmin(q->P_top, (1 - beta * dlam) * x[9] / rho) : x[9];
      const int followed = fabs(lam - x[14]) < q->near_ && moving;
      const double move = followed ? q->rate * T * clamp(chi / q->chi_0, -1, 1) : 0;
      const double best = clamp(x[14] - move, q->lo, q->hi);
      /* reference */
      const double down =
          fmin(q->up, q->share * q->r * q->r * fabs(F) / (q->I * fmax(v, q->v_off)));
      const double moved = x[15] + clamp(best - x[15], -down * T, q->up * T);
      const double limited = fabs(lam - x[16]) < q->near_ref ? moved : x[15];
      const double lam_ref = x[16], rate = (limited - x[16]) / (q->tau + T);
      /* prescribed performance (10)-(17) */
      const double e = lam - lam_ref;
      const int awake = v >= q->v_off;
      const int tripped = e > q->trip * q->du * x[17] || e < -q->trip * q->dl * x[17];
      const double wider = fmax(q->eta_0, fmax(e / q->du, -e / q->dl) / q->reserve);
      const double eta = tripped ? wider : x[17];
      const double zeta = clamp(e / eta, -q->dl * (1 - 1e-9), q->du * (1 - 1e-9));
      const double eps = log((zeta + q->dl) / (q->du - zeta)) / 2;
      const double deta = -q->k * (eta - q->eta_inf), speed = fmax(v, q->v_min);
      const double pull =
          q->K1 * eps * eta * (zeta + q->dl) * (q->du - zeta) / ((q->dl + q->du) / 2);
      const double nu = -pull + e * deta / eta + rate;
      const double wanted = q->r * F - q->I * speed / q->r * nu +
                            q->I * q->n * (1 - lam) * F / (q->m * q->r);
      const double shown = awake ? x[17] : fmax(eta, fabs(e) / fmin(q->dl, q->du));
      const double upper = q->du * shown, lower = -q->dl * shown;
      const double count = x[18] + (tripped && awake);
      /* arbitration */
      const double demand = q->r * q->m * a_demand / q->n + q->I * a_demand / q->r;
      const double kept = awake ? fabs(F) : x[19];
      const double allowed = awake ? fmin(q->T_max, fmax(0, -wanted)) : q->part * q->r * kept;
      const double T_cmd = -fmin(demand, allowed);
      const double P_c = fmax(0, fmin(q->P_max, T_cmd / q->theta)), T_b = q->theta * P_c;
      double k1[3], k2[3], k3[3], k4[3], z[3];
      y[0] = lam; y[1] = v - q->r * x[2]; y[2] = F_true; y[3] = (q->n * F_true - F_R) / q->m;
      y[4] = mu; y[5] = F_R; y[6] = T_b; y[7] = P_c; y[8] = omega; y[9] = F; y[10] = P;
      y[11] = innovation; y[12] = nis; y[13] = chi; y[14] = moving; y[15] = best; y[16] = lam_ref;
      y[17] = rate; y[18] = wanted; y[19] = e; y[20] = lower; y[21] = upper;
      y[22] = fmax(e / upper, e / lower); y[23] = count; y[24] = T_cmd; y[25] = T_cmd;
      y[26] = lam_opt[tick];
      x[3] = F; x[4] = P; x[5] = T_b; x[6] = omega; x[7] = 1;
      x[8] = chi; x[9] = changed ? q->P_top : P_now; x[10] = F; x[11] = lam_f; x[12] = lam;
      x[13] = age; x[14] = best; x[15] = limited; x[16] = lam_ref + T * rate;
      x[17] = q->eta_inf + (eta - q->eta_inf) * decay; x[18] = count; x[19] = kept;
      for (j = 0; j < 10; ++j) {
        rates(q, x, T_b, k1);
        for (i = 0; i < 3; ++i) z[i] = x[i] + h / 2 * k1[i];
        rates(q, z, T_b, k2);
        for (i = 0; i < 3; ++i) z[i] = x[i] + h / 2 * k2[i];
        rates(q, z, T_b, k3);
        for (i = 0; i < 3; ++i) z[i] = x[i] + h * k3[i];
        rates(q, z, T_b, k4);
        for (i = 0; i < 3; ++i) x[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
      }
    }
  }
}
