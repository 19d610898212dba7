/* Plans from any state to any target, in whole control cycles.

   Holds the paper's Eqs. 9-14 for any start: with the lengths of the phases fixed to whole cycles,
   levels and velocity follow from two linear equations (sj_seven_fit, four_fit). The lengths come
   from the continuous optimum, which is one scalar root: ramp, cruise, ramp with the peak
   velocity as unknown (family), or braking that is eased for a while (by_easing). Where no
   rounding serves, the mix of two plans of equal length does (_mix.c); where that fails too, the
   acceleration is shed first; and the last resort, which always exists, is to stop (_rescue.c).
   A start outside its limits is brought back first (_return.c).

   Frame: cycle = 1, position relative to the start; h > 0 is "up" at the entrance, and the task is
   mirrored when the push goes the other way. Limits (clause of the contract): acceleration and
   jerk in the direction of the move, deceleration and deceleration jerk against it, whatever the
   sign of the velocity; the direction is the sign of h, or of v1, v0, a0, the first that is not
   zero (sj_plan_velocity: of v1, v0, a0). Work is bounded: NEWTON_STEPS per root, LENGTH_STEPS
   lengths per search.

   Never here: a length that is given (_length.c), memory, clocks, statics, input or output, following error, cycle time. */
#include "_plan.h"

/* ---- the shortest move in continuous time ---- */

family sj_family_of(const task *t)
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
    return f->p0 + (v + f->vs) / 2 * ramp_time(x1, t->au, t->ju)
        + (v + t->v1) / 2 * ramp_time(x2, t->ad, t->jd);
}

/* The far root need not exist, and then the way is given up later: few steps serve where it
   does. */
enum { FAR_STEPS = 16 };

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
    if (v * jh > ah * ah) {
        double q = ah / jh;
        v = 0.5 * (sqrt(ah * (ah * q * q + 4 * x)) - ah * q);
    }
    double z = sqrt(most(0, (v + f->low - base) * jb));
    if (far || !(z < hi)) z = hi;
    if (z < lo) z = lo;
    double scale = 1e-13 * (fabs(t->h) + fabs(at_low));
    if (!far && x <= 0) return f->low;
    for (int i = 0; i < (far ? FAR_STEPS : NEWTON_STEPS); i++) {
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
        double slope = 0.5 * (t1 + t2) + 0.5 * (v + f->vs) * d1 + 0.5 * (v + t->v1) * d2;
        slope = slope * 2 * z / jb;
        double next = z - e / slope;
        if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
        if (fabs(next - z) <= 1e-13 * z) { z = next; break; }
        z = next;
    }
    return base + z * z / jb;
}

/* ---- seven phases ---- */

/* With the lengths fixed everything is linear in the cruise velocity (the paper's Eqs. 11-13 for
   any start): returns whether the plan keeps every limit. */
