/* The shortest move from a start that can keep the limits: the methods that lead to the target at once.

   The lengths come from the continuous optimum, which is one scalar root: ramp, cruise, ramp with the
   peak velocity as unknown (_seven.c), or braking that is eased for a while (by_easing). The latter has
   two levels, b and a, and two linear equations, for the velocity and the distance:
       v1 - v0 - a0 n1 / 2                          = vb b + va a
       h - v0 (n1 + r1) - a0 n1 (r1 / 2 + n1 / 3)   = pb b + pa a.
   Where no rounding to whole cycles serves, the convex combination of two plans of equal duration does
   (_convex.c). Work is bounded: NEWTON_STEPS per root, DURATION_STEPS durations per search.

   Never here: a duration that is given (_duration.c), what is left to do where all this fails
   (_fallback.c), cycle time. */
#include "planner/_internal.h"

/* ---- braking that is eased first: four phases ---- */

/* Braking that is eased first: from a0 < 0 up to level b, down to level a, held, up to zero; never
   above zero. Two levels and two linear equations: velocity change and distance. */
typedef struct {
    double n1, n2, n3, n4, b, a;
} four;

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
    s->b = b;
    s->a = a;
    return b <= 0 && a <= 0 && a >= -t->ad * one && b >= -t->ad * one &&
           fabs(b - t->a0) <= one * n1 * t->jd && fabs(a - b) <= one * n2 * t->jd &&
           -a <= one * n4 * t->jd;
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
        if (z > t->ad) {
            time = y / t->ad + t->ad / j;
            dt = 1 / t->ad;
        } else {
            time = 2 * z / j;
            dt = z > 0 ? 1 / z : 0;
        }
        double p1 = t1 * (t->v0 + t1 * (t->a0 / 2 + j * t1 / 6)),
               turn = t->v0 - t1 * (alpha + x) / 2;
        double e = p1 + 0.5 * (vs + t->v1) * time - b * (vs - x * b / 6) - t->h;
        if (e > 0)
            lo = x;
        else
            hi = x;
        if (fabs(e) <= scale)
            break;
        double slope = (-turn - vs) / j - 1.5 * b * b + b * (time + (vs + t->v1) * dt);
        double next = x - e / slope;
        if (!(next > lo && next < hi))
            next = 0.5 * (lo + hi);
        if (fabs(next - x) <= 1e-12 * alpha)
            break;
        x = next;
    }
    double t1 = (alpha - x) / j, hold = 0;
    if (z > t->ad) {
        z = t->ad;
        hold = y / z - z / j;
    }
    double t2 = (z - x) / j, t4 = z / j;
    *optimum = t1 + t2 + hold + t4;
    double f1 = most(1, down(t1)), f2 = most(1, down(t2)), f3 = down(hold), f4 = most(1, down(t4));
    /* few roundings, shortest total first */
    static const signed char add[16][4] = {{0, 0, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0},
                                           {0, 0, 0, 1}, {1, 1, 0, 0}, {1, 0, 1, 0}, {1, 0, 0, 1},
                                           {0, 1, 1, 0}, {0, 1, 0, 1}, {0, 0, 1, 1}, {1, 1, 1, 0},
                                           {1, 1, 0, 1}, {1, 0, 1, 1}, {0, 1, 1, 1}, {1, 1, 1, 1}};
    for (int i = 0; i < 16; i++) {
        s->n1 = f1 + add[i][0];
        s->n2 = f2 + add[i][1];
        s->n3 = f3 + add[i][2];
        s->n4 = f4 + add[i][3];
        if (s->n1 + s->n2 + s->n3 + s->n4 < *optimum * (1 - SLACK))
            continue;
        if (four_fit(t, s))
            return 1;
    }
    return 0;
}

/* ---- the methods, best first ---- */

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
    task rest; /* what the seven phases do: t, or what the head leaves */
} attempt;

