#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include "_kernel.h"

static const double SLACK = 1e-10;      /* relative room for rounding in counts and levels; a tenth of what is promised */
enum { NEWTON_STEPS = 40, LENGTH_STEPS = 6, NODES = 40 };
static const double LONGEST = 1125899906842624.0;   /* 2^50 cycles */

/* A planning task with its limits turned so that "up" is the direction in which the move is pushed. */
typedef struct {
    double h, v0, a0, v1;
    double vmax;
    double au, ju;      /* acceleration upward and the jerk while it points upward */
    double ad, jd;      /* the same downward */
    double sign;        /* +1 or -1: how "up" lies in axis coordinates */
    double first;       /* acceleration at the start of the whole plan */
} task;

static task mirrored(const task *t)
{
    return (task){-t->h, -t->v0, -t->a0, -t->v1, t->vmax, t->ad, t->jd, t->au, t->ju, -t->sign, -t->first};
}

static double up(double x)      /* whole cycles for x, rounding noise forgiven */
{
    x -= SLACK * (1.0 + fabs(x));
    if (!(fabs(x) < 4e18)) return x;
    double n = (double)(int64_t)x;
    return n < x ? n + 1.0 : n;
}
static double down(double x)
{
    x += SLACK * (1.0 + fabs(x));
    if (!(fabs(x) < 4e18)) return x;
    double n = (double)(int64_t)x;
    return n > x ? n - 1.0 : n;
}
/* floor() for numbers of cycles, without a call */
static double whole(double x)
{
    double n = (double)(int64_t)x;
    return n > x ? n - 1.0 : n;
}
static double least(double a, double b) { return a < b ? a : b; }
static double most(double a, double b) { return a > b ? a : b; }

/* ---- the plan as it grows ---- */

static void begin(sj_plan *p) { p->cycles = 0; p->count = 0; p->kind = SJ_PLAN_WAIT; }

static void put(sj_plan *p, double n, double jerk)
{
    if (!(n > 0.0)) return;
    p->cycles += (int64_t)n;
    if (p->count > 0 && p->phase[p->count - 1].jerk == jerk) {
        p->phase[p->count - 1].cycles += (int64_t)n;
        return;
    }
    p->phase[p->count].cycles = (int64_t)n;
    p->phase[p->count].jerk = jerk;
    p->count++;
}

/* Unevaluated sums of two doubles: the state after phases that were already laid down, without drift. */
typedef struct { double hi, lo; } twofold;

static twofold two_sum(double a, double b)
{
    double s = a + b, v = s - a;
    return (twofold){s, (a - (s - v)) + (b - v)};
}
static twofold two_add(twofold a, twofold b)
{
    twofold s = two_sum(a.hi, b.hi);
    return two_sum(s.hi, s.lo + (a.lo + b.lo));
}
static twofold two_mul(twofold a, double b)
{
    double p = a.hi * b;
    return two_sum(p, fma(a.hi, b, -p) + a.lo * b);
}
/* Acceleration after the plan so far. */
static twofold plan_acceleration(double first, const sj_plan *p)
{
    twofold a = {first, 0};
    for (int i = 0; i < p->count; i++)
        a = two_add(a, two_mul((twofold){p->phase[i].jerk, 0}, (double)p->phase[i].cycles));
    return a;
}
/* The task that remains after the plan so far. */
static task resume(const task *start, const sj_plan *p)
{
    task t = *start;
    twofold h = {t.h, 0}, v = {t.v0, 0}, a = {t.a0, 0};
    for (int i = 0; i < p->count; i++) {
        double n = (double)p->phase[i].cycles;
        twofold j = {t.sign * p->phase[i].jerk, 0};
        twofold d = two_mul(two_add(v, two_mul(two_add(two_mul(a, 0.5), two_mul(two_mul(j, n), 1.0 / 6)), n)), -n);
        h = two_add(h, d);
        v = two_add(v, two_mul(two_add(a, two_mul(j, n / 2)), n));
        a = two_add(a, two_mul(j, n));
    }
    t.h = h.hi; t.v0 = v.hi; t.a0 = a.hi;
    return t;
}
/* A cruise multiplies what rounding left of the acceleration: a long one begins by taking it out. */
static void put_cruise(sj_plan *p, const task *t, double n)
{
    if (n >= 1024) {
        twofold a = plan_acceleration(t->sign * t->first, p);
        double left = a.hi + a.lo;
        if (left != 0) { put(p, 1, -left); n -= 1; }
    }
    put(p, n, 0);
}

/* ---- node paths: acceleration at whole cycles, straight between ---- */

typedef struct { int count; double k[NODES], a[NODES]; } path;

static double path_change(const path *x)
{
    double dv = 0;
    for (int i = 1; i < x->count; i++) dv += (x->k[i] - x->k[i - 1]) * (x->a[i] + x->a[i - 1]) / 2;
    return dv;
}
static double path_distance(const path *x, double v)
{
    double p = 0;
    for (int i = 1; i < x->count; i++) {
        double n = x->k[i] - x->k[i - 1], a = x->a[i - 1], b = x->a[i];
        p += n * (v + n * (2 * a + b) / 6);
        v += n * (a + b) / 2;
    }
    return p;
}
static void path_put(sj_plan *p, const path *x, const task *t)
{
    for (int i = 1; i < x->count; i++) {
        double n = x->k[i] - x->k[i - 1], d = x->a[i] - x->a[i - 1];
        if (x->a[i] == 0 && x->a[i - 1] == 0) put_cruise(p, t, n);
        else put(p, n, t->sign * (d / n));
    }
}
static void node(path *x, double k, double a)
{
    if (x->count > 0 && k <= x->k[x->count - 1]) return;
    x->k[x->count] = k; x->a[x->count] = a; x->count++;
}

/* ---- ramps ---- */

/* Time of a change of velocity x >= 0 between states without acceleration. */
static double ramp_time(double x, double amax, double jerk)
{
    return x * jerk >= amax * amax ? x / amax + amax / jerk : 2 * sqrt(x / jerk);
}

/* Velocity change of the ramp of m cycles with level `l`: from a0 at full jerk to l, held, at full jerk to zero. */
static double level_change(double a0, double m, double l, double j, double *n1, double *n3)
{
    double d = l >= a0 ? j : -j, e = l >= 0 ? j : -j;
    *n1 = whole(fabs(l - a0) / j);
    *n3 = whole(fabs(l) / j);
    return a0 / 2 + a0 * *n1 + d * *n1 * (*n1 + 1) / 2 + l * (m - 1 - *n1 - *n3) + e * *n3 * (*n3 + 1) / 2;
}

