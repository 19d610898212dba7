/* Ramp, cruise, ramp: in continuous time, and as seven phases of whole cycles.

   In continuous time the peak velocity V is the one unknown: an acceleration at the start belongs to
   a ramp that began earlier, at vs = v0 - a0^2 / 2J, and
       h(V) = distance of the ramp vs -> V  +  distance of the ramp V -> v1.
   In whole cycles the lengths are given. What is left is linear, the paper's Eqs. (11)-(13) for any
   start: one equation for the cruise velocity v, and the level of the first ramp from it,
       h = v0 (m1 - q) + a0 r + v (q + n4 + m2 / 2) + v1 m2 / 2,   m1 = n1 + n2 + n3,
       a = (v - v0 - n1 a0 / 2) / ((n1 + n3) / 2 + n2),
   where r = n1 ((n2 + n3 - q) / 2 + n1 / 3), and q is the distance of the first ramp from rest to
   velocity 1, without a0.
   Work is bounded: NEWTON_STEPS per root, DURATION_STEPS cycles taken away.

   Never here: a choice between methods. */
#include "base/_math.h" /* cube root */
#include "planner/_internal.h"

/* ---- in continuous time ---- */

/* With a0 >= 0 the ramp began b = a0 / ju earlier, at vs = v0 - a0 b / 2. With a0 < 0 the acceleration
   is brought to zero first, in b = -a0 / jd, at vs = v0 + a0 b / 2. */
family sj_family_of(const task *t)
{
    family f;
    if (t->a0 >= 0) {
        double b = t->a0 / t->ju, w = t->a0 * b / 2;
        f.vs = t->v0 - w;
        f.vz = t->v0 + w;
        f.t0 = -b;
        f.p0 = -b * (f.vs + t->a0 * b / 6);
    } else {
        double b = -t->a0 / t->jd;
        f.vs = f.vz = t->v0 + t->a0 * b / 2;
        f.t0 = b;
        f.p0 = b * (t->v0 + t->a0 * b / 3);
    }
    f.low = most(f.vz, t->v1);
    return f;
}

/* Distance of ramp up to v and ramp down to v1:
       p0 + (v + vs) / 2 T(v - vs, au, ju) + (v + v1) / 2 T(v - v1, ad, jd),   T = ramp_time */
double sj_family_distance(const task *t, const family *f, double v)
{
    double x1 = most(0, v - f->vs), x2 = most(0, v - t->v1);
    return f->p0 + (v + f->vs) / 2 * ramp_time(x1, t->au, t->ju) +
           (v + t->v1) / 2 * ramp_time(x2, t->ad, t->jd);
}

/* The far root need not exist, and then the method is given up later: few steps serve where it
   does. */
enum { FAR_STEPS = 16 };

/* The velocity limit and the lowest peak in z = sqrt(J (v - base)), in which the distance is smooth: base is where
   the ramp is nothing that has the higher end. */
typedef struct {
    double base, jerk, low, high;
    int second; /* the ramp at base is the second one */
} peak_range;

static peak_range peak_range_of(const task *t, const family *f)
{
    int second = t->v1 >= f->vs;
    double base = most(f->vs, t->v1), j = second ? t->jd : t->ju;
    return (peak_range){base, j, sqrt(most(0, (f->low - base) * j)),
                        sqrt(most(0, (t->vmax - base) * j)), second};
}

/* Keeps the root between low and high: e is what the way is too long by at z. */
static void narrow(peak_range *k, double z, double e)
{
    if (e > 0)
        k->high = z;
    else
        k->low = z;
}

/* z to the next one, or to the middle where that is outside; whether it has moved by so little, relative, that
   it is the last (from the middle by SAME). */
static int is_last(const peak_range *k, double *z, double next, double little)
{
    double before = *z;
    if (!(next > k->low && next < k->high)) {
        next = 0.5 * (k->low + k->high);
        little = SAME;
    }
    *z = next;
    return fabs(next - before) <= little * before;
}

