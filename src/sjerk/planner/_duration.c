/* Plans of a given duration, and axes that arrive in the same cycle.

   A duration that is longer than the shortest leaves the cruise velocity v free: ramp, cruise, ramp at
   the one that fits,
       h = p1(v) + v (n - t1(v) - t2(v)) + p2(v),
   with t1, p1 and t2, p2 the time and distance of the two ramps (cruise_in_cycles); the convex
   combination of the extremes of that duration (_convex.c); or, where nothing else serves, a stop
   and a wait (_fallback.c). With a velocity at the target some durations do not exist: the status is
   SJ_PLAN_BLOCKED and the plan is that of the next one that does. Axes that wait for each other
   look again, SYNC_ROUNDS times at most.

   Never here: the shortest plan (_plan.c), memory, clocks, statics, cycle time. */
#include "base/_math.h" /* cube root */
#include "planner/_internal.h"

/* ---- one axis ---- */

/* Time and distance of the fastest ramp to velocity v, in continuous time. */
static void ramp_extent(const task *t, const family *u, const family *d, double v, double *time,
                        double *distance)
{
    if (v >= u->vz) {
        double x = ramp_time(most(0, v - u->vs), t->au, t->ju);
        *time = u->t0 + x;
        *distance = u->p0 + (v + u->vs) / 2 * x;
    } else {
        double x = ramp_time(most(0, -v - d->vs), t->ad, t->jd);
        *time = d->t0 + x;
        *distance = -d->p0 + (v - d->vs) / 2 * x;
    }
}

/* Exactly n cycles: ramp, cruise at the velocity that fits, ramp. */
static int cruise_in_cycles(const task *t, double n, seven *s)
{
    task o = mirrored(t);
    family u = sj_family_of(t), d = sj_family_of(&o);
    double lo = -t->vmax, hi = t->vmax, v = least(hi, most(lo, t->h / n)), t1 = 0, t2 = 0;
    /* only the counts come from v; it is solved for again */
    double scale = 1e-5 * fabs(t->h) + 1e-12 * t->vmax;
    double middle = 0.5 * (u.vz + t->v1);
    for (int i = 0; i < NEWTON_STEPS; i++) {
        double p1;
        ramp_extent(t, &u, &d, v, &t1, &p1);
        double x = fabs(v - t->v1);
        t2 = v >= t->v1 ? ramp_time(x, t->ad, t->jd) : ramp_time(x, t->au, t->ju);
        double t4 = n - t1 - t2, next, e = 0;
        if (t4 < 0) {
            if (v > middle)
                hi = v;
            else
                lo = v;
            next = 0.5 * (lo + hi);
        } else {
            e = p1 + v * t4 + (v + t->v1) / 2 * t2 - t->h;
            if (fabs(e) <= scale)
                break;
            if (e > 0)
                hi = v;
            else
                lo = v;
            next = v - e / (t4 + 0.4 * (t1 + t2));
            if (!(next > lo && next < hi))
                next = 0.5 * (lo + hi);
        }
        if (hi - lo <= 1e-9 * t->vmax)
            break;
        v = next;
    }
    double small = smaller_jerk(t);
    if (v >= u.vz) {
        double z = least(t->au, sqrt(most(0, v - u.vs) * t->ju));
        sj_ramp_counts(t->a0, v - t->v0, z, t->au, t->ju, t->a0 < 0 ? small : t->ju, &s->n1, &s->n2,
                       &s->n3);
    } else {
        double z = least(t->ad, sqrt(most(0, -v - d.vs) * t->jd));
        sj_ramp_counts(-t->a0, t->v0 - v, z, t->ad, t->jd, t->a0 > 0 ? small : t->jd, &s->n1,
                       &s->n2, &s->n3);
    }
    double a2 = v >= t->v1 ? t->ad : t->au, j2 = v >= t->v1 ? t->jd : t->ju, x = fabs(v - t->v1);
    sj_even_counts(x, least(a2, sqrt(x * j2)), a2, j2, &s->n5, &s->n6);
    s->n4 = 0;
    double rest = n - seven_cycles(s);
    for (int i = 0; i < DURATION_STEPS && rest >= 0; i++) {
        s->n4 = rest;
        if (sj_seven_fit(t, s))
            return 1;
        /* a little longer ramps have room for a higher cruise velocity */
        if (i & 1)
            s->n6 += 1;
        else
            s->n2 += 1;
        rest -= 1;
    }
    return 0;
}

