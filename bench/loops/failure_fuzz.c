/* libFuzzer tries to break what the failure concept of a vehicle's controller promises: see bench/failure_fuzz.py.
 * Any bits on the sensors of the first axle, at any time and for as long as it likes:
 *  (a) every output is finite, each command lies between 0 and the demand. While the believed speed is the one that
 *      is believed without the fault, the commands of the other axles are the same bits.
 *  (b) an axle that is not ready gets the demand within the largest torque, rising no faster than its rate.
 *  (c) no axle is released for longer than its limit without a break. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include HDR
#define CAT2(a, b) a##b
#define CAT(a, b) CAT2(a, b)
#define F(x) CAT(M, x)
#define LIMIT 0.4 /* s; the file has 10: shorter, so that an input comes to it */
#define TICK par.safe_T
typedef F(_in) in_t;
typedef F(_out) out_t;
typedef F(_state) st_t;
typedef F(_param) par_t;

enum { N = (int)(sizeof(((in_t *)0)->omega) / sizeof(double)), RECORD = 20 };

static void check_finite(const out_t *out)
{
    const double *all = (const double *)out;
    for (size_t k = 0; k < sizeof *out / sizeof(double); ++k) {
        if (!isfinite(all[k])) { abort(); }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static st_t right, wrong;
    static out_t was, now;
    static par_t par;
    static in_t in;
    double v = 20.0, torque[N] = {0}, let_go[N] = {0}, before[N];
    int alike = 1;
    F(_default)(&par);
    par.safe_limit = par.safe_limit_still = par.trust_limit = LIMIT;
    if (F(_init)(&par, &right) != 0 || F(_init)(&par, &wrong) != 0) { abort(); }
    for (int i = 0; i < N; ++i) { before[i] = par.safe_T_max; }
    /* a record: bits of omega and torque, demand, slip of the others, what is spoiled, ticks */
    for (; size >= RECORD; data += RECORD, size -= RECORD) {
        double bits[2];
        memcpy(bits, data, sizeof bits);
        const double demand = par.safe_T_max * data[16] / 200.0, slip = data[17] / 64.0;
        const double top = fmin(demand, par.safe_T_max);
        for (int t = 0; t <= data[19]; ++t) {
            memset(&in, 0, sizeof in);
            in.v = v;
            in.T_demand = demand;
            for (int i = 0; i < N; ++i) {
                in.omega[i] = (v > slip) ? (v - slip) / par.trust_r : 0.0;
                in.T[i] = torque[i];
            }
            F(_step)(&in, &par, &right, &was);
            if ((data[18] & 1) != 0) { in.omega[0] = bits[0]; }
            if ((data[18] & 2) != 0) { in.T[0] = bits[1]; }
            F(_step)(&in, &par, &wrong, &now);
            check_finite(&now);
            alike = alike && (was.trust_v == now.trust_v) && (was.trust_retry == now.trust_retry);
            double force = 0.0;
            for (int i = 0; i < N; ++i) {
                const double rising = fmin(top, before[i] + par.safe_rate * par.safe_T_max * par.safe_T);
                if (now.T_cmd[i] < 0.0 || now.T_cmd[i] > top) { abort(); }
                if (alike && i > 0 && now.T_cmd[i] != was.T_cmd[i]) { abort(); }
                if (now.trust_ready[i] < 0.5 && now.T_cmd[i] != rising) { abort(); }
                const int low = top > 0.02 * par.safe_T_max && now.T_cmd[i] < 0.1 * top;
                let_go[i] = low ? let_go[i] + TICK : 0.0;
                /* from zero to a tenth of the demand takes less than 10 ms */
                if (let_go[i] > LIMIT + 0.02) { abort(); }
                before[i] = now.T_cmd[i];
                torque[i] += TICK / 0.06 * (was.T_cmd[i] - torque[i]);
                force += torque[i];
            }
            v = fmax(v - TICK * force / (par.trust_r * N * par.trust_m), 0.0);
        }
    }
    return 0;
}