static double found_cycles(const attempt *a)
{
    if (a->found == SJ_PLAN_CRUISE)
        return (double)a->head.cycles + seven_cycles(&a->s);
    if (a->found == SJ_PLAN_EASE)
        return a->e.n1 + a->e.n2 + a->e.n3 + a->e.n4;
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
        return sj_by_cruise(u, &a->f, a->at_low, far, &a->s, &a->optimum) ? SJ_PLAN_CRUISE : 0;
    sj_end_acceleration(u, &a->head);
    family f = sj_family_of(u);
    int found = sj_by_cruise(u, &f, sj_family_distance(u, &f, f.low), far, &a->s, &a->optimum);
    a->optimum += (double)a->head.cycles;
    return found ? SJ_PLAN_CRUISE : 0;
}

/* Begins an attempt: the task is turned so that its push is up. Returns whether h lies beyond what the
   lowest peak covers. */
static int begin_attempt(const task *start, attempt *a)
{
    task *t = &a->t;
    *t = *start;
    if (t->a0 < 0 || (t->a0 == 0 && t->h < 0))
        *t = mirrored(t);
    a->f = sj_family_of(t);
    a->at_low = sj_family_distance(t, &a->f, a->f.low);
    double room = 1e-14 * (fabs(t->h) + fabs(a->at_low));
    a->direct = 0;
    if (t->h < a->at_low - room) {
        /* where the velocity turns against the push, easing a little first loses ground: see
           sj_move_direct() */
        a->direct = a->f.t0 + ramp_time(most(0, a->f.low - a->f.vs), t->au, t->ju) +
                    ramp_time(most(0, a->f.low - t->v1), t->ad, t->jd);
        a->short_of = a->at_low - t->h;
        *t = mirrored(t);
        a->f = sj_family_of(t);
        a->at_low = sj_family_distance(t, &a->f, a->f.low);
    }
    return t->h >= a->at_low - room;
}

task sj_pushed_up(const task *start)
{
    attempt a;
    begin_attempt(start, &a);
    return a.t;
}

static void best_of_phases(const task *start, attempt *a)
{
    int beyond = begin_attempt(start, a);
    sj_begin(&a->head);
    if (beyond || a->f.vz <= a->t.v1)
        a->found = cruise_after_zero(a, 0);
    else
        a->found = by_easing(&a->t, &a->f, &a->e, &a->optimum) ? SJ_PLAN_EASE : 0;
}

/* From a start that can keep the limits; 0 where none of these methods serves. In order: seven or four
   phases; a convex combination where these are more than two cycles (at rest three) longer than the optimum, or
   missing; a dip of the velocity. */
int sj_move_direct(const task *start, sj_plan *p)
{
    if (start->h == 0 && start->v0 == 0 && start->a0 == 0 && start->v1 == 0)
        return 1;
    attempt a;
    best_of_phases(start, &a);
    double n = most(1, up(a.optimum)), longest = INFINITY;
    summit both[2] = {{0, 0, 0}, {0, 0, 0}};
    if (a.t.a0 < 0 && a.t.v1 < 0 && a.direct > 0 && a.optimum > a.direct + 2 &&
        a.short_of <= -a.t.a0 / a.t.jd * most(a.t.v0, -a.t.v1)) {
        double m = most(1, up(a.direct));
        if (sj_convex_from(&a.t, &m, m + 3, both, p))
            return 1;
    }
    longest = found_cycles(&a);
    if (longest > n + (a.t.a0 == 0 ? 3 : 2)) {
        /* zero on a node, which the head is for, may cost a part of a cycle */
        if (a.head.cycles > 0 && n > 1)
            n -= 1;
        if (sj_convex_from(&a.t, &n, longest, both, p))
            return 1;
    }
    if (!a.found && a.t.v1 != 0) {
        /* no duration near the shortest works: lose time by a dip of the velocity */
        attempt d;
        summit turned[2] = {both[1], both[0]};
        d.t = mirrored(&a.t);
        d.f = sj_family_of(&d.t);
        d.at_low = sj_family_distance(&d.t, &d.f, d.f.low);
        d.found = cruise_after_zero(&d, 1);
        n = most(n, up(d.optimum));
        longest = found_cycles(&d);
        if (longest > n + 2 && sj_convex_from(&d.t, &n, longest, turned, p))
            return 1;
        if (d.found) {
            found_put(&d, p);
            return 1;
        }
    }
    if (!a.found)
        return 0;
    found_put(&a, p);
    return 1;
}
