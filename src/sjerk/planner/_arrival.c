/* Arrivals with an acceleration: from (0, v0, a0) to (h, v1, a1).

   Time runs backwards as well as forwards: seen from the target, velocities and jerks change their signs
   and accelerations keep theirs,
       x(n - k) = h - x'(k),   v = -v',   a = a',   j = -j'.
   So what leads from zero acceleration to (v1, a1) is what brings the start (-v1, a1) to zero acceleration
   (_recovery.c), played backwards: the tail, from velocity v_z, over the distance d. What comes before it is
   a plan to (h - d, v_z, 0), which always exists. It need not be the shortest, since the acceleration
   may not have to be zero on the way; so fewer cycles are looked for (_fewest.c).

   A target is legal if the tail keeps the limits: nothing else could lead there.

   Never here: how a plan without an acceleration at its end is made, memory, clocks, statics. */
#include "planner/_internal.h"

/* What remains before the tail, and the tail. */
typedef struct {
    task whole;   /* in the direction of the move; its h is the whole way */
    double a1;    /* in that direction too */
    double h, v1; /* where the tail begins, in axis coordinates */
    sj_limits limits;
    sj_plan tail;
} arrival;

/* The limits seen from a plan to h whose direction may not be that of the whole move. */
static sj_limits limits_along(const task *whole, double h, double v1, const sj_limits *l)
{
    task t = sj_task_of(h, whole->sign * whole->v0, whole->sign * whole->a0, v1, l);
    if (t.sign == whole->sign)
        return *l;
    return (sj_limits){l->velocity, l->deceleration, l->deceleration_jerk, l->acceleration,
                       l->jerk};
}

static int arrive(double h, double v0, double a0, double v1, double a1, const sj_limits *l,
                  arrival *x)
{
    if (!sj_valid(h, v0, a0, v1, l) || !isfinite(a1))
        return 0;
    x->whole = sj_task_of(h, v0, a0, v1, l);
    x->a1 = x->whole.sign * a1;
    task back = x->whole;
    back.h = 0;
    back.v0 = -x->whole.v1;
    back.a0 = back.first = x->a1;
    if (fabs(x->a1) > (x->a1 > 0 ? back.au : back.ad) * (1 + SLACK) || !sj_keeps(&back))
        return 0;
    sj_plan q;
    sj_begin(&q);
    if (!sj_lands(&back))
        sj_cross_gently(&back, &q);
    sj_end_acceleration(&back, &q);
    sj_begin(&x->tail);
    for (int i = q.count - 1; i >= 0; i--)
        sj_put(&x->tail, (double)q.phase[i].cycles, -q.phase[i].jerk);
    x->h = h - x->whole.sign * back.h;
    x->v1 = -x->whole.sign * back.v0;
    x->limits = limits_along(&x->whole, x->h, x->v1, l);
    /* rounding of a velocity at its limit */
    if (fabs(x->v1) > l->velocity)
        x->v1 = x->v1 < 0 ? -l->velocity : l->velocity;
    return fabs(back.v0) <= l->velocity * (1 + SLACK);
}

static void add_tail(const arrival *x, const sj_limits *l, sj_plan *p)
{
    sj_append(p, &x->tail);
    sj_note_scale(p, l);
}

/* In fewer cycles than *p takes, at least `least` of them, if that can be. */
static void shorten(const arrival *x, double least_cycles, const sj_limits *l, sj_plan *p)
{
    task t = x->whole;
    sj_plan q;
    sj_begin(&q);
    if (!sj_recover_acceleration(&t, &q) || is_above(&t) || q.count > 0)
        return;
    if (!sj_fewest(&t, x->a1, least_cycles, (double)(p->cycles - 1), &q))
        return;
    *p = q;
    sj_note_scale(p, l);
}

/* As soon as possible, with a cruise at the velocity limit where `exact`. */
static int32_t shortest(const sj_request *r, double a1, const sj_limits *l, int exact, sj_plan *p)
{
    arrival x;
    if (a1 == 0)
        return (exact ? sj_plan_exact_cruise : sj_plan_move)(r->distance, r->v0, r->a0, r->v1, l,
                                                             p);
    if (!arrive(r->distance, r->v0, r->a0, r->v1, a1, l, &x))
        return SJ_PLAN_INVALID;
    int32_t status =
        (exact ? sj_plan_exact_cruise : sj_plan_move)(x.h, r->v0, r->a0, x.v1, &x.limits, p);
    if (status != SJ_PLAN_OK)
        return status;
    if (p->count + x.tail.count > SJ_PHASES)
        return SJ_PLAN_TOO_LONG;
    add_tail(&x, l, p);
    if (!exact)
        shorten(&x, 1, l, p);
    return SJ_PLAN_OK;
}

