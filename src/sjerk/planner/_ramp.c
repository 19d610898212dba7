/* Whole-cycle ramps, and plans under construction.

   A ramp from (v0, a0) to (v, 0) in m cycles is the node sequence
       a_k = median(low_k, L, high_k),
       low_k = max(a0 - J k, -J (m - k)),  high_k = min(a0 + J k, J (m - k)),
   which changes by at most J a cycle for any real level L: minima and maxima of such sequences are
   such sequences. The change of velocity grows with L, so m is the smallest length whose range
   holds it. Where three phases (rise, hold, fall; the paper's T1-T3 with its one level, Eqs.
   9-13) fit the same m, they are used.

   Never here: a distance to be met, a choice between ways (_profile.c). */
#include "_plan.h"
#include "base/_double_double.h" /* double-double sums */

/* ---- the plan as it grows ---- */

void sj_begin(sj_plan *p) { p->cycles = 0; p->count = 0; p->kind = SJ_PLAN_WAIT; }

void sj_put(sj_plan *p, double n, double jerk)
{
    if (!(n > 0.0)) return;
    p->cycles += (int64_t)n;
    if (p->count > 0 && p->phase[p->count - 1].jerk == jerk) {
        p->phase[p->count - 1].cycles += (int64_t)n;
        return;
    }
    /* cannot be: the ways add up to fewer; kept for memory's sake */
    if (p->count == SJ_PHASES) return;
    p->phase[p->count].cycles = (int64_t)n;
    p->phase[p->count].jerk = jerk;
    p->count++;
}

void sj_append(sj_plan *p, const sj_plan *q)
{
    for (int i = 0; i < q->count; i++) sj_put(p, (double)q->phase[i].cycles, q->phase[i].jerk);
}

/* Velocity a piece of the motion reaches at most, in magnitude: n cycles from (v, a) to acceleration
   b; at the end or where the acceleration crosses zero. */
static double piece_peak(double v, double n, double a, double b)
{
    double end = fabs(v + n * (a + b) / 2);
    return a * b < 0 ? most(end, fabs(v + n * a * a / (2 * (a - b)))) : end;
}

/* Whether the plan, from task t which begins after its first `used` cycles, leaves the velocity
   limit. */
int sj_leaves_velocity(const task *t, const sj_plan *p, int64_t used)
{
    double v = t->sign * t->v0, a = t->sign * t->a0;
    for (int i = 0; i < p->count; i++) {
        int64_t skipped = used < p->phase[i].cycles ? used : p->phase[i].cycles;
        double n = (double)(p->phase[i].cycles - skipped), b = a + n * p->phase[i].jerk;
        used -= skipped;
        if (piece_peak(v, n, a, b) > t->vmax * (1 + 4 * SLACK)) return 1;
        v += n * (a + b) / 2;
        a = b;
    }
    return 0;
}

/* Acceleration after the plan so far, without drift. */
static sj_exact plan_acceleration(double first, const sj_plan *p)
{
    sj_exact a = exact_of(first);
    for (int i = 0; i < p->count; i++)
        a = exact_add(a, exact_two_product(p->phase[i].jerk, (double)p->phase[i].cycles));
    return a;
}

/* The task that remains after the plan so far; Eqs. (2), (3), (5) along its phases. */
task sj_resume(const task *start, const sj_plan *p)
{
    task t = *start;
    sj_exact h = exact_of(t.h), v = exact_of(t.v0), a = exact_of(t.a0);
    for (int i = 0; i < p->count; i++) {
        double n = (double)p->phase[i].cycles;
        sj_exact change = exact_two_product(t.sign * p->phase[i].jerk, n);  /* of a */
        sj_exact third = exact_add(exact_half(a), exact_divide(change, 6.0));
        h = exact_subtract(h, exact_scale(exact_add(v, exact_scale(third, n)), n));
        v = exact_add(v, exact_scale(exact_add(a, exact_half(change)), n));
        a = exact_add(a, change);
    }
    t.h = h.hi; t.v0 = v.hi; t.a0 = a.hi;
    return t;
}

/* A cruise multiplies what rounding left of the acceleration: a long one begins by taking it
   out. */
void sj_put_cruise(sj_plan *p, const task *t, double n)
{
    if (n >= 1024) {
        double left = plan_acceleration(t->sign * t->first, p).hi;
        if (left != 0) { sj_put(p, 1, -left); n -= 1; }
    }
    sj_put(p, n, 0);
}

/* ---- node paths: acceleration at whole cycles, straight between ---- */

double sj_path_change(const path *x)
{
    double dv = 0;
    for (int i = 1; i < x->count; i++) dv += (x->k[i] - x->k[i - 1]) * (x->a[i] + x->a[i - 1]) / 2;
    return dv;
}
double sj_path_distance(const path *x, double v)
{
    double p = 0;
    for (int i = 1; i < x->count; i++) {
        double n = x->k[i] - x->k[i - 1], a = x->a[i - 1], b = x->a[i];
        p += n * (v + n * (2 * a + b) / 6);
        v += n * (a + b) / 2;
    }
    return p;
}
double sj_path_peak(const path *x, double v)
{
    double peak = fabs(v);
    for (int i = 1; i < x->count; i++) {
        double n = x->k[i] - x->k[i - 1], a = x->a[i - 1], b = x->a[i];
        peak = most(peak, piece_peak(v, n, a, b));
        v += n * (a + b) / 2;
    }
    return peak;
}
void sj_path_put(sj_plan *p, const path *x, const task *t)
{
    for (int i = 1; i < x->count; i++) {
        double n = x->k[i] - x->k[i - 1], d = x->a[i] - x->a[i - 1];
        if (x->a[i] == 0 && x->a[i - 1] == 0) sj_put_cruise(p, t, n);
        else sj_put(p, n, t->sign * (d / n));
    }
}
void sj_node(path *x, double k, double a)
{
    if (x->count > 0 && k <= x->k[x->count - 1]) return;
    x->k[x->count] = k; x->a[x->count] = a; x->count++;
}