/* Fastest whole-cycle ramp (v0, a0) -> (v1, 0) under one jerk limit. |a0| must be within the limits. */
static int ramp(double v0, double a0, double dv, double vmax, double au, double ad, double j, path *x)
{
    x->count = 0;
    double z = a0 * fabs(a0) / (2 * j);         /* change of velocity on the way to zero acceleration */
    double t;
    if (dv >= z) t = a0 >= 0 ? ramp_time(dv + z, au, j) - a0 / j : ramp_time(dv - z, au, j) - a0 / j;
    else t = a0 <= 0 ? ramp_time(z * -1 - dv, ad, j) + a0 / j : ramp_time(z - dv, ad, j) + a0 / j;
    double m = most(up(t), up(fabs(a0) / j));
    if (!(m < LONGEST)) return 0;
    if (m <= 0) { node(x, 0, a0); return 1; }
    for (int i = 0; i < LENGTH_STEPS; i++, m += 1) {
        double hi = least(au, (a0 + j * m) / 2), lo = most(-ad, (a0 - j * m) / 2), n1, n3;
        double room = SLACK * (fabs(dv) + j) + 1e-13 * fabs(z);
        double top = level_change(a0, m, hi, j, &n1, &n3), bottom = level_change(a0, m, lo, j, &n1, &n3);
        if (dv > top + room || dv < bottom - room) continue;
        double l = bottom < top ? lo + (hi - lo) * most(0, least(1, (dv - bottom) / (top - bottom))) : lo;
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
                node(x, 0, a0); node(x, r1, level); node(x, r1 + r2, level); node(x, m, 0);
                return 1;
            }
        }
        double d = l >= a0 ? j : -j, e = l >= 0 ? j : -j;
        node(x, 0, a0);
        if (n1 > 0 && n1 <= m - n3) node(x, n1, a0 + d * n1);
        if (n1 + 1 < m - n3) node(x, n1 + 1, l);
        if (m - n3 - 1 > n1 + 1) node(x, m - n3 - 1, l);
        if (m - n3 < m) node(x, m - n3, e * n3);
        node(x, m, 0);
        /* what rounding left over goes into the level, or into the last free node */
        double rest = dv - path_change(x);
        if (fabs(rest) > room) return 0;
        return 1;
    }
    return 0;
}

/* ---- the shortest move in continuous time ---- */

typedef struct {
    double vs, vz;      /* virtual start without acceleration; velocity when the acceleration is brought to zero */
    double t0, p0;      /* what the virtual start adds to time and distance */
    double low;         /* lowest peak velocity of the family */
} family;

static family family_of(const task *t)
{
    family f;
    if (t->a0 >= 0) {
        double b = t->a0 / t->ju, w = t->a0 * b / 2;
        f.vs = t->v0 - w; f.vz = t->v0 + w;
        f.t0 = -b; f.p0 = -b * (f.vs + t->a0 * b / 6);
    } else {
        double b = -t->a0 / t->jd;
        f.vs = f.vz = t->v0 + t->a0 * b / 2;
        f.t0 = b; f.p0 = b * (t->v0 + t->a0 * b / 3);
    }
    f.low = most(f.vz, t->v1);
    return f;
}
/* Distance of ramp up to v and ramp down to v1. */
static double family_distance(const task *t, const family *f, double v)
{
    double x1 = most(0, v - f->vs), x2 = most(0, v - t->v1);
    return f->p0 + (v + f->vs) / 2 * ramp_time(x1, t->au, t->ju) + (v + t->v1) / 2 * ramp_time(x2, t->ad, t->jd);
}

/* Peak velocity at which the family covers h. In z = sqrt(v - base) the distance is smooth. */
static double family_peak(const task *t, const family *f, double at_low, int far)
{
    double base = most(f->vs, t->v1);
    int second = t->v1 >= f->vs;
    double jb = second ? t->jd : t->ju;
    double lo = sqrt(most(0, (f->low - base) * jb)), hi = sqrt(most(0, (t->vmax - base) * jb));
    double x = t->h - at_low, jh = t->ju, ah = t->au;
    if (t->jd != t->ju) { double q = 2 / (1 / sqrt(t->ju) + 1 / sqrt(t->jd)); jh = q * q; }
    if (t->ad != t->au) ah = 2 * t->au * t->ad / (t->au + t->ad);
    double v = cbrt(x * x * jh / 4);
    if (v * jh > ah * ah) { double q = ah / jh; v = 0.5 * (sqrt(ah * (ah * q * q + 4 * x)) - ah * q); }
    double z = sqrt(most(0, (v + f->low - base) * jb));
    if (far || !(z < hi)) z = hi;
    if (z < lo) z = lo;
    double scale = 1e-13 * (fabs(t->h) + fabs(at_low));
    for (int i = 0; i < NEWTON_STEPS; i++) {
        v = base + z * z / jb;
        double x1 = v - f->vs, x2 = v - t->v1, t1, t2, d1, d2;
        if (second) x2 = z * z / jb; else x1 = z * z / jb;
        if (x1 * t->ju >= t->au * t->au) { t1 = x1 / t->au + t->au / t->ju; d1 = 1 / t->au; }
        else { double r = second ? sqrt(most(x1, 0) * t->ju) : z; t1 = 2 * r / t->ju; d1 = 1 / r; }
        if (x2 * t->jd >= t->ad * t->ad) { t2 = x2 / t->ad + t->ad / t->jd; d2 = 1 / t->ad; }
        else { double r = second ? z : sqrt(most(x2, 0) * t->jd); t2 = 2 * r / t->jd; d2 = 1 / r; }
        double e = f->p0 + 0.5 * ((v + f->vs) * t1 + (v + t->v1) * t2) - t->h;
        if (e > 0) hi = z; else lo = z;
        if (fabs(e) <= scale) break;
        double slope = (0.5 * (t1 + t2) + 0.5 * (v + f->vs) * d1 + 0.5 * (v + t->v1) * d2) * 2 * z / jb;
        double next = z - e / slope;
        if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
        if (fabs(next - z) <= 1e-13 * z) { z = next; break; }
        z = next;
    }
    return base + z * z / jb;
}

/* ---- seven phases ---- */

typedef struct { double n1, n2, n3, n4, n5, n6; double v, a; } seven;

/* With the lengths fixed everything is linear in the cruise velocity (the paper's Eqs. 11-13 for any start):
   returns whether the plan keeps every limit. */
static int seven_fit(const task *t, seven *s)
{
    double n1 = s->n1, n2 = s->n2, n3 = s->n3, r2 = s->n5 + s->n6, m1 = n1 + n2 + n3, m2 = r2 + s->n5;
    double c = 1 / (0.5 * (n1 + n3) + n2), q = 0.5 * m1, rest = t->h;
    if (t->a0 != 0.0 || n1 != n3) {
        q = (n1 * (0.5 * (n2 + n3) + n1 * (1.0 / 6)) + n2 * (n3 + 0.5 * n2) + n3 * n3 * (1.0 / 3)) * c;
        rest -= t->a0 * n1 * (0.5 * (n2 + n3 - q) + n1 * (1.0 / 3));
    }
    double v = (rest - t->v0 * (m1 - q) - t->v1 * (0.5 * m2)) / (q + s->n4 + 0.5 * m2);
    double a = (v - t->v0 - 0.5 * n1 * t->a0) * c, w = v - t->v1;
    s->v = v; s->a = a;
    const double one = 1 + 4 * SLACK;
    if (!(fabs(v) <= t->vmax * one)) return 0;
    double lim = w >= 0 ? least(t->ad, s->n5 * t->jd) : least(t->au, s->n5 * t->ju);
    if (!(fabs(w) <= lim * r2 * one)) return 0;
    double amax = a >= 0 ? t->au : t->ad, jerk = a >= 0 ? t->ju : t->jd;
    if (!(fabs(a) <= one * least(amax, n3 * jerk))) return 0;
    if (a * t->a0 >= 0) {
        double j0 = t->a0 > 0 ? t->ju : t->a0 < 0 ? t->jd : jerk;
        return fabs(a - t->a0) <= one * n1 * j0;
    }
    if (!(fabs(a - t->a0) <= one * n1 * least(t->ju, t->jd))) return 0;
    /* the acceleration crosses zero inside the first phase: an extreme of the velocity */
    double turn = t->v0 + 0.5 * t->a0 * t->a0 * n1 / (t->a0 - a);
    return fabs(turn) <= t->vmax * one;
}

