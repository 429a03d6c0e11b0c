/* One search by differential evolution, as a C programmer would write it: whole numbers for the
   generator, indices and comparisons on whole numbers, no function call but exp. Same decisions and
   same order of operations as slipctl's block, so that the results agree bit for bit.

   Included by de.c with NAME, and with
     SKIP    1: a trial that is a copy of its parent is not evaluated; 0: every trial is
     DRAW    what advances the generator g and gives three numbers x, y, z below X, Y, Z. */

double NAME(generator *state, const double *curve, double *value)
{
    generator g = *state;
    double old[2 * NP]; /* twice, so that an index past the end needs no wrapping */
    double new[NP], val[NP];
    const double share = CROSSOVER * X;
    int i, gen, best = 0;
    for (i = 0; i < NP; ++i) {
        uint32_t x, y, z;
        double u;
        DRAW;
        u = x * (1.0 / X) + y * (1.0 / Y) + z * (1.0 / Z);
        old[i] = old[i + NP] = LO + (HI - LO) * (u - (int)u);
        val[i] = mu(old[i], curve);
    }
    for (gen = 1; gen <= GM; ++gen) {
        const double F = F0 * exp(LN2 * exp(1 - (double)GM / (GM + 1 - gen)));
        for (i = 0; i < NP; ++i) {
            const double *q = old + i + 1;
            uint32_t x, y, z, o1, o2, o3;
            double v, f;
            int trial, better;
            DRAW;
            x *= NP - 1;
            o1 = x / X;
            trial = x - o1 * X < share;
#if SKIP
            if (!trial) {
                new[i] = old[i];
                continue;
            }
#endif
            o2 = y * (NP - 2) / Y;
            o3 = z * (NP - 3) / Z;
            o3 += o3 >= o2;
            o3 += o3 >= o1;
            o2 += o2 >= o1;
            v = q[o1] + F * (q[o2] - q[o3]);
            if (v < LO) v = 2 * LO - v;
            if (v > HI) v = 2 * HI - v;
            f = mu(v, curve);
            better = trial & (f >= val[i]);
            new[i] = better ? v : old[i];
            val[i] = better ? f : val[i];
        }
        memcpy(old, new, sizeof new);
        memcpy(old + NP, new, sizeof new);
    }
    for (i = 1; i < NP; ++i)
        if (val[i] > val[best]) best = i;
    *state = g;
    *value = val[best];
    return old[best];
}

#undef NAME
#undef SKIP
#undef DRAW