static int in_cycles(const task *t, double n, sj_plan *p)
{
    seven s;
    if (n < 0)
        return 0;
    if (n == 0)
        return t->h == 0 && t->v0 == t->v1 && t->a0 == 0;
    if (cruise_in_cycles(t, n, &s)) {
        sj_seven_put(p, t, &s);
        p->kind = SJ_PLAN_CRUISE;
        return 1;
    }
    task pushed = sj_pushed_up(t);
    double nearest = -INFINITY;
    summit both[2] = {{0, 0, 0}, {0, 0, 0}};
    return sj_convex(&pushed, n, &nearest, both, p);
}

/* Exactly `cycles`, more than the shortest plan, which *p holds. */
static int32_t plan_longer(const task *origin, int64_t cycles, sj_plan *p)
{
    if ((double)cycles > LONGEST)
        return SJ_PLAN_TOO_LONG;
    task t = *origin;
    sj_plan q;
    sj_begin(&q);
    int lands = sj_recover_acceleration(&t, &q);
    if (is_above(&t)) {
        if (sj_move_from_above(&t, (double)(cycles - q.cycles), &q)) {
            *p = q;
            p->kind += SJ_PLAN_RECOVERY;
            return SJ_PLAN_OK;
        }
        lands = sj_settle(&t, &q);
    }
    int back = q.count > 0 ? SJ_PLAN_RECOVERY : 0;
    sj_plan head = q;
    if (in_cycles(&t, (double)(cycles - head.cycles), &q) &&
        (lands || !sj_leaves_velocity(&t, &q, head.cycles))) {
        *p = q;
        p->kind += back;
        return SJ_PLAN_OK;
    }
    if (!lands) {
        sj_cross_gently(&t, &head);
        q = head;
        if (in_cycles(&t, (double)(cycles - head.cycles), &q)) {
            *p = q;
            p->kind += back;
            return SJ_PLAN_OK;
        }
    }
    if (t.v1 == 0) {
        /* at rest the shortest plan may wait */
        sj_put_cruise(p, origin, (double)(cycles - p->cycles));
        return SJ_PLAN_OK;
    }
    *p = head;
    if (sj_by_stopping(&t, (double)cycles, p)) {
        p->kind += back;
        return SJ_PLAN_OK;
    }
    /* blocked: the next duration that works */
    for (int64_t n = cycles + 1; n <= cycles + DURATION_STEPS; n++) {
        *p = head;
        if (in_cycles(&t, (double)(n - head.cycles), p)) {
            p->kind += back;
            return SJ_PLAN_BLOCKED;
        }
    }
    *p = head;
    if (!sj_by_stopping(&t, INFINITY, p))
        return SJ_PLAN_TOO_LONG;
    p->kind += back;
    return SJ_PLAN_BLOCKED;
}

int32_t sj_plan_duration(double h, double v0, double a0, double v1, const sj_limits *l,
                         int64_t cycles, sj_plan *p)
{
    int32_t status = sj_plan_move(h, v0, a0, v1, l, p);
    if (status != SJ_PLAN_OK || p->cycles == cycles)
        return status;
    if (p->cycles > cycles)
        return SJ_PLAN_BLOCKED;
    task t = sj_task_of(h, v0, a0, v1, l);
    status = plan_longer(&t, cycles, p);
    sj_note_scale(p, l);
    return status;
}

/* ---- several axes ---- */

/* Where axes keep blocking each other: from its stop on an axis can take any duration. */
int64_t sj_stop_duration(int32_t n, const sj_request *r, const sj_limits *l, int64_t cycles)
{
    for (int32_t i = 0; i < n; i++) {
        task t = sj_task_of(r[i].distance, r[i].v0, r[i].a0, r[i].v1, &l[i]);
        sj_plan q;
        sj_begin(&q);
        if (!sj_recover(&t, &q))
            sj_cross_gently(&t, &q);
        if (t.v1 != 0 && sj_by_stopping(&t, INFINITY, &q) && q.cycles > cycles)
            cycles = q.cycles;
    }
    return cycles;
}

/* Time that is enough, at a glance: to a stand, from rest to rest and on to the end velocity, all of it
   under the smaller limits. From rest to rest over h, with q = A / J:
       h / V + T(V)           where the velocity limit is reached, T = ramp_time
       q + sqrt(q^2 + 4 h / A)    where the acceleration limit is,   else 4 (h / 2J)^(1/3).
   Infinite for a start that needs a recovery. */