static double seven_cycles(const seven *s) { return s->n1 + s->n2 + s->n3 + s->n4 + 2 * s->n5 + s->n6; }

static void seven_put(sj_plan *p, const task *t, const seven *s)
{
    double j1 = (s->a - t->a0) / s->n1, j3 = -s->a / s->n3, j5 = (t->v1 - s->v) * (1 / (s->n5 + s->n6)) / s->n5, d = t->sign;
    if (t->a0 == 0.0 && s->n1 == s->n3) j3 = -j1;
    put(p, s->n1, d * j1);
    put(p, s->n2, 0);
    put(p, s->n3, d * j3);
    put_cruise(p, t, s->n4);
    put(p, s->n5, d * j5);
    put(p, s->n6, 0);
    put(p, s->n5, -d * j5);
}

/* Cycles of rise (n1), hold (n2), fall (n3) that change the velocity by x from acceleration a0 toward level z. */
static void ramp_counts(double a0, double x, double z, double amax, double jerk, double jerk1, double *n1, double *n2, double *n3)
{
    double f = z / jerk, g = (z - a0) / jerk1, best = INFINITY;
    double f0 = most(1, down(f)), g0 = most(1, down(g));
    *n1 = *n3 = 1; *n2 = 0;
    for (int i = 0; i < 2; i++)
        for (int k = g < 1 && f0 > 1 ? -1 : 0; k < 2; k++) {
            double r1 = g0 + i, r3 = f0 + k;
            if (a0 == 0 && i != k) continue;
            double level = least(amax, least(r3 * jerk, a0 + r1 * jerk1));
            if (!(level > 0)) continue;
            double m = most(r1 + r3, up((x - 0.5 * r1 * a0) / level + 0.5 * (r1 + r3)));
            if (m < best) { best = m; *n1 = r1; *n3 = r3; *n2 = m - r1 - r3; }
        }
}

/* Takes single cycles away as long as the limits allow; `least_cycles` cannot be undercut. */
static void seven_shorten(const task *t, seven *s, double least_cycles)
{
    for (double spare = seven_cycles(s) - least_cycles; spare >= 1; spare -= 1) {
        seven c = *s;
        if (s->n4 > 0) { c.n4 -= 1; if (seven_fit(t, &c)) { *s = c; continue; } c.n4 += 1; }
        if (s->n2 > 0) { c.n2 -= 1; if (seven_fit(t, &c)) { *s = c; continue; } c.n2 += 1; }
        if (s->n6 > 0) { c.n6 -= 1; if (seven_fit(t, &c)) { *s = c; continue; } c.n6 += 1; }
        if (s->n1 > 1) { c.n1 -= 1; if (seven_fit(t, &c)) { *s = c; continue; } c.n1 += 1; }
        if (s->n3 > 1) { c.n3 -= 1; if (seven_fit(t, &c)) { *s = c; continue; } c.n3 += 1; }
        if (s->n5 > 1) { c.n5 -= 1; c.n6 += 1; if (seven_fit(t, &c)) { *s = c; continue; } }
        break;
    }
}

/* ---- extremes of a fixed length, and their mix ---- */

/* Acceleration at node k of the path that gets furthest in n cycles: as high as possible, then as low as possible;
   with a cruise between s (from the start) and r (cycles before the end). */
static double extreme_at(const task *t, double jerk, double n, double s, double r, double k)
{
    double mid = k < s ? jerk * (s - k) : n - k < r ? -jerk * (r - (n - k)) : 0;
    double x = least(least(t->a0 + jerk * k, t->au), mid);
    return most(most(x, -t->ad), -jerk * (n - k));
}
static void extreme_path(const task *t, double j, double n, double s, double r, path *x)
{
    double kink[6], k[14], apex = 0.5 * (s - t->a0 / j);
    int c = 0, m = 0;
    if (t->a0 + j * apex > t->au) { kink[m++] = (t->au - t->a0) / j; kink[m++] = s - t->au / j; }
    else kink[m++] = apex;
    if (s + r < n) { kink[m++] = s; kink[m++] = n - r; }
    if (j * r > 2 * t->ad) { kink[m++] = n - r + t->ad / j; kink[m++] = n - t->ad / j; }
    else kink[m++] = n - 0.5 * r;
    k[c++] = 0;
    for (int i = 0; i < m; i++) {
        double f = whole(kink[i]);
        if (f > 0 && f < n) k[c++] = f;
        if (f + 1 > 0 && f + 1 < n) k[c++] = f + 1;
    }
    k[c++] = n;
    for (int i = 1; i < c; i++) {
        double q = k[i];
        int l = i;
        for (; l > 0 && k[l - 1] > q; l--) k[l] = k[l - 1];
        k[l] = q;
    }
    x->count = 0;
    for (int i = 0; i < c; i++) {
        if (x->count && k[i] <= x->k[x->count - 1]) continue;
        double a = k[i] <= 0 ? t->a0 : k[i] >= n ? 0 : extreme_at(t, j, n, s, r, k[i]);
        /* drop the node before this one when it lies on a straight line */
        if (x->count >= 2) {
            int e = x->count - 1;
            double d1 = x->k[e] - x->k[e - 1], d2 = k[i] - x->k[e];
            if (fabs((x->a[e] - x->a[e - 1]) * d2 - (a - x->a[e]) * d1) <= 1e-13 * j * d1 * d2) x->count--;
        }
        x->k[x->count] = k[i]; x->a[x->count] = a; x->count++;
    }
}