/* In exactly so many cycles, more than the shortest takes; or blocked, and *p is longer. */
static int32_t longer(const sj_request *r, double a1, const sj_limits *l, int64_t cycles,
                      sj_plan *p)
{
    arrival x;
    if (a1 == 0)
        return sj_plan_duration(r->distance, r->v0, r->a0, r->v1, l, cycles, p);
    if (!arrive(r->distance, r->v0, r->a0, r->v1, a1, l, &x))
        return SJ_PLAN_INVALID;
    task t = x.whole;
    sj_plan q;
    sj_begin(&q);
    if (sj_recover_acceleration(&t, &q) && !is_above(&t) && q.count == 0 &&
        sj_fewest(&t, x.a1, (double)cycles, (double)cycles, &q)) {
        *p = q;
        sj_note_scale(p, l);
        return SJ_PLAN_OK;
    }
    int32_t status =
        sj_plan_duration(x.h, r->v0, r->a0, x.v1, &x.limits, cycles - x.tail.cycles, p);
    if (status != SJ_PLAN_OK && status != SJ_PLAN_BLOCKED)
        return status;
    if (p->count + x.tail.count > SJ_PHASES)
        return SJ_PLAN_TOO_LONG;
    add_tail(&x, l, p);
    return status;
}

int32_t sj_plan_arrival(double h, double v0, double a0, double v1, double a1, const sj_limits *l,
                        sj_plan *p)
{
    sj_request r = {h, v0, a0, v1};
    return shortest(&r, a1, l, 0, p);
}

/* Where axes keep blocking each other: from its stop on an axis can take any duration. */
static int64_t enough(const sj_request *r, double a1, const sj_limits *l, int64_t cycles)
{
    arrival x;
    if (a1 == 0)
        return sj_stop_duration(1, r, l, cycles);
    if (!arrive(r->distance, r->v0, r->a0, r->v1, a1, l, &x))
        return cycles;
    sj_request rest = {x.h, r->v0, r->a0, x.v1};
    return sj_stop_duration(1, &rest, &x.limits, cycles - x.tail.cycles) + x.tail.cycles;
}

int32_t sj_plan_arrivals(int32_t n, const sj_request *requests, const double *a1,
                         const sj_limits *limits, int64_t cycles, int32_t *synchronization,
                         sj_plan *plans)
{
    int exact = *synchronization & SJ_SYNC_EXACT;
    int together = n > 1 && (*synchronization & ~SJ_SYNC_EXACT) != SJ_SYNC_NONE;
    *synchronization = together ? SJ_SYNC_TIME : *synchronization & ~SJ_SYNC_EXACT;
    if (exact && together)
        return SJ_PLAN_NO_CRUISE;
    for (int32_t i = 0; i < n; i++) {
        int32_t status = shortest(&requests[i], a1[i], &limits[i], exact, &plans[i]);
        if (status != SJ_PLAN_OK)
            return status;
        if (together && plans[i].cycles > cycles)
            cycles = plans[i].cycles;
    }
    for (int round = 0; round < SYNC_ROUNDS; round++) {
        int blocked = 0;
        for (int32_t i = 0; i < n && round == SYNC_ROUNDS - 2 && together; i++)
            cycles = enough(&requests[i], a1[i], &limits[i], cycles);
        for (int32_t i = 0; i < n && !blocked; i++) {
            if (plans[i].cycles == cycles || (!together && plans[i].cycles > cycles))
                continue;
            int32_t status = longer(&requests[i], a1[i], &limits[i], cycles, &plans[i]);
            if (status != SJ_PLAN_OK && status != SJ_PLAN_BLOCKED)
                return status;
            if (together && status == SJ_PLAN_BLOCKED) {
                cycles = plans[i].cycles;
                blocked = 1;
            }
        }
        if (!blocked)
            return SJ_PLAN_OK;
    }
    return SJ_PLAN_BLOCKED;
}