static double sufficient_time(const task *t)
{
    double a = smaller_acceleration(t), j = smaller_jerk(t);
    double lead = fabs(t->a0) / j, v = t->v0 + t->a0 * lead / 2;
    if (!(fabs(t->a0) <= a && most(fabs(t->v0), fabs(v)) <= t->vmax))
        return INFINITY;
    double stop = ramp_time(fabs(v), a, j), go = ramp_time(fabs(t->v1), a, j);
    double h = fabs(t->h - lead * (t->v0 + t->a0 * lead / 3) - (v * stop + t->v1 * go) / 2);
    double top = ramp_time(t->vmax, a, j), before = lead + stop + go, q = a / j;
    if (t->vmax * top <= h)
        return before + h / t->vmax + top;
    if (2 * q * q * a <= h)
        return before + q + sqrt(q * q + 4 * h / a);
    return before + 4 * cube_root(h / (2 * j));
}

/* Exactly `cycles` from a start within its limits, in seven phases: what nearly every axis needs that
   waits for a slower one. Leaves *p as it is where that does not serve. */
static int seven_in_cycles(const task *t, int64_t cycles, sj_plan *p)
{
    task u = *t;
    sj_plan head;
    seven s;
    sj_begin(&head);
    if ((double)cycles > LONGEST || !sj_recover(&u, &head) || head.count > 0)
        return 0;
    if (!cruise_in_cycles(&u, (double)cycles, &s))
        return 0;
    sj_begin(p);
    sj_seven_put(p, &u, &s);
    p->kind = SJ_PLAN_CRUISE;
    return 1;
}

/* What the planner's shortest may be longer than the shortest in continuous time, where it is not far
   from it. */
enum { SPARE = 8 };

/* The axis that seems slowest is planned first. Of the others only those need a shortest plan that
   may not be done by then; *p of the rest is of zero cycles. Sets *cycles. */
static int32_t plan_slowest(int32_t n, const sj_request *r, const sj_limits *l, int64_t *cycles,
                            sj_plan *p)
{
    double time[SJ_AXES];
    int32_t first = 0;
    if (n > SJ_AXES)
        return SJ_PLAN_INVALID;
    for (int32_t i = 0; i < n; i++) {
        if (!sj_valid(r[i].distance, r[i].v0, r[i].a0, r[i].v1, &l[i]))
            return SJ_PLAN_INVALID;
        task t = sj_task_of(r[i].distance, r[i].v0, r[i].a0, r[i].v1, &l[i]);
        time[i] = sufficient_time(&t);
        if (time[i] > time[first])
            first = i;
    }
    for (int32_t k = 0; k < n; k++) {
        int32_t i = k == 0 ? first : k <= first ? k - 1 : k;
        sj_begin(&p[i]);
        if (time[i] + SPARE <= (double)*cycles)
            continue;
        int32_t status = sj_plan_move(r[i].distance, r[i].v0, r[i].a0, r[i].v1, &l[i], &p[i]);
        if (status != SJ_PLAN_OK)
            return status;
        if (p[i].cycles > *cycles)
            *cycles = p[i].cycles;
    }
    return SJ_PLAN_OK;
}

/* One axis in so many cycles. *p: its plan so far, or of zero cycles: none is known. */
static int32_t plan_in_cycles(const sj_request *r, const sj_limits *l, int64_t cycles, sj_plan *p)
{
    task t = sj_task_of(r->distance, r->v0, r->a0, r->v1, l);
    int32_t status = SJ_PLAN_OK;
    if (p->cycles > cycles || !seven_in_cycles(&t, cycles, p)) {
        if (p->cycles == 0 || p->cycles > cycles)
            return sj_plan_duration(r->distance, r->v0, r->a0, r->v1, l, cycles, p);
        status = plan_longer(&t, cycles, p);
    }
    sj_note_scale(p, l);
    return status;
}

int32_t sj_plan_together(int32_t n, const sj_request *r, const sj_limits *l, int64_t cycles,
                         sj_plan *p)
{
    int32_t status = plan_slowest(n, r, l, &cycles, p);
    if (status != SJ_PLAN_OK)
        return status;
    for (int round = 0; round < SYNC_ROUNDS; round++) {
        int blocked = 0;
        if (round == SYNC_ROUNDS - 2)
            cycles = sj_stop_duration(n, r, l, cycles);
        for (int32_t i = 0; i < n && !blocked; i++) {
            if (p[i].cycles == cycles)
                continue;
            status = plan_in_cycles(&r[i], &l[i], cycles, &p[i]);
            if (status != SJ_PLAN_OK && status != SJ_PLAN_BLOCKED)
                return status;
            if (status == SJ_PLAN_BLOCKED) {
                cycles = p[i].cycles;
                blocked = 1;
            }
        }
        if (!blocked)
            return SJ_PLAN_OK;
    }
    return SJ_PLAN_BLOCKED;
}