/* Velocity change of the furthest path, the falling line crossing zero at s; slope is its change with s. */
static double extreme_change(const task *t, double j, double n, double s, double *slope)
{
    double a0 = t->a0, apex = 0.5 * (s - a0 / j), xa = apex, xb = apex, foot = 0.5 * (n + s), ya = foot, yb = foot;
    if (a0 + j * apex > t->au) { xa = (t->au - a0) / j; xb = s - t->au / j; }
    if (j * (s - foot) < -t->ad) { ya = s + t->ad / j; yb = n - t->ad / j; }
    double k1 = whole(xa), k2 = whole(xb), k3 = whole(ya), k4 = whole(yb);
    *slope = j * (k3 - k2);
    return a0 / 2 + k1 * (a0 + j * (k1 + 1) / 2) + t->au * (k2 - k1)
         + (k3 - k2) * (j * (s - 0.5 * (k2 + 1 + k3))) - t->ad * (k4 - k3) - j * (n - k4 - 1) * (n - k4) / 2;
}
/* The same up to the zero crossing only, nodes beyond it at zero. */
static double rise_change(double a0, double top, double j, double s, double *slope)
{
    double apex = 0.5 * (s - a0 / j), xa = apex, xb = apex;
    if (a0 + j * apex > top) { xa = (top - a0) / j; xb = s - top / j; }
    double k1 = whole(xa), k2 = whole(xb), k3 = whole(s);
    *slope = j * (k3 - k2);
    return a0 / 2 + k1 * (a0 + j * (k1 + 1) / 2) + top * (k2 - k1) + (k3 - k2) * (j * (s - 0.5 * (k2 + 1 + k3)));
}
/* s at which rise_change is dv; NaN if there is none above lo. */
static double rise_length(double a0, double top, double j, double dv, double lo)
{
    double x = dv + a0 * fabs(a0) / (2 * j), slope, f = 0;
    double hi = INFINITY, s = most(lo, ramp_time(most(0, x), top, j) - a0 / j);
    if (!(s < LONGEST)) return NAN;
    double tiny = 1e-16 * (fabs(dv) + j + fabs(a0) * (s + 1));
    for (int i = 0; i < NEWTON_STEPS; i++) {
        f = rise_change(a0, top, j, s, &slope) - dv;
        if (fabs(f) <= 2 * tiny) return s;
        if (f > 0) hi = s; else lo = s;
        double next = slope > 0 ? s - f / slope : s + (f < 0 ? 0.5 : -0.5);
        if (fabs(next - s) <= 4e-16 * (fabs(s) + 1)) break;
        if (!(next >= lo && next <= hi)) {
            if (hi <= lo) return NAN;
            next = hi < INFINITY ? 0.5 * (lo + hi) : lo + 1;
        }
        s = next;
    }
    return fabs(f) <= 1e3 * tiny ? s : NAN;
}

/* The largest velocity that n cycles may see: what rounding is relative to. */
static double velocity_scale(const task *t, double j, double n)
{
    double a = fabs(t->a0);
    return least(2 * t->vmax, fabs(t->v0) + n * least(a + most(t->au, t->ad), a + j * n));
}

/* The legal path of n cycles to (v1, 0) that gets furthest up; 0 if there is none. */
static int extreme(const task *t, double j, double n, path *x)
{
    double dv = t->v1 - t->v0, first = fabs(t->a0) / j, carry = t->v0 + t->a0 * first / 2;
    if (n < first * (1 - SLACK) || fabs(carry) > t->vmax * (1 + SLACK)) return 0;
    double reach = velocity_scale(t, j, n), tiny = 2e-16 * reach;
    /* up to the velocity limit, cruise, and down at the last moment */
    double top = most(t->vmax, carry);
    double s = rise_length(t->a0, t->au, j, top - t->v0, first), r = rise_length(0, t->ad, j, top - t->v1, 0);
    if (!(s + r <= n)) {
        /* too short for that: the falling line goes through zero without a rest */
        double lo = least(t->a0 / j, n), hi = n, slope, f = 0, next = s - 0.5 * (s + r - n);
        s = next > lo && next < hi ? next : 0.5 * (lo + hi);
        for (int i = 0; i < NEWTON_STEPS; i++) {
            f = extreme_change(t, j, n, s, &slope) - dv;
            if (fabs(f) <= 2 * tiny) break;
            if (f > 0) hi = s; else lo = s;
            next = slope > 0 ? s - f / slope : 0.5 * (lo + hi);
            if (fabs(next - s) <= 4e-16 * n) break;
            if (!(next >= lo && next <= hi)) next = 0.5 * (lo + hi);
            s = next;
        }
        if (!(fabs(f) <= 1e-13 * reach)) return 0;
        r = n - s;
        if (s > -t->a0 / j && s > 0) {
            double part = s - whole(s);
            double peak = t->v0 + rise_change(t->a0, t->au, j, s, &slope) - 0.5 * j * part * (1 - part);
            if (peak > t->vmax * (1 + SLACK)) return 0;
        }
    }
    extreme_path(t, j, n, s, r, x);
    return fabs(path_change(x) - dv) <= 1e-13 * reach;
}

static double path_at(const path *x, int *i, double k)
{
    while (*i < x->count - 2 && x->k[*i + 1] < k) ++*i;
    double n = x->k[*i + 1] - x->k[*i];
    return x->a[*i] + (x->a[*i + 1] - x->a[*i]) * ((k - x->k[*i]) / n);
}

/* Exactly n cycles: the convex mix of the two extremes (one jerk limit: the smaller). */
static int mix_with(const task *t, double j, double n, double *nearest, sj_plan *p)
{
    if (!(n >= 1 && n < 67108864.0)) return 0;
    path x, y, z;
    if (!extreme(t, j, n, &y)) return 0;
    double py = path_distance(&y, t->v0);
    double room = 2.5e-13 * (fabs(py) + fabs(t->h)) + (n <= 4 ? 3e-11 * (fabs(t->v0) + fabs(t->v1)) : 0);
    if (py < t->h - room) return 0;
    task o = mirrored(t);
    if (!extreme(&o, j, n, &x)) return 0;
    for (int i = 0; i < x.count; i++) x.a[i] = -x.a[i];
    double px = path_distance(&x, t->v0);
    if (px > t->h + room) { *nearest = px; return 0; }
    z.count = 0;
    int ix = 0, iy = 0, gx = 0, gy = 0;
    double lambda = py > px ? most(0, least(1, (t->h - px) / (py - px))) : 0;
    while (ix < x.count || iy < y.count) {
        double k = ix < x.count ? x.k[ix] : n;
        if (iy < y.count) k = least(k, y.k[iy]);
        double ax = path_at(&x, &gx, k), ay = path_at(&y, &gy, k);
        if (z.count < NODES) node(&z, k, k <= 0 ? t->a0 : k >= n ? 0 : ax + lambda * (ay - ax));
        while (ix < x.count && x.k[ix] <= k) ix++;
        while (iy < y.count && y.k[iy] <= k) iy++;
    }
    for (int i = 0; i < z.count; i++)
        if (j > (z.a[i] > 0 ? t->ju : t->jd) || (i > 0 && z.a[i] * z.a[i - 1] < 0 && j > least(t->ju, t->jd))) return 0;
    path_put(p, &z, t);
    p->kind = SJ_PLAN_MIX;
    return 1;
}

/* The larger jerk first: it serves where the acceleration keeps its sign. */
static int mix(const task *t, double n, double *nearest, sj_plan *p)
{
    if (t->ju != t->jd && mix_with(t, t->a0 > 0 || t->ju > t->jd ? most(t->ju, t->jd) : t->jd, n, nearest, p)) return 1;
    return mix_with(t, least(t->ju, t->jd), n, nearest, p);
}

