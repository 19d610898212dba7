/* Whole-cycle ramps: changes of velocity under one jerk limit.

   A ramp from (v0, a0) to (v, 0) in m cycles is the node sequence
       a_k = median(low_k, L, high_k),
       low_k = max(a0 - J k, -J (m - k)),  high_k = min(a0 + J k, J (m - k)),
   which changes by at most J a cycle for any real level L: minima and maxima of such sequences are
   such sequences. The change of velocity grows with L, so m is the smallest duration whose range
   holds it. Where three phases (rise, hold, fall; the paper's T1-T3 with its one level, Eqs.
   9-13) fit the same m, they are used.

   Never here: a distance to be met, a choice between methods. */
#include "planner/_internal.h"

/* Velocity change of the ramp of m cycles with level `l`: from a0 at full jerk to l, held, at full
   jerk to zero. The sum of the nodes,
       a0 / 2 + sum of a_k over 1 <= k < m,
   with n1 nodes before the level and n3 behind it. */
static double level_change(double a0, double m, double l, double j, double *n1, double *n3)
{
    double d = l >= a0 ? j : -j, e = l >= 0 ? j : -j;
    *n1 = whole(fabs(l - a0) / j);
    *n3 = whole(fabs(l) / j);
    return a0 / 2 + a0 * *n1 + d * *n1 * (*n1 + 1) / 2 + l * (m - 1 - *n1 - *n3) +
           e * *n3 * (*n3 + 1) / 2;
}

/* The whole-cycle ramp (v0, a0) -> (v0 + dv, 0) of m cycles under one jerk limit. 0: there is none, and
   *lacks is by how many cycles of the full level at least; else whether x holds it. */
static int ramp_of(double v0, double a0, double dv, double vmax, double au, double ad, double j,
                   double m, double *lacks, path *x)
{
    double z = a0 * fabs(a0) / (2 * j);
    double hi = least(au, (a0 + j * m) / 2), lo = most(-ad, (a0 - j * m) / 2), n1, n3;
    double room = 1e-13 * (fabs(dv) + fabs(z) + fabs(a0));
    double top = level_change(a0, m, hi, j, &n1, &n3);
    double bottom = level_change(a0, m, lo, j, &n1, &n3);
    if (dv > top + room || dv < bottom - room) {
        *lacks = dv > top ? (dv - top) / hi : (bottom - dv) / -lo;
        return 0;
    }
    double share = bottom < top ? most(0, least(1, (dv - bottom) / (top - bottom))) : 0;
    double l = lo + (hi - lo) * share;
    for (int s = 0; s < NEWTON_STEPS; s++) {
        double f = level_change(a0, m, l, j, &n1, &n3) - dv;
        if (f > 0)
            hi = l;
        else
            lo = l;
        double w = m - 1 - n1 - n3;
        double next = w > 0 ? l - f / w : (lo + hi) / 2;
        if (next == l)
            break;
        if (next < lo || next > hi)
            next = (lo + hi) / 2;
        if (fabs(next - l) <= 1e-16 * (fabs(l) + j)) {
            l = next;
            break;
        }
        l = next;
    }
    n1 = whole(fabs(l - a0) / j);
    n3 = whole(fabs(l) / j);
    /* three phases when they fit the same duration */
    double r1 = most(1, up(fabs(l - a0) / j)), r3 = most(1, up(fabs(l) / j)), r2 = m - r1 - r3;
    if (r2 >= 0 && vmax > 0) {
        double level = (dv - r1 * a0 / 2) / ((r1 + r3) / 2 + r2);
        if (level <= au * (1 + SLACK) && level >= -ad * (1 + SLACK) &&
            fabs(level - a0) <= r1 * j * (1 + SLACK) && fabs(level) <= r3 * j * (1 + SLACK) &&
            (level * a0 >= 0 || fabs(v0 + a0 * a0 * r1 / (2 * (a0 - level))) <= vmax)) {
            sj_node(x, 0, a0);
            sj_node(x, r1, level);
            sj_node(x, r1 + r2, level);
            sj_node(x, m, 0);
            return 1;
        }
    }
    double d = l >= a0 ? j : -j, e = l >= 0 ? j : -j;
    sj_node(x, 0, a0);
    if (n1 > 0 && n1 <= m - n3)
        sj_node(x, n1, a0 + d * n1);
    if (n1 + 1 < m - n3)
        sj_node(x, n1 + 1, l);
    if (m - n3 - 1 > n1 + 1)
        sj_node(x, m - n3 - 1, l);
    if (m - n3 < m)
        sj_node(x, m - n3, e * n3);
    sj_node(x, m, 0);
    /* over very many cycles rounding adds up; more than that would be a fault */
    double rest = dv - sj_path_change(x);
    return fabs(rest) > room + SLACK * fabs(dv) ? -1 : 1;
}

/* Fastest whole-cycle ramp (v0, a0) -> (v1, 0) under one jerk limit. |a0| must be within the
   limits. */
int sj_ramp(double v0, double a0, double dv, double vmax, double au, double ad, double j, path *x)
{
    x->count = 0;
    /* change of velocity until the acceleration is zero */
    double z = a0 * fabs(a0) / (2 * j);
    double t, lacks = 0;
    if (dv >= z)
        t = a0 >= 0 ? ramp_time(dv + z, au, j) - a0 / j : ramp_time(dv - z, au, j) - a0 / j;
    else
        t = a0 <= 0 ? ramp_time(z * -1 - dv, ad, j) + a0 / j : ramp_time(z - dv, ad, j) + a0 / j;
    double m = most(up(t), up(fabs(a0) / j));
    if (!(m < LONGEST))
        return 0;
    if (m <= 0) {
        if (dv == 0 && a0 == 0) {
            sj_node(x, 0, a0);
            return 1;
        }
        m = 1;
    }
    for (int i = 0; i < DURATION_STEPS; i++, m += 1) {
        int found = ramp_of(v0, a0, dv, vmax, au, ad, j, m, &lacks, x);
        if (found)
            return found > 0;
        /* among very many cycles `up` forgives more than one: add those that are missing */
        if (lacks > 1 && lacks < LONGEST)
            m += whole(lacks) - 1;
    }
    return 0;
}

/* The same in m cycles, more than the fastest takes: full jerk to a lower level, which is held. */
int sj_ramp_in(const task *t, double dv, double j, double m, path *x)
{
    double lacks;
    x->count = 0;
    return m >= fabs(t->a0) / j && m < LONGEST &&
           ramp_of(t->v0, t->a0, dv, t->vmax * (1 + SLACK), t->au, t->ad, j, m, &lacks, x) > 0;
}
