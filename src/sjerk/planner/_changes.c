/* Changes of velocity of several axes: each for itself, all done in the same cycle, or in the same
   phases, which keeps a straight line straight where its axes stop.

   In time, an axis that would be done before the slowest goes gently (_velocity.c); where that would cost
   its velocity limit it is done early and goes on at its new velocity: that always exists.

   Never here: a distance to be met (_duration.c), memory, clocks, statics, cycle time. */
#include "planner/_internal.h"
#include "base/_limits.h" /* one profile for all axes */

/* One change s from 0 to 1 for all: axis i has the velocity v0 + (v1 - v0) s. Only one of its two
   accelerations and jerks is used, that of its sense. Returns whether it could be done. */
static int in_phase(int32_t n, const sj_request *r, const sj_limits *limits, sj_plan *plans)
{
    sj_limits line = {INFINITY, INFINITY, INFINITY, INFINITY, INFINITY};
    sj_plan plan;
    for (int32_t i = 0; i < n; i++) {
        double change = r[i].v1 - r[i].v0;
        task t = sj_task_of(0, r[i].v0, r[i].a0, r[i].v1, &limits[i]);
        int along = change * t.sign > 0;
        sj_limits own = limits[i];
        own.acceleration = own.deceleration = along ? t.au : t.ad;
        own.jerk = own.deceleration_jerk = along ? t.ju : t.jd;
        if (r[i].a0 != 0 || fabs(r[i].v0) > own.velocity)
            return 0;
        own.velocity = INFINITY;
        if (change != 0)
            limits_narrow(&line, &own, change);
    }
    if (isinf(line.acceleration))
        return 0; /* nothing changes */
    line.velocity = 1;
    if (sj_plan_velocity(0, 0, 1, &line, &plan) != SJ_PLAN_OK)
        return 0;
    for (int32_t i = 0; i < n; i++) {
        plans[i] = plan;
        sj_note_scale(&plans[i], &limits[i]);
        for (int32_t k = 0; k < plan.count; k++)
            plans[i].phase[k].jerk *= r[i].v1 - r[i].v0;
    }
    return 1;
}

/* In so many cycles, more than *p takes. */
static void lengthen(const sj_request *r, const sj_limits *l, int64_t cycles, sj_plan *p)
{
    task t = sj_task_of(0, r->v0, r->a0, r->v1, l), u = t;
    sj_plan head;
    sj_begin(&head);
    if (sj_recover_acceleration(&u, &head) && head.count == 0 && !is_above(&t) &&
        sj_velocity_in(&t, (double)cycles, p)) {
        p->kind = SJ_PLAN_RAMP;
        sj_note_scale(p, l);
    } else
        sj_put_cruise(p, &t, (double)(cycles - p->cycles));
}

int32_t sj_plan_velocities(int32_t n, const sj_request *requests, const sj_limits *limits,
                           int32_t *synchronization, sj_plan *plans)
{
    int64_t longest = 0;
    for (int32_t i = 0; i < n; i++) {
        const sj_request *r = &requests[i];
        int32_t status = sj_plan_velocity(r->v0, r->a0, r->v1, &limits[i], &plans[i]);
        if (status != SJ_PLAN_OK)
            return status;
        longest = plans[i].cycles > longest ? plans[i].cycles : longest;
    }
    if (*synchronization == SJ_SYNC_PHASE) {
        if (in_phase(n, requests, limits, plans))
            return SJ_PLAN_OK;
        *synchronization = SJ_SYNC_TIME;
    }
    for (int32_t i = 0; i < n && *synchronization == SJ_SYNC_TIME; i++)
        if (plans[i].cycles < longest)
            lengthen(&requests[i], &limits[i], longest, &plans[i]);
    return SJ_PLAN_OK;
}