/* The first length from n on that can be mixed, below `longest`; gives up where waiting longer only leads away. */
static int mix_from(const task *t, double *n, double longest, sj_plan *p)
{
    double last = INFINITY;
    for (int i = 0; i < LENGTH_STEPS && *n < longest; i++, *n += 1) {
        double nearest = -INFINITY;
        if (mix(t, *n, &nearest, p)) return 1;
        if (nearest > last) return 0;
        if (nearest > -INFINITY) last = nearest;
    }
    return 0;
}

/* ---- the ways, best first ---- */

/* Ramp, cruise, ramp with a peak at or above both ends. Sets the continuous optimum's length. */
static int by_cruise(const task *t, const family *f, double at_low, int far, seven *s, double *optimum)
{
    double v, t4 = 0, at_top = family_distance(t, f, t->vmax);
    if (at_top <= t->h) { v = t->vmax; t4 = (t->h - at_top) / v; }
    else v = family_peak(t, f, at_low, far);
    double x1 = most(0, v - f->vs), x2 = most(0, v - t->v1);
    double z1 = sqrt(x1 * t->ju), z2 = sqrt(x2 * t->jd);
    double t1, t2;
    if (z1 > t->au) { z1 = t->au; t1 = x1 / z1 + z1 / t->ju; } else t1 = 2 * z1 / t->ju;
    if (z2 > t->ad) { z2 = t->ad; t2 = x2 / z2 + z2 / t->jd; } else t2 = 2 * z2 / t->jd;
    *optimum = f->t0 + t1 + t4 + t2;
    double j1 = t->a0 < 0 ? least(t->ju, t->jd) : t->ju, n5, n6, n7;
    if (!(*optimum < LONGEST)) return 0;
    ramp_counts(t->a0, v - t->v0, z1, t->au, t->ju, j1, &s->n1, &s->n2, &s->n3);
    ramp_counts(0, v - t->v1, z2, t->ad, t->jd, t->jd, &n5, &n6, &n7);
    s->n5 = n5; s->n6 = n6;
    double m1 = s->n1 + s->n2 + s->n3, m2 = 2 * n5 + n6;
    s->n4 = 0;
    if (v > 0) {
        double n1 = s->n1, c = 0.5 * (n1 + s->n3) + s->n2, a = (v - t->v0 - 0.5 * n1 * t->a0) / c;
        double d1 = t->v0 * m1 + t->a0 * n1 * (0.5 * (s->n2 + s->n3) + n1 / 3)
                  + a * (n1 * (0.5 * (s->n2 + s->n3) + n1 / 6) + s->n2 * (s->n3 + 0.5 * s->n2) + s->n3 * s->n3 / 3);
        s->n4 = most(0, up((t->h - d1 - 0.5 * (v + t->v1) * m2) / v));
    }
    if (!seven_fit(t, s)) {
        int ok = 0;
        for (int i = 0; i < 2 && !ok; i++) { s->n4 += 1; ok = seven_fit(t, s); }
        /* the peak is where full jerk carries the start anyway: come to zero, or a little across it and back */
        double total = s->n1 + s->n2 + s->n3 + s->n4, n1 = most(1, up(fabs(t->a0) / j1));
        for (int i = 0; i < 3 && !ok; i++) {
            s->n1 = n1 + i; s->n2 = 0; s->n3 = 1; s->n4 = most(0, total - s->n1 - 2);
            ok = seven_fit(t, s);
        }
        if (!ok) return 0;
    }
    seven_shorten(t, s, up(*optimum));
    return 1;
}

/* Braking that is eased first: from a0 < 0 up to level b, down to level a, held, up to zero; never above zero.
   Two levels and two linear equations: velocity change and distance. */
typedef struct { double n1, n2, n3, n4, b, a; } four;

static int four_fit(const task *t, four *s)
{
    double n1 = s->n1, n2 = s->n2, n3 = s->n3, n4 = s->n4, r2 = n3 + n4, r1 = n2 + r2, one = 1 + SLACK;
    double vb = (n1 + n2) / 2, va = (n2 + n4) / 2 + n3;
    double pb = n1 * (r1 / 2 + n1 / 6) + n2 * (r2 / 2 + n2 / 3);
    double pa = n2 * (r2 / 2 + n2 / 6) + n3 * (n4 + n3 / 2) + n4 * n4 / 3;
    double dv = t->v1 - t->v0 - t->a0 * n1 / 2;
    double dp = t->h - t->v0 * (n1 + r1) - t->a0 * n1 * (r1 / 2 + n1 / 3);
    double det = va * pb - vb * pa;
    double b = (va * dp - pa * dv) / det, a = (pb * dv - vb * dp) / det;
    s->b = b; s->a = a;
    return b <= 0 && a <= 0 && a >= -t->ad * one && b >= -t->ad * one
        && fabs(b - t->a0) <= one * n1 * t->jd && fabs(a - b) <= one * n2 * t->jd && -a <= one * n4 * t->jd;
}
static void four_put(sj_plan *p, const task *t, const four *s)
{
    double d = t->sign;
    put(p, s->n1, d * ((s->b - t->a0) / s->n1));
    put(p, s->n2, d * ((s->a - s->b) / s->n2));
    put(p, s->n3, 0);
    put(p, s->n4, d * (-s->a / s->n4));
}

/* The continuous solution: x is the acceleration (downward) at which easing ends. */
static int by_easing(const task *t, const family *f, four *s, double *optimum)
{
    double j = t->jd, alpha = -t->a0, lo = 0, hi = alpha, x = alpha / 2, y = 0, z = 0, time = 0;
    double scale = 1e-12 * (fabs(t->h) + fabs(t->v0) * alpha / j);
    for (int i = 0; i < NEWTON_STEPS; i++) {
        double b = x / j, t1 = (alpha - x) / j, vs = f->vz + x * b, dt;
        y = vs - t->v1;
        z = sqrt(most(0, y * j));
        if (z > t->ad) { time = y / t->ad + t->ad / j; dt = 1 / t->ad; }
        else { time = 2 * z / j; dt = z > 0 ? 1 / z : 0; }
        double p1 = t1 * (t->v0 + t1 * (t->a0 / 2 + j * t1 / 6)), turn = t->v0 - t1 * (alpha + x) / 2;
        double e = p1 + 0.5 * (vs + t->v1) * time - b * (vs - x * b / 6) - t->h;
        if (e > 0) lo = x; else hi = x;
        if (fabs(e) <= scale) break;
        double slope = (-turn - vs) / j - 1.5 * b * b + b * (time + (vs + t->v1) * dt);
        double next = x - e / slope;
        if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
        if (fabs(next - x) <= 1e-12 * alpha) break;
        x = next;
    }
    double t1 = (alpha - x) / j, hold = 0;
    if (z > t->ad) { z = t->ad; hold = y / z - z / j; }
    double t2 = (z - x) / j, t4 = z / j;
    *optimum = t1 + t2 + hold + t4;
    double f1 = most(1, down(t1)), f2 = most(1, down(t2)), f3 = down(hold), f4 = most(1, down(t4));
    /* few roundings, shortest total first */
    static const signed char add[16][4] = {{0,0,0,0}, {1,0,0,0}, {0,1,0,0}, {0,0,1,0}, {0,0,0,1}, {1,1,0,0}, {1,0,1,0}, {1,0,0,1},
                                           {0,1,1,0}, {0,1,0,1}, {0,0,1,1}, {1,1,1,0}, {1,1,0,1}, {1,0,1,1}, {0,1,1,1}, {1,1,1,1}};
    for (int i = 0; i < 16; i++) {
        s->n1 = f1 + add[i][0]; s->n2 = f2 + add[i][1]; s->n3 = f3 + add[i][2]; s->n4 = f4 + add[i][3];
        if (s->n1 + s->n2 + s->n3 + s->n4 < *optimum * (1 - SLACK)) continue;
        if (four_fit(t, s)) return 1;
    }
    return 0;
}