/* Peak velocity at which the family covers h, on its far side: steps of Newton from the velocity limit on. */
static double far_peak(const task *t, const family *f, double at_low)
{
    peak_range k = peak_range_of(t, f);
    double z = most(k.high, k.low), scale = 1e-13 * (fabs(t->h) + fabs(at_low));
    for (int i = 0; i < FAR_STEPS; i++) {
        double square = z * z / k.jerk, v = k.base + square, t1, t2, d1, d2;
        double x1 = k.second ? v - f->vs : square, x2 = k.second ? square : v - t->v1;
        if (x1 * t->ju >= t->au * t->au) {
            t1 = x1 / t->au + t->au / t->ju;
            d1 = 1 / t->au;
        } else {
            double r = k.second ? sqrt(most(x1, 0) * t->ju) : z;
            t1 = 2 * r / t->ju;
            d1 = 1 / r;
        }
        if (x2 * t->jd >= t->ad * t->ad) {
            t2 = x2 / t->ad + t->ad / t->jd;
            d2 = 1 / t->ad;
        } else {
            double r = k.second ? z : sqrt(most(x2, 0) * t->jd);
            t2 = 2 * r / t->jd;
            d2 = 1 / r;
        }
        double e = f->p0 + 0.5 * ((v + f->vs) * t1 + (v + t->v1) * t2) - t->h;
        narrow(&k, z, e);
        if (fabs(e) <= scale)
            break;
        double slope = 0.5 * (t1 + t2) + 0.5 * (v + f->vs) * d1 + 0.5 * (v + t->v1) * d2;
        slope = slope * 2 * z / k.jerk;
        if (is_last(&k, &z, z - e / slope, SAME))
            break;
    }
    return k.base + z * z / k.jerk;
}

/* Peak velocity at which the family covers h: with e what it is too long by, steps of Halley,
       z <- z - e e' / (e'^2 - e e'' / 2),
   inside a bracket. A step leaves the cube of the error: behind one of CLOSE there is none to be seen. The roots
   of both ramps share a quotient, since every division is waited for. */
static double family_peak(const task *t, const family *f, double at_low)
{
    peak_range k = peak_range_of(t, f);
    double x = t->h - at_low, jh = t->ju, ah = t->au;
    if (x <= 0)
        return f->low;
    if (t->jd != t->ju) {
        double q = 2 / (1 / sqrt(t->ju) + 1 / sqrt(t->jd));
        jh = q * q;
    }
    if (t->ad != t->au)
        ah = 2 * t->au * t->ad / (t->au + t->ad);
    double v = cube_root(x * x * jh / 4);
    if (v * jh > ah * ah) {
        double q = ah / jh;
        v = 0.5 * (sqrt(ah * (ah * q * q + 4 * x)) - ah * q);
    }
    double z = most(least(sqrt(most(0, (v + f->low - k.base) * k.jerk)), k.high), k.low);
    double scale = 1e-13 * (fabs(t->h) + fabs(at_low));
    double per_ju = 1 / t->ju, per_jd = 1 / t->jd, per_au = 1 / t->au, per_ad = 1 / t->ad;
    double per_j = k.second ? per_jd : per_ju, up = t->au * per_ju, down = t->ad * per_jd;
    for (int i = 0; i < NEWTON_STEPS; i++) {
        double square = z * z * per_j;
        v = k.base + square;
        double x1 = k.second ? v - f->vs : square, x2 = k.second ? square : v - t->v1;
        double r = sqrt(most(k.second ? x1 : x2, 0) * (k.second ? t->ju : t->jd));
        double r1 = k.second ? r : z, r2 = k.second ? z : r, per_both = 1 / (r * z);
        int flat1 = x1 * t->ju >= t->au * t->au, flat2 = x2 * t->jd >= t->ad * t->ad;
        /* times of the ramps, and their first and second derivatives by v */
        double t1 = flat1 ? x1 * per_au + up : 2 * r1 * per_ju;
        double t2 = flat2 ? x2 * per_ad + down : 2 * r2 * per_jd;
        double d1 = flat1 ? per_au : per_both * r2, d2 = flat2 ? per_ad : per_both * r1;
        double c1 = flat1 ? 0 : -0.5 * t->ju * d1 * d1 * d1;
        double c2 = flat2 ? 0 : -0.5 * t->jd * d2 * d2 * d2;
        double s1 = v + f->vs, s2 = v + t->v1, e = f->p0 + 0.5 * (s1 * t1 + s2 * t2) - t->h;
        narrow(&k, z, e);
        if (fabs(e) <= scale)
            break;
        double by_v = 0.5 * (t1 + t2 + s1 * d1 + s2 * d2);
        double by_v2 = d1 + d2 + 0.5 * (s1 * c1 + s2 * c2);
        double dv = 2 * z * per_j, slope = by_v * dv, bend = by_v2 * dv * dv + by_v * 2 * per_j;
        if (is_last(&k, &z, z - e * slope / (slope * slope - 0.5 * e * bend), CLOSE))
            break;
    }
    return k.base + z * z * per_j;
}

/* ---- in whole cycles ---- */

/* With the lengths fixed everything is linear in the cruise velocity (the paper's Eqs. 11-13 for
   any start): returns whether the plan keeps every limit. */