/* ---- ramps ---- */

/* Velocity change of the ramp of m cycles with level `l`: from a0 at full jerk to l, held, at full
   jerk to zero. */
static double level_change(double a0, double m, double l, double j, double *n1, double *n3)
{
    double d = l >= a0 ? j : -j, e = l >= 0 ? j : -j;
    *n1 = whole(fabs(l - a0) / j);
    *n3 = whole(fabs(l) / j);
    return a0 / 2 + a0 * *n1 + d * *n1 * (*n1 + 1) / 2 + l * (m - 1 - *n1 - *n3)
        + e * *n3 * (*n3 + 1) / 2;
}

/* Fastest whole-cycle ramp (v0, a0) -> (v1, 0) under one jerk limit. |a0| must be within the
   limits. */
int sj_ramp(double v0, double a0, double dv, double vmax, double au, double ad, double j, path *x)
{
    x->count = 0;
    /* change of velocity on the way to zero acceleration */
    double z = a0 * fabs(a0) / (2 * j);
    double t;
    if (dv >= z)
        t = a0 >= 0 ? ramp_time(dv + z, au, j) - a0 / j : ramp_time(dv - z, au, j) - a0 / j;
    else t = a0 <= 0 ? ramp_time(z * -1 - dv, ad, j) + a0 / j : ramp_time(z - dv, ad, j) + a0 / j;
    double m = most(up(t), up(fabs(a0) / j));
    if (!(m < LONGEST)) return 0;
    if (m <= 0) {
        if (dv == 0 && a0 == 0) { sj_node(x, 0, a0); return 1; }
        m = 1;
    }
    for (int i = 0; i < LENGTH_STEPS; i++, m += 1) {
        double hi = least(au, (a0 + j * m) / 2), lo = most(-ad, (a0 - j * m) / 2), n1, n3;
        double room = 1e-13 * (fabs(dv) + fabs(z) + fabs(a0));
        double top = level_change(a0, m, hi, j, &n1, &n3);
        double bottom = level_change(a0, m, lo, j, &n1, &n3);
        if (dv > top + room || dv < bottom - room) {
            /* among very many cycles `up` forgives more than one: add those that are missing */
            double lacks = dv > top ? (dv - top) / hi : (bottom - dv) / -lo;
            if (lacks > 1 && lacks < LONGEST) m += whole(lacks) - 1;
            continue;
        }
        double share = bottom < top ? most(0, least(1, (dv - bottom) / (top - bottom))) : 0;
        double l = lo + (hi - lo) * share;
        for (int s = 0; s < NEWTON_STEPS; s++) {
            double f = level_change(a0, m, l, j, &n1, &n3) - dv;
            if (f > 0) hi = l; else lo = l;
            double w = m - 1 - n1 - n3;
            double next = w > 0 ? l - f / w : (lo + hi) / 2;
            if (next == l) break;
            if (next < lo || next > hi) next = (lo + hi) / 2;
            if (fabs(next - l) <= 1e-16 * (fabs(l) + j)) { l = next; break; }
            l = next;
        }
        n1 = whole(fabs(l - a0) / j); n3 = whole(fabs(l) / j);
        /* three phases when they fit the same length */
        double r1 = most(1, up(fabs(l - a0) / j)), r3 = most(1, up(fabs(l) / j)), r2 = m - r1 - r3;
        if (r2 >= 0 && vmax > 0) {
            double level = (dv - r1 * a0 / 2) / ((r1 + r3) / 2 + r2);
            if (level <= au * (1 + SLACK) && level >= -ad * (1 + SLACK)
                && fabs(level - a0) <= r1 * j * (1 + SLACK) && fabs(level) <= r3 * j * (1 + SLACK)
                && (level * a0 >= 0 || fabs(v0 + a0 * a0 * r1 / (2 * (a0 - level))) <= vmax)) {
                sj_node(x, 0, a0);
                sj_node(x, r1, level);
                sj_node(x, r1 + r2, level);
                sj_node(x, m, 0);
                return 1;
            }
        }
        double d = l >= a0 ? j : -j, e = l >= 0 ? j : -j;
        sj_node(x, 0, a0);
        if (n1 > 0 && n1 <= m - n3) sj_node(x, n1, a0 + d * n1);
        if (n1 + 1 < m - n3) sj_node(x, n1 + 1, l);
        if (m - n3 - 1 > n1 + 1) sj_node(x, m - n3 - 1, l);
        if (m - n3 < m) sj_node(x, m - n3, e * n3);
        sj_node(x, m, 0);
        /* over very many cycles rounding adds up; more than that would be a fault */
        double rest = dv - sj_path_change(x);
        if (fabs(rest) > room + SLACK * fabs(dv)) return 0;
        return 1;
    }
    return 0;
}