/* Jerk of a cycle that takes the acceleration from `left` across zero. */
static double crossing_jerk(const task *t, double left)
{
    return least(least(t->ju, t->jd), left + (t->a0 > 0 ? t->ad : t->au));
}

/* Highest velocity (for a0 > 0, in its direction) on the way to zero acceleration in whole cycles: n of full jerk
   leave `left`, and the last one either ends at zero or crosses it with the smaller jerk. */
static double carried(const task *t, double *n, double *left, int *cross)
{
    double a = fabs(t->a0), j = t->a0 > 0 ? t->ju : t->jd, d = t->a0 > 0 ? 1 : -1;
    *n = down(a / j);
    *left = a - *n * j;
    if (*left <= 1e-13 * a) *left = 0;
    double small = crossing_jerk(t, *left);
    double v = t->v0 + d * *n * (a - *n * j / 2), landed = v + d * *left / 2;
    *cross = fabs(landed) > t->vmax * (1 + SLACK / 2) && v * d > 0 && *left < small;
    return *cross ? v + d * *left * *left / (2 * small) : landed;
}

/* Acceleration to zero, or across it in the last cycle where ending at zero would break the velocity limit. */
static void shed(task *t, sj_plan *p)
{
    double n, left, d = t->a0 > 0 ? t->sign : -t->sign, j = t->a0 > 0 ? t->ju : t->jd;
    int cross;
    sj_plan q;
    begin(&q);
    carried(t, &n, &left, &cross);
    put(&q, n, -d * j);
    if (left > 0) put(&q, 1, -d * (cross ? crossing_jerk(t, left) : left));
    *t = resume(t, &q);
    if (!cross) t->a0 = 0;
    for (int i = 0; i < q.count; i++) put(p, (double)q.phase[i].cycles, q.phase[i].jerk);
}

static int move(const task *start, sj_plan *p, int again);

/* Fastest ramp to (v, 0) from a start that can keep the limits, put into the plan. */
static int go_to_velocity(task *t, double v, sj_plan *p)
{
    path x;
    double j = t->ju;
    if (t->ju != t->jd) {
        double jz = t->a0 > 0 ? t->ju : t->jd, z = t->v0 + t->a0 * fabs(t->a0) / (2 * jz);
        if (t->a0 != 0 && (t->a0 > 0 ? v >= z + jz / 8 : v <= z - jz / 8)) j = jz;
        else {
            /* the sign changes: on a node, or in a cycle of the smaller jerk */
            shed(t, p);
            j = v > t->v0 ? t->ju : t->jd;
            if (t->a0 != 0) j = least(t->ju, t->jd);
        }
    }
    if (!ramp(t->v0, t->a0, v - t->v0, t->vmax * (1 + SLACK), t->au, t->ad, j, &x)) return 0;
    path_put(p, &x, t);
    t->h -= path_distance(&x, t->v0);
    t->v0 = v;
    t->a0 = 0;
    return 1;
}

/* Stop, rest to rest, wait if the plan is to last `length` cycles, run-up: the way that is always there. */
static int by_stopping(const task *start, double length, sj_plan *p)
{
    task t = *start, r;
    sj_plan head, runup;
    begin(&head);
    begin(&runup);
    if (!go_to_velocity(&t, 0, &head)) return 0;
    t = resume(start, &head);
    t.v0 = t.a0 = 0;
    for (int i = 0; i < head.count; i++) put(p, (double)head.phase[i].cycles, head.phase[i].jerk);
    double v1 = t.v1;
    if (v1 != 0) {
        r = t; r.h = r.first = 0;
        if (!go_to_velocity(&r, v1, &runup)) return 0;
        t.h += r.h;
        t.v1 = 0;
    }
    if (!move(&t, p, 0)) return 0;
    double wait = length - (double)(p->cycles + runup.cycles);
    if (wait < 0) return 0;
    if (wait < LONGEST) put_cruise(p, &t, wait);
    for (int i = 0; i < runup.count; i++) put(p, (double)runup.phase[i].cycles, runup.phase[i].jerk);
    p->kind = SJ_PLAN_STOP;
    return 1;
}

/* A start above the velocity limit, or carried over it: brakes as fast as jerk allows until it is inside. */
static void come_down(task *t, sj_plan *p)
{
    double n, left, top = t->vmax * (1 + SLACK / 2);
    int cross;
    double reached = carried(t, &n, &left, &cross);
    if (t->a0 < 0 && reached < -t->vmax * (1 + SLACK)) return;      /* it falls through: the other side's concern */
    if (!((t->a0 > 0 ? reached : t->v0) > t->vmax * (1 + SLACK))) return;
    sj_plan q;
    begin(&q);
    task u = *t;
    if (t->ju != t->jd && t->a0 > 0) {
        put(&q, n, -t->sign * t->ju);
        double small = crossing_jerk(t, left);
        if (left > 0) put(&q, 1, -t->sign * (left < small ? small : left));
        u = resume(t, &q);
        if (!(left > 0 && left < small)) u.a0 = 0;
    }
    path x;
    if (ramp(u.v0, u.a0, -t->vmax - u.v0, -1, t->au, t->ad, t->jd, &x)) {
        double v = u.v0;
        for (int i = 1; i < x.count; i++) {
            double a = x.a[i - 1], m = x.k[i] - x.k[i - 1], jerk = (x.a[i] - a) / m, lo = 0, hi = m;
            if (v + m * (a + m * jerk / 2) <= top && x.a[i] <= 0) {
                for (int s = 0; s < 64 && hi - lo > 1; s++) {
                    double mid = whole((lo + hi) / 2);
                    if (v + mid * (a + mid * jerk / 2) <= top && a + mid * jerk <= 0) hi = mid; else lo = mid;
                }
                put(&q, hi, t->sign * jerk);
                break;
            }
            put(&q, m, t->sign * jerk);
            v += m * (a + m * jerk / 2);
        }
    }
    for (int i = 0; i < q.count; i++) put(p, (double)q.phase[i].cycles, q.phase[i].jerk);
    *t = resume(t, &q);
}