int sj_seven_fit(const task *t, seven *s)
{
    double n1 = s->n1, n2 = s->n2, n3 = s->n3, r2 = s->n5 + s->n6, m1 = n1 + n2 + n3,
           m2 = r2 + s->n5;
    double c = 1 / (0.5 * (n1 + n3) + n2), q = 0.5 * m1, rest = t->h;
    if (t->a0 != 0.0 || n1 != n3) {
        q = (n1 * (0.5 * (n2 + n3) + n1 * (1.0 / 6)) + n2 * (n3 + 0.5 * n2) + n3 * n3 * (1.0 / 3)) *
            c;
        rest -= t->a0 * n1 * (0.5 * (n2 + n3 - q) + n1 * (1.0 / 3));
    }
    double v = (rest - t->v0 * (m1 - q) - t->v1 * (0.5 * m2)) / (q + s->n4 + 0.5 * m2);
    double a = (v - t->v0 - 0.5 * n1 * t->a0) * c, w = v - t->v1;
    s->v = v;
    s->a = a;
    const double one = 1 + 4 * SLACK;
    if (!(fabs(v) <= t->vmax * one))
        return 0;
    double lim = w >= 0 ? least(t->ad, s->n5 * t->jd) : least(t->au, s->n5 * t->ju);
    if (!(fabs(w) <= lim * r2 * one))
        return 0;
    double amax = a >= 0 ? t->au : t->ad, jerk = a >= 0 ? t->ju : t->jd;
    if (!(fabs(a) <= one * least(amax, n3 * jerk)))
        return 0;
    if (a * t->a0 >= 0) {
        double j0 = t->a0 > 0 ? t->ju : t->a0 < 0 ? t->jd : jerk;
        return fabs(a - t->a0) <= one * n1 * j0;
    }
    if (!(fabs(a - t->a0) <= one * n1 * smaller_jerk(t)))
        return 0;
    /* the acceleration crosses zero inside the first phase: an extreme of the velocity */
    double turn = t->v0 + 0.5 * t->a0 * t->a0 * n1 / (t->a0 - a);
    return fabs(turn) <= t->vmax * one;
}

void sj_seven_put(sj_plan *p, const task *t, const seven *s)
{
    double j1 = (s->a - t->a0) / s->n1, j3 = -s->a / s->n3,
           j5 = (t->v1 - s->v) * (1 / (s->n5 + s->n6)) / s->n5, d = t->sign;
    /* the first of the plan, and what rises falls again: no rounding is left for a cruise to multiply */
    int at_zero = p->count == 0 && t->a0 == 0.0 && s->n1 == s->n3;
    if (t->a0 == 0.0 && s->n1 == s->n3)
        j3 = -j1;
    sj_put(p, s->n1, d * j1);
    sj_put(p, s->n2, 0);
    sj_put(p, s->n3, d * j3);
    if (at_zero)
        sj_put(p, s->n4, 0);
    else
        sj_put_cruise(p, t, s->n4);
    sj_put(p, s->n5, d * j5);
    sj_put(p, s->n6, 0);
    sj_put(p, s->n5, -d * j5);
}

/* Cycles of rise, hold, fall that change the velocity by x from no acceleration toward level z and
   back: rise and fall are equal.
       x = level (rise + hold) */
void sj_even_counts(double x, double z, double amax, double jerk, double *rise, double *hold)
{
    double best = INFINITY, fewest = most(1, down(z / jerk));
    *rise = 1;
    *hold = 0;
    for (int i = 0; i < 2; i++) {
        double r = fewest + i, level = least(amax, r * jerk), m = most(2 * r, up(x / level + r));
        if (m < best) {
            best = m;
            *rise = r;
            *hold = m - 2 * r;
        }
    }
}

/* Cycles of rise (n1), hold (n2), fall (n3) that change the velocity by x from acceleration a0
   toward level z.
       x = a0 n1 / 2 + level ((n1 + n3) / 2 + n2) */
void sj_ramp_counts(double a0, double x, double z, double amax, double jerk, double jerk1,
                    double *n1, double *n2, double *n3)
{
    if (a0 == 0) {
        sj_even_counts(x, z, amax, jerk, n1, n2);
        *n3 = *n1;
        return;
    }
    double f = z / jerk, g = (z - a0) / jerk1, best = INFINITY;
    double f0 = most(1, down(f)), g0 = most(1, down(g));
    *n1 = *n3 = 1;
    *n2 = 0;
    for (int i = 0; i < 2; i++)
        for (int k = g < 1 && f0 > 1 ? -1 : 0; k < 2; k++) {
            double r1 = g0 + i, r3 = f0 + k;
            double level = least(amax, least(r3 * jerk, a0 + r1 * jerk1));
            if (!(level > 0))
                continue;
            double m = most(r1 + r3, up((x - 0.5 * r1 * a0) / level + 0.5 * (r1 + r3)));
            if (m < best) {
                best = m;
                *n1 = r1;
                *n3 = r3;
                *n2 = m - r1 - r3;
            }
        }
}