int sj_seven_fit(const task *t, seven *s)
{
    double n1 = s->n1, n2 = s->n2, n3 = s->n3, r2 = s->n5 + s->n6, m1 = n1 + n2 + n3,
        m2 = r2 + s->n5;
    double c = 1 / (0.5 * (n1 + n3) + n2), q = 0.5 * m1, rest = t->h;
    if (t->a0 != 0.0 || n1 != n3) {
        q = (n1 * (0.5 * (n2 + n3) + n1 * (1.0 / 6)) + n2 * (n3 + 0.5 * n2)
            + n3 * n3 * (1.0 / 3)) * c;
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

void sj_seven_put(sj_plan *p, const task *t, const seven *s)
{
    double j1 = (s->a - t->a0) / s->n1, j3 = -s->a / s->n3,
        j5 = (t->v1 - s->v) * (1 / (s->n5 + s->n6)) / s->n5, d = t->sign;
    /* the first of the plan, and what rises falls again: no rounding is left for a cruise to multiply */
    int at_zero = p->count == 0 && t->a0 == 0.0 && s->n1 == s->n3;
    if (t->a0 == 0.0 && s->n1 == s->n3) j3 = -j1;
    sj_put(p, s->n1, d * j1);
    sj_put(p, s->n2, 0);
    sj_put(p, s->n3, d * j3);
    if (at_zero) sj_put(p, s->n4, 0); else sj_put_cruise(p, t, s->n4);
    sj_put(p, s->n5, d * j5);
    sj_put(p, s->n6, 0);
    sj_put(p, s->n5, -d * j5);
}

/* Cycles of rise, hold, fall that change the velocity by x from no acceleration toward level z and
   back: rise and fall are equal. */
void sj_even_counts(double x, double z, double amax, double jerk, double *rise, double *hold)
{
    double best = INFINITY, fewest = most(1, down(z / jerk));
    *rise = 1; *hold = 0;
    for (int i = 0; i < 2; i++) {
        double r = fewest + i, level = least(amax, r * jerk), m = most(2 * r, up(x / level + r));
        if (m < best) { best = m; *rise = r; *hold = m - 2 * r; }
    }
}

/* Cycles of rise (n1), hold (n2), fall (n3) that change the velocity by x from acceleration a0
   toward level z. */
void sj_ramp_counts(double a0, double x, double z, double amax, double jerk, double jerk1,
    double *n1, double *n2, double *n3)
{
    if (a0 == 0) { sj_even_counts(x, z, amax, jerk, n1, n2); *n3 = *n1; return; }
    double f = z / jerk, g = (z - a0) / jerk1, best = INFINITY;
    double f0 = most(1, down(f)), g0 = most(1, down(g));
    *n1 = *n3 = 1; *n2 = 0;
    for (int i = 0; i < 2; i++)
        for (int k = g < 1 && f0 > 1 ? -1 : 0; k < 2; k++) {
            double r1 = g0 + i, r3 = f0 + k;
            double level = least(amax, least(r3 * jerk, a0 + r1 * jerk1));
            if (!(level > 0)) continue;
            double m = most(r1 + r3, up((x - 0.5 * r1 * a0) / level + 0.5 * (r1 + r3)));
            if (m < best) { best = m; *n1 = r1; *n3 = r3; *n2 = m - r1 - r3; }
        }
}

/* Takes single cycles away as long as the limits allow; `least_cycles` cannot be undercut. */
static void seven_shorten(const task *t, seven *s, double least_cycles)
{
    for (int round = 0; round < LENGTH_STEPS && seven_cycles(s) - least_cycles >= 1; round++) {
        seven c = *s;
        if (s->n4 > 0) { c.n4 -= 1; if (sj_seven_fit(t, &c)) { *s = c; continue; } c.n4 += 1; }
        if (s->n2 > 0) { c.n2 -= 1; if (sj_seven_fit(t, &c)) { *s = c; continue; } c.n2 += 1; }
        if (s->n6 > 0) { c.n6 -= 1; if (sj_seven_fit(t, &c)) { *s = c; continue; } c.n6 += 1; }
        if (s->n1 > 1) { c.n1 -= 1; if (sj_seven_fit(t, &c)) { *s = c; continue; } c.n1 += 1; }
        if (s->n3 > 1) { c.n3 -= 1; if (sj_seven_fit(t, &c)) { *s = c; continue; } c.n3 += 1; }
        if (s->n5 > 1) { c.n5 -= 1; c.n6 += 1; if (sj_seven_fit(t, &c)) { *s = c; continue; } }
        break;
    }
}

/* ---- the ways, best first ---- */

/* Ramp, cruise, ramp with a peak at or above both ends. Sets the continuous optimum's length. */
static int by_cruise(const task *t, const family *f, double at_low, int far, seven *s,
    double *optimum)
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
    double j1 = t->a0 < 0 ? least(t->ju, t->jd) : t->ju, n5, n6;
    if (!(*optimum < LONGEST)) return 0;
    sj_ramp_counts(t->a0, v - t->v0, z1, t->au, t->ju, j1, &s->n1, &s->n2, &s->n3);
    sj_even_counts(v - t->v1, z2, t->ad, t->jd, &n5, &n6);
    s->n5 = n5; s->n6 = n6;
    double m1 = s->n1 + s->n2 + s->n3, m2 = 2 * n5 + n6;
    s->n4 = 0;
    if (v > 0) {
        double n1 = s->n1, c = 0.5 * (n1 + s->n3) + s->n2, a = (v - t->v0 - 0.5 * n1 * t->a0) / c;
        double d1 = t->v0 * m1 + t->a0 * n1 * (0.5 * (s->n2 + s->n3) + n1 / 3)
                  + a * (n1 * (0.5 * (s->n2 + s->n3) + n1 / 6) + s->n2 * (s->n3 + 0.5 * s->n2)
                      + s->n3 * s->n3 / 3);
        s->n4 = most(0, up((t->h - d1 - 0.5 * (v + t->v1) * m2) / v));
    }
    if (!sj_seven_fit(t, s)) {
        int ok = 0;
        for (int i = 0; i < 2 && !ok; i++) { s->n4 += 1; ok = sj_seven_fit(t, s); }
        /* the peak is where full jerk carries the start anyway: come to zero, or a little across it
           and back */
        double total = s->n1 + s->n2 + s->n3 + s->n4, n1 = most(1, up(fabs(t->a0) / j1));
        for (int i = 0; i < 3 && !ok; i++) {
            s->n1 = n1 + i; s->n2 = 0; s->n3 = 1; s->n4 = most(0, total - s->n1 - 2);
            ok = sj_seven_fit(t, s);
        }
        if (!ok) return 0;
    }
    seven_shorten(t, s, up(*optimum));
    return 1;
}

/* Braking that is eased first: from a0 < 0 up to level b, down to level a, held, up to zero; never
   above zero. Two levels and two linear equations: velocity change and distance. */
typedef struct { double n1, n2, n3, n4, b, a; } four;

static int four_fit(const task *t, four *s)
{
    double n1 = s->n1, n2 = s->n2, n3 = s->n3, n4 = s->n4, r2 = n3 + n4, r1 = n2 + r2,
        one = 1 + SLACK;
    double vb = (n1 + n2) / 2, va = (n2 + n4) / 2 + n3;
    double pb = n1 * (r1 / 2 + n1 / 6) + n2 * (r2 / 2 + n2 / 3);
    double pa = n2 * (r2 / 2 + n2 / 6) + n3 * (n4 + n3 / 2) + n4 * n4 / 3;
    double dv = t->v1 - t->v0 - t->a0 * n1 / 2;
    double dp = t->h - t->v0 * (n1 + r1) - t->a0 * n1 * (r1 / 2 + n1 / 3);
    double det = va * pb - vb * pa;
    double b = (va * dp - pa * dv) / det, a = (pb * dv - vb * dp) / det;
    s->b = b; s->a = a;
    return b <= 0 && a <= 0 && a >= -t->ad * one && b >= -t->ad * one
        && fabs(b - t->a0) <= one * n1 * t->jd && fabs(a - b) <= one * n2 * t->jd
            && -a <= one * n4 * t->jd;
}
static void four_put(sj_plan *p, const task *t, const four *s)
{
    double d = t->sign;
    sj_put(p, s->n1, d * ((s->b - t->a0) / s->n1));
    sj_put(p, s->n2, d * ((s->a - s->b) / s->n2));
    sj_put(p, s->n3, 0);
    sj_put(p, s->n4, d * (-s->a / s->n4));
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
        double p1 = t1 * (t->v0 + t1 * (t->a0 / 2 + j * t1 / 6)),
            turn = t->v0 - t1 * (alpha + x) / 2;
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
    static const signed char add[16][4] = {
        {0, 0, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}, {1, 1, 0, 0},
        {1, 0, 1, 0}, {1, 0, 0, 1}, {0, 1, 1, 0}, {0, 1, 0, 1}, {0, 0, 1, 1}, {1, 1, 1, 0},
        {1, 1, 0, 1}, {1, 0, 1, 1}, {0, 1, 1, 1}, {1, 1, 1, 1}};
    for (int i = 0; i < 16; i++) {
        s->n1 = f1 + add[i][0];
        s->n2 = f2 + add[i][1];
        s->n3 = f3 + add[i][2];
        s->n4 = f4 + add[i][3];
        if (s->n1 + s->n2 + s->n3 + s->n4 < *optimum * (1 - SLACK)) continue;
        if (four_fit(t, s)) return 1;
    }
    return 0;
}

/* A seven-phase or four-phase plan of a task in the frame that pushes up; what is known of the
   optimum besides. */
typedef struct {
    task t;
    family f;
    int found;
    seven s;
    four e;
    double optimum, at_low, direct, short_of;
    /* with two jerks: the acceleration against the push is brought to zero, on a node */
    sj_plan head;
    task rest;          /* what the seven phases do: t, or what the head leaves */
} attempt;

static double found_cycles(const attempt *a)
{
    if (a->found == SJ_PLAN_CRUISE) return (double)a->head.cycles + seven_cycles(&a->s);
    if (a->found == SJ_PLAN_EASE) return a->e.n1 + a->e.n2 + a->e.n3 + a->e.n4;
    return INFINITY;
}

static void found_put(const attempt *a, sj_plan *p)
{
    if (a->found == SJ_PLAN_CRUISE) {
        sj_append(p, &a->head);
        sj_seven_put(p, &a->rest, &a->s);
    } else
        four_put(p, &a->t, &a->e);
    p->kind = a->found;
}

/* With two jerks an acceleration against the push comes to zero on a node, so that each side of
   zero has its own. */
static int cruise_after_zero(attempt *a, int far)
{
    task *u = &a->rest;
    *u = a->t;
    sj_begin(&a->head);
    if (u->ju == u->jd || u->a0 >= 0)
        return by_cruise(u, &a->f, a->at_low, far, &a->s, &a->optimum) ? SJ_PLAN_CRUISE : 0;
    sj_shed(u, &a->head);
    family f = sj_family_of(u);
    int found = by_cruise(u, &f, family_distance(u, &f, f.low), far, &a->s, &a->optimum);
    a->optimum += (double)a->head.cycles;
    return found ? SJ_PLAN_CRUISE : 0;
}

/* Begins an attempt: the task is turned so that its push is up. Returns whether h lies beyond what the
   lowest peak covers. */
static int push_up(const task *start, attempt *a)
{
    task *t = &a->t;
    *t = *start;
    if (t->a0 < 0 || (t->a0 == 0 && t->h < 0)) *t = mirrored(t);
    a->f = sj_family_of(t);
    a->at_low = family_distance(t, &a->f, a->f.low);
    double room = 1e-14 * (fabs(t->h) + fabs(a->at_low));
    a->direct = 0;
    if (t->h < a->at_low - room) {
        /* where the velocity turns against the push, easing a little first loses ground: see
           sj_move() */
        a->direct = a->f.t0 + ramp_time(most(0, a->f.low - a->f.vs), t->au, t->ju)
                  + ramp_time(most(0, a->f.low - t->v1), t->ad, t->jd);
        a->short_of = a->at_low - t->h;
        *t = mirrored(t);
        a->f = sj_family_of(t);
        a->at_low = family_distance(t, &a->f, a->f.low);
    }
    return t->h >= a->at_low - room;
}

task sj_pushed_up(const task *start)
{
    attempt a;
    push_up(start, &a);
    return a.t;
}

static void best_of_phases(const task *start, attempt *a)
{
    int beyond = push_up(start, a);
    sj_begin(&a->head);
    if (beyond || a->f.vz <= a->t.v1)
        a->found = cruise_after_zero(a, 0);
    else
        a->found = by_easing(&a->t, &a->f, &a->e, &a->optimum) ? SJ_PLAN_EASE : 0;
}

/* From a start that can keep the limits. The ways, in order: seven or four phases; a mix where
   these are more than two cycles (at rest three) longer than the optimum, or missing; a dip of the
   velocity; and, `again` allowing, the acceleration shed first, or a stop. */
int sj_move(const task *start, sj_plan *p, int again)
{
    if (start->h == 0 && start->v0 == 0 && start->a0 == 0 && start->v1 == 0) return 1;
    attempt a;
    best_of_phases(start, &a);
    double n = most(1, up(a.optimum)), longest = INFINITY;
    summit both[2] = {{0, 0, 0}, {0, 0, 0}};
    if (a.t.a0 < 0 && a.t.v1 < 0 && a.direct > 0 && a.optimum > a.direct + 2
        && a.short_of <= -a.t.a0 / a.t.jd * most(a.t.v0, -a.t.v1)) {
        double m = most(1, up(a.direct));
        if (sj_mix_from(&a.t, &m, m + 3, both, p)) return 1;
    }
    longest = found_cycles(&a);
    if (longest > n + (a.t.a0 == 0 ? 3 : 2)) {
        /* zero on a node, which the head is for, may cost a part of a cycle */
        if (a.head.cycles > 0 && n > 1) n -= 1;
        if (sj_mix_from(&a.t, &n, longest, both, p)) return 1;
    }
    if (!a.found && a.t.v1 != 0) {
        /* no whole length near the shortest works: lose time by a dip of the velocity */
        attempt d;
        summit turned[2] = {both[1], both[0]};
        d.t = mirrored(&a.t);
        d.f = sj_family_of(&d.t);
        d.at_low = family_distance(&d.t, &d.f, d.f.low);
        d.found = cruise_after_zero(&d, 1);
        n = most(n, up(d.optimum));
        longest = found_cycles(&d);
        if (longest > n + 2 && sj_mix_from(&d.t, &n, longest, turned, p)) return 1;
        if (d.found) { found_put(&d, p); return 1; }
    }
    if (a.found) { found_put(&a, p); return 1; }
    if (!again) return 0;
    return (start->a0 != 0 && sj_by_shedding(start, p)) || sj_by_stopping(start, INFINITY, p);
}

/* ---- what callers see ---- */

int sj_valid(double h, double v0, double a0, double v1, const sj_limits *l)
{
    return isfinite(h) && isfinite(v0) && isfinite(a0) && isfinite(v1)
        && isfinite(l->velocity) && isfinite(l->acceleration) && isfinite(l->jerk)
        && isfinite(l->deceleration) && isfinite(l->deceleration_jerk)
        && l->velocity > 0 && l->acceleration > 0 && l->jerk > 0 && l->deceleration > 0
            && l->deceleration_jerk > 0
        && fabs(v1) <= l->velocity * (1 + SLACK);
}

/* The task with "up" in the direction of the move: the sign of the first of these that is not
   zero. */
task sj_task_of(double h, double v0, double a0, double v1, const sj_limits *l)
{
    double way = h != 0 ? h : v1 != 0 ? v1 : v0 != 0 ? v0 : a0;
    double d = way < 0 ? -1 : 1;
    return (task){d * h, d * v0, d * a0, d * v1, l->velocity, l->acceleration, l->jerk,
                  l->deceleration, l->deceleration_jerk, d, d * a0};
}

/* What rounding in the plan is relative to. */
void sj_note_scale(sj_plan *p, const sj_limits *l)
{
    p->velocity = l->velocity;
    p->acceleration = most(l->acceleration, l->deceleration);
}

/* A move, or a change of velocity where `ramp`, whose first acceleration would break the velocity
   limit if it ended on a node. The ways may cross zero by themselves; else a crossing comes first,
   the gentlest or the hardest, whichever is sooner. */
static int across(const task *start, int ramp, sj_plan *p)
{
    sj_plan q = *p, r = *p;
    task t = *start;
    int64_t used = p->cycles;
    int ok = 0;
    if ((ramp ? sj_go_to_velocity(&t, t.v1, &q) : sj_move(&t, &q, 1))
        && !sj_leaves_velocity(start, &q, used)) {
        if (start->ju == start->jd || q.kind != SJ_PLAN_MIX) { *p = q; return 1; }
        ok = 1;
    }
    t = *start;
    if (!ok) {
        q = *p;
        sj_settle(&t, &q);
        ok = ramp ? sj_go_to_velocity(&t, t.v1, &q) : sj_move(&t, &q, 1);
        t = *start;
    }
    if (sj_cross(&t, &r) && (ramp ? sj_go_to_velocity(&t, t.v1, &r) : sj_move(&t, &r, 1))
        && (!ok || r.cycles < q.cycles)) {
        *p = r;
        return 1;
    }
    *p = q;
    return ok;
}

int32_t sj_plan_move(double h, double v0, double a0, double v1, const sj_limits *l, sj_plan *p)
{
    sj_begin(p);
    if (!sj_valid(h, v0, a0, v1, l)) return SJ_PLAN_INVALID;
    task t = sj_task_of(h, v0, a0, v1, l);
    int lands = sj_come_back(&t, p), back = p->count > 0 ? SJ_PLAN_RETURN : 0;
    int ok = lands ? sj_move(&t, p, 1) : across(&t, 0, p);
    p->kind += back;
    sj_note_scale(p, l);
    return ok ? SJ_PLAN_OK : SJ_PLAN_TOO_LONG;
}

int32_t sj_plan_velocity(double v0, double a0, double v1, const sj_limits *l, sj_plan *p)
{
    sj_begin(p);
    if (!sj_valid(0, v0, a0, v1, l)) return SJ_PLAN_INVALID;
    task t = sj_task_of(0, v0, a0, v1, l);
    int lands = sj_come_back(&t, p), back = p->count > 0 ? SJ_PLAN_RETURN : 0;
    if (!(lands ? sj_go_to_velocity(&t, t.v1, p) : across(&t, 1, p))) return SJ_PLAN_TOO_LONG;
    p->kind = SJ_PLAN_RAMP + back;
    sj_note_scale(p, l);
    return SJ_PLAN_OK;
}