/* A start outside its limits comes back as fast as jerk allows. */
static void come_back(task *t, sj_plan *p)
{
    if (fabs(t->a0) <= least(t->au, t->ad)
        && t->a0 * t->a0 <= 1.99 * least(t->ju, t->jd) * (t->vmax - fabs(t->v0) - 2 * least(t->ju, t->jd))) return;
    double amax = t->a0 > 0 ? t->au : t->ad, j = t->a0 > 0 ? t->ju : t->jd, d = t->a0 > 0 ? 1 : -1;
    if (fabs(t->a0) > amax * (1 + SLACK)) {
        sj_plan q;
        begin(&q);
        put(&q, down((fabs(t->a0) - amax) / j), -d * t->sign * j);
        task u = resume(t, &q);
        double left = fabs(u.a0) - amax;
        if (left > SLACK * amax) {
            /* the last cycle ends at the limit, unless that little of jerk spared costs the velocity limit */
            double n, rest;
            int cross;
            task w = u;
            w.v0 += d * (amax + left / 2);
            w.a0 = d * amax;
            double a = fabs(u.a0), small = crossing_jerk(&u, a), firm = a >= j ? j : a > small ? a : small;
            double c = carried(&w, &n, &rest, &cross);
            put(&q, 1, -d * t->sign * (fabs(c) > t->vmax * (1 + SLACK) && c * d > 0 ? firm : left));
            u = resume(t, &q);
        }
        *t = u;
        for (int i = 0; i < q.count; i++) put(p, (double)q.phase[i].cycles, q.phase[i].jerk);
    }
    come_down(t, p);
    *t = mirrored(t);
    come_down(t, p);
    *t = mirrored(t);
}

/* A seven-phase or four-phase plan of a task in the frame that pushes up; what is known of the optimum besides. */
typedef struct { task t; family f; int found; seven s; four e; double optimum, at_low, direct, short_of; } attempt;

static void best_of_phases(const task *start, attempt *a)
{
    task *t = &a->t;
    *t = *start;
    if (t->a0 < 0 || (t->a0 == 0 && t->h < 0)) *t = mirrored(t);
    a->f = family_of(t);
    a->at_low = family_distance(t, &a->f, a->f.low);
    double room = 1e-14 * (fabs(t->h) + fabs(a->at_low));
    a->direct = 0;
    if (t->h < a->at_low - room) {
        /* where the velocity turns against the push, easing a little first loses ground: see move() */
        a->direct = a->f.t0 + ramp_time(most(0, a->f.low - a->f.vs), t->au, t->ju)
                  + ramp_time(most(0, a->f.low - t->v1), t->ad, t->jd);
        a->short_of = a->at_low - t->h;
        *t = mirrored(t);
        a->f = family_of(t);
        a->at_low = family_distance(t, &a->f, a->f.low);
    }
    if (t->h >= a->at_low - room || a->f.vz <= t->v1)
        a->found = by_cruise(t, &a->f, a->at_low, 0, &a->s, &a->optimum) ? SJ_PLAN_CRUISE : 0;
    else
        a->found = by_easing(t, &a->f, &a->e, &a->optimum) ? SJ_PLAN_EASE : 0;
}

/* Acceleration to zero first: serves where the velocity limit, a cycle ahead, leaves no other way. */
static int by_shedding(const task *start, sj_plan *p)
{
    task t = *start;
    sj_plan q = *p;
    shed(&t, &q);
    if (!move(&t, &q, 0)) return 0;
    *p = q;
    return 1;
}

/* From a start that can keep the limits. */
static int move(const task *start, sj_plan *p, int again)
{
    if (start->h == 0 && start->v0 == 0 && start->a0 == 0 && start->v1 == 0) return 1;
    attempt a;
    best_of_phases(start, &a);
    double n = most(1, up(a.optimum)), longest = INFINITY;
    if (a.t.a0 < 0 && a.t.v1 < 0 && a.direct > 0 && a.optimum > a.direct + 2
        && a.short_of <= -a.t.a0 / a.t.jd * most(a.t.v0, -a.t.v1)) {
        double m = most(1, up(a.direct));
        if (mix_from(&a.t, &m, m + 3, p)) return 1;
    }
    if (a.found == SJ_PLAN_CRUISE) longest = seven_cycles(&a.s);
    if (a.found == SJ_PLAN_EASE) longest = a.e.n1 + a.e.n2 + a.e.n3 + a.e.n4;
    if (longest > n + (a.t.a0 == 0 ? 3 : 2) && mix_from(&a.t, &n, longest, p)) return 1;
    if (!a.found && a.t.v1 != 0) {
        /* no whole length near the shortest works: lose time by a dip of the velocity */
        task t = mirrored(&a.t);
        family f = family_of(&t);
        seven s;
        double optimum = 0;
        int found = by_cruise(&t, &f, family_distance(&t, &f, f.low), 1, &s, &optimum);
        n = most(n, up(optimum));
        longest = found ? seven_cycles(&s) : INFINITY;
        if (longest > n + 2 && mix_from(&t, &n, longest, p)) return 1;
        if (found) { seven_put(p, &t, &s); p->kind = SJ_PLAN_CRUISE; return 1; }
    }
    if (a.found == SJ_PLAN_CRUISE) seven_put(p, &a.t, &a.s);
    else if (a.found == SJ_PLAN_EASE) four_put(p, &a.t, &a.e);
    else if (!again) return 0;
    else return (start->a0 != 0 && by_shedding(start, p)) || by_stopping(start, INFINITY, p);
    p->kind = a.found;
    return 1;
}

/* ---- a given length ---- */

/* Time and distance of the fastest ramp to velocity v, in continuous time. */
static void ramp_to(const task *t, const family *u, const family *d, double v, double *time, double *distance)
{
    if (v >= u->vz) {
        double x = ramp_time(most(0, v - u->vs), t->au, t->ju);
        *time = u->t0 + x; *distance = u->p0 + (v + u->vs) / 2 * x;
    } else {
        double x = ramp_time(most(0, -v - d->vs), t->ad, t->jd);
        *time = d->t0 + x; *distance = -d->p0 + (v - d->vs) / 2 * x;
    }
}