/* Takes single cycles away as long as the limits allow; `least_cycles` cannot be undercut. `round`: how many
   have been taken. */
void sj_seven_shorten(const task *t, seven *s, double least_cycles, int round)
{
    for (; round < DURATION_STEPS && seven_cycles(s) - least_cycles >= 1; round++) {
        seven c = *s;
        if (s->n4 > 0) {
            c.n4 -= 1;
            if (sj_seven_fit(t, &c)) {
                *s = c;
                continue;
            }
            c.n4 += 1;
        }
        if (s->n2 > 0) {
            c.n2 -= 1;
            if (sj_seven_fit(t, &c)) {
                *s = c;
                continue;
            }
            c.n2 += 1;
        }
        if (s->n6 > 0) {
            c.n6 -= 1;
            if (sj_seven_fit(t, &c)) {
                *s = c;
                continue;
            }
            c.n6 += 1;
        }
        if (s->n1 > 1) {
            c.n1 -= 1;
            if (sj_seven_fit(t, &c)) {
                *s = c;
                continue;
            }
            c.n1 += 1;
        }
        if (s->n3 > 1) {
            c.n3 -= 1;
            if (sj_seven_fit(t, &c)) {
                *s = c;
                continue;
            }
            c.n3 += 1;
        }
        if (s->n5 > 1) {
            c.n5 -= 1;
            c.n6 += 1;
            if (sj_seven_fit(t, &c)) {
                *s = c;
                continue;
            }
        }
        break;
    }
}

/* ---- from the one to the other ---- */

/* Ramp, cruise, ramp with a peak at or above both ends. Sets *optimum, the time in continuous time. */
int sj_by_cruise(const task *t, const family *f, double at_low, int far, seven *s, double *optimum)
{
    double v, t4 = 0, at_top = sj_family_distance(t, f, t->vmax);
    if (at_top <= t->h) {
        v = t->vmax;
        t4 = (t->h - at_top) / v;
    } else
        v = far ? far_peak(t, f, at_low) : family_peak(t, f, at_low);
    double x1 = most(0, v - f->vs), x2 = most(0, v - t->v1);
    double z1 = sqrt(x1 * t->ju), z2 = sqrt(x2 * t->jd);
    double t1, t2;
    if (z1 > t->au) {
        z1 = t->au;
        t1 = x1 / z1 + z1 / t->ju;
    } else
        t1 = 2 * z1 / t->ju;
    if (z2 > t->ad) {
        z2 = t->ad;
        t2 = x2 / z2 + z2 / t->jd;
    } else
        t2 = 2 * z2 / t->jd;
    *optimum = f->t0 + t1 + t4 + t2;
    double j1 = t->a0 < 0 ? smaller_jerk(t) : t->ju, n5, n6;
    if (!(*optimum < LONGEST))
        return 0;
    sj_ramp_counts(t->a0, v - t->v0, z1, t->au, t->ju, j1, &s->n1, &s->n2, &s->n3);
    sj_even_counts(v - t->v1, z2, t->ad, t->jd, &n5, &n6);
    s->n5 = n5;
    s->n6 = n6;
    double m1 = s->n1 + s->n2 + s->n3, m2 = 2 * n5 + n6;
    s->n4 = 0;
    if (v > 0) {
        double n1 = s->n1, c = 0.5 * (n1 + s->n3) + s->n2, a = (v - t->v0 - 0.5 * n1 * t->a0) / c;
        double d1 = t->v0 * m1 + t->a0 * n1 * (0.5 * (s->n2 + s->n3) + n1 / 3) +
                    a * (n1 * (0.5 * (s->n2 + s->n3) + n1 / 6) + s->n2 * (s->n3 + 0.5 * s->n2) +
                         s->n3 * s->n3 / 3);
        s->n4 = most(0, up((t->h - d1 - 0.5 * (v + t->v1) * m2) / v));
    }
    if (!sj_seven_fit(t, s)) {
        int ok = 0;
        for (int i = 0; i < 2 && !ok; i++) {
            s->n4 += 1;
            ok = sj_seven_fit(t, s);
        }
        /* the peak is where full jerk carries the start anyway: come to zero, or a little across it
           and back */
        double total = s->n1 + s->n2 + s->n3 + s->n4, n1 = most(1, up(fabs(t->a0) / j1));
        for (int i = 0; i < 3 && !ok; i++) {
            s->n1 = n1 + i;
            s->n2 = 0;
            s->n3 = 1;
            s->n4 = most(0, total - s->n1 - 2);
            ok = sj_seven_fit(t, s);
        }
        if (!ok)
            return 0;
    }
    sj_seven_shorten(t, s, up(*optimum), 0);
    return 1;
}