/* Exactly n cycles: ramp, cruise at the velocity that fits, ramp. */
static int by_cruise_of(const task *t, double n, seven *s)
{
    task o = mirrored(t);
    family u = family_of(t), d = family_of(&o);
    double lo = -t->vmax, hi = t->vmax, v = least(hi, most(lo, t->h / n)), t1 = 0, t2 = 0;
    double scale = 1e-10 * (fabs(t->h) + t->vmax);
    double middle = 0.5 * (u.vz + t->v1);
    for (int i = 0; i < NEWTON_STEPS; i++) {
        double p1;
        ramp_to(t, &u, &d, v, &t1, &p1);
        double x = fabs(v - t->v1);
        t2 = v >= t->v1 ? ramp_time(x, t->ad, t->jd) : ramp_time(x, t->au, t->ju);
        double t4 = n - t1 - t2, next, e = 0;
        if (t4 < 0) {
            if (v > middle) hi = v; else lo = v;
            next = 0.5 * (lo + hi);
        } else {
            e = p1 + v * t4 + (v + t->v1) / 2 * t2 - t->h;
            if (fabs(e) <= scale) break;
            if (e > 0) hi = v; else lo = v;
            next = v - e / (t4 + 0.4 * (t1 + t2));
            if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
        }
        if (hi - lo <= 1e-9 * t->vmax) break;
        v = next;
    }
    double small = least(t->ju, t->jd);
    if (v >= u.vz) {
        double z = least(t->au, sqrt(most(0, v - u.vs) * t->ju));
        ramp_counts(t->a0, v - t->v0, z, t->au, t->ju, t->a0 < 0 ? small : t->ju, &s->n1, &s->n2, &s->n3);
    } else {
        double z = least(t->ad, sqrt(most(0, -v - d.vs) * t->jd));
        ramp_counts(-t->a0, t->v0 - v, z, t->ad, t->jd, t->a0 > 0 ? small : t->jd, &s->n1, &s->n2, &s->n3);
    }
    double n7, a2 = v >= t->v1 ? t->ad : t->au, j2 = v >= t->v1 ? t->jd : t->ju, x = fabs(v - t->v1);
    ramp_counts(0, x, least(a2, sqrt(x * j2)), a2, j2, j2, &s->n5, &s->n6, &n7);
    s->n4 = 0;
    double rest = n - seven_cycles(s);
    for (int i = 0; i < LENGTH_STEPS && rest >= 0; i++) {
        s->n4 = rest;
        if (seven_fit(t, s)) return 1;
        /* a little longer ramps have room for a higher cruise velocity */
        if (i & 1) s->n6 += 1; else s->n2 += 1;
        rest -= 1;
    }
    return 0;
}

static int in_cycles(const task *t, double n, sj_plan *p)
{
    seven s;
    if (n == 0) return t->h == 0 && t->v0 == t->v1 && t->a0 == 0;
    if (by_cruise_of(t, n, &s)) { seven_put(p, t, &s); p->kind = SJ_PLAN_CRUISE; return 1; }
    attempt a;
    best_of_phases(t, &a);
    { double nearest; return mix(&a.t, n, &nearest, p); }
}

/* ---- what callers see ---- */

static int valid(double h, double v0, double a0, double v1, const sj_limits *l)
{
    return isfinite(h) && isfinite(v0) && isfinite(a0) && isfinite(v1)
        && isfinite(l->velocity) && isfinite(l->acceleration) && isfinite(l->jerk)
        && isfinite(l->deceleration) && isfinite(l->deceleration_jerk)
        && l->velocity > 0 && l->acceleration > 0 && l->jerk > 0 && l->deceleration > 0 && l->deceleration_jerk > 0
        && fabs(v1) <= l->velocity * (1 + SLACK);
}

/* The task with "up" in the direction of the move: the sign of the first of these that is not zero. */
static task task_of(double h, double v0, double a0, double v1, double way, const sj_limits *l)
{
    double d = way < 0 ? -1 : 1;
    return (task){d * h, d * v0, d * a0, d * v1, l->velocity, l->acceleration, l->jerk,
                  l->deceleration, l->deceleration_jerk, d, d * a0};
}

int32_t sj_plan_move(double h, double v0, double a0, double v1, const sj_limits *l, sj_plan *p)
{
    begin(p);
    if (!valid(h, v0, a0, v1, l)) return SJ_PLAN_INVALID;
    task t = task_of(h, v0, a0, v1, h != 0 ? h : v1 != 0 ? v1 : v0 != 0 ? v0 : a0, l);
    come_back(&t, p);
    int back = p->count > 0 ? SJ_PLAN_RETURN : 0;
    int ok = move(&t, p, 1);
    p->kind += back;
    return ok ? SJ_PLAN_OK : SJ_PLAN_TOO_LONG;
}

int32_t sj_plan_velocity(double v0, double a0, double v1, const sj_limits *l, sj_plan *p)
{
    begin(p);
    if (!valid(0, v0, a0, v1, l)) return SJ_PLAN_INVALID;
    task t = task_of(0, v0, a0, v1, v1 != 0 ? v1 : v0 != 0 ? v0 : a0, l);
    come_back(&t, p);
    int back = p->count > 0 ? SJ_PLAN_RETURN : 0;
    if (!go_to_velocity(&t, t.v1, p)) return SJ_PLAN_TOO_LONG;
    p->kind = SJ_PLAN_RAMP + back;
    return SJ_PLAN_OK;
}

int32_t sj_plan_duration(double h, double v0, double a0, double v1, const sj_limits *l, int64_t cycles, sj_plan *p)
{
    int32_t status = sj_plan_move(h, v0, a0, v1, l, p);
    if (status != SJ_PLAN_OK || p->cycles == cycles) return status;
    if (p->cycles > cycles) return SJ_PLAN_BLOCKED;
    if ((double)cycles > LONGEST) return SJ_PLAN_TOO_LONG;
    sj_plan shortest = *p;
    task t = task_of(h, v0, a0, v1, h != 0 ? h : v1 != 0 ? v1 : v0 != 0 ? v0 : a0, l);
    begin(p);
    come_back(&t, p);
    int back = p->count > 0 ? SJ_PLAN_RETURN : 0;
    int64_t used = p->cycles;
    sj_plan start = *p;
    if (in_cycles(&t, (double)(cycles - used), p)) { p->kind += back; return SJ_PLAN_OK; }
    if (v1 == 0) {
        *p = shortest;
        put(p, (double)(cycles - p->cycles), 0);
        return SJ_PLAN_OK;
    }
    *p = start;
    if (by_stopping(&t, (double)cycles, p)) { p->kind += back; return SJ_PLAN_OK; }
    /* blocked: the next length that works */
    for (int64_t n = cycles + 1; n <= cycles + LENGTH_STEPS; n++) {
        *p = start;
        if (in_cycles(&t, (double)(n - used), p)) { p->kind += back; return SJ_PLAN_BLOCKED; }
    }
    *p = start;
    if (!by_stopping(&t, INFINITY, p)) return SJ_PLAN_TOO_LONG;
    p->kind += back;
    return SJ_PLAN_BLOCKED;
}

int32_t sj_planogether(int32_t n, const double *h, const double *v0, const double *a0, const double *v1,
                         const sj_limits *l, int64_t cycles, sj_plan *p)
{
    for (int32_t i = 0; i < n; i++) {
        int32_t status = sj_plan_move(h[i], v0[i], a0[i], v1[i], &l[i], &p[i]);
        if (status != SJ_PLAN_OK) return status;
        if (p[i].cycles > cycles) cycles = p[i].cycles;
    }
    for (int round = 0; round < 64; round++) {
        int blocked = 0;
        for (int32_t i = 0; i < n; i++) {
            if (p[i].cycles == cycles) continue;
            int32_t status = sj_plan_duration(h[i], v0[i], a0[i], v1[i], &l[i], cycles, &p[i]);
            if (status == SJ_PLAN_BLOCKED) { cycles = p[i].cycles; blocked = 1; break; }
            if (status != SJ_PLAN_OK) return status;
        }
        if (!blocked) return SJ_PLAN_OK;
    }
    return SJ_PLAN_BLOCKED;
}
