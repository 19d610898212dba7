/* Planning requests as callers have them: between samples, for several axes, for many.
 *
 * The half-cycle lemma turns samples into the plan's states; _plan.c and _duration.c plan. Here is how axes share
 * a motion: each for itself, all in the same cycle, or all in the same phases. Pure, no allocation.
 */
#include <math.h> /* INFINITY, isinf */
#include <stddef.h>
#include <stdint.h>
#include "planner/_planner.h"
#include "planner/_samples.h" /* a request between samples */
#include "base/_limits.h"     /* one profile for all axes */
#include "base/_continuous.h" /* from samples to the continuous motion, exactly */

/* Rest to rest on a straight line: one profile of the line from 0 to 1 under the limits that the
 * tightest axis leaves, scaled to each axis. 1 if it could be done. */
static int32_t in_phase(int32_t n, const sj_request *request, const sj_limits *limits,
                        int64_t least_cycles, int32_t exact, sj_plan *plans, int32_t *status)
{
    sj_limits line = {INFINITY, INFINITY, INFINITY, INFINITY, INFINITY};
    sj_plan plan;
    for (int32_t i = 0; i < n; i++) {
        if (request[i].v0 != 0.0 || request[i].a0 != 0.0 || request[i].v1 != 0.0)
            return 0;
        if (request[i].distance != 0.0)
            limits_narrow(&line, &limits[i], request[i].distance);
    }
    if (isinf(line.velocity))
        return 0; /* nothing moves */
    *status = (exact ? sj_plan_exact_cruise : sj_plan_move)(1.0, 0.0, 0.0, 0.0, &line, &plan);
    if (*status == SJ_PLAN_OK && plan.cycles < least_cycles)
        *status = sj_plan_duration(1.0, 0.0, 0.0, 0.0, &line, least_cycles, &plan);
    for (int32_t i = 0; i < n && *status == SJ_PLAN_OK; i++) {
        plans[i] = plan;
        for (int32_t k = 0; k < plan.count; k++)
            plans[i].phase[k].jerk *= request[i].distance;
    }
    return 1;
}

static int32_t plan_each(int32_t n, const sj_request *request, const sj_limits *limits,
                         int64_t least_cycles, int32_t exact, int32_t moving, sj_plan *plans)
{
    for (int32_t i = 0; i < n; i++) {
        const sj_request *r = &request[i];
        int32_t status =
            (exact    ? sj_plan_exact_cruise
             : moving ? sj_plan_meeting
                      : sj_plan_move)(r->distance, r->v0, r->a0, r->v1, &limits[i], &plans[i]);
        if (status == SJ_PLAN_OK && plans[i].cycles < least_cycles) {
            status = sj_plan_duration(r->distance, r->v0, r->a0, r->v1, &limits[i], least_cycles,
                                      &plans[i]);
            if (status == SJ_PLAN_BLOCKED) /* holds the next duration that works */
                status = SJ_PLAN_OK;
        }
        if (status != SJ_PLAN_OK)
            return status;
    }
    return SJ_PLAN_OK;
}

/* Returns SJ_PLAN_...; *synchronization becomes what was done: phase falls back to time. */
int32_t sj_plan_axes(int32_t n, const sj_request *request, const sj_limits *limits,
                     int64_t least_cycles, int32_t *synchronization, sj_plan *plans)
{
    int32_t status, exact = *synchronization & SJ_SYNC_EXACT;
    *synchronization &= ~SJ_SYNC_EXACT;
    if (*synchronization == SJ_SYNC_PHASE) {
        if (in_phase(n, request, limits, least_cycles, exact, plans, &status))
            return status;
        *synchronization = SJ_SYNC_TIME;
    }
    if (sj_sync_is_alone(*synchronization) || n == 1) {
        int32_t moving = *synchronization == SJ_SYNC_MOVING;
        if (moving)
            *synchronization = SJ_SYNC_NONE;
        return plan_each(n, request, limits, least_cycles, exact, moving, plans);
    }
    if (exact)
        return SJ_PLAN_NO_CRUISE;
    return sj_plan_together(n, request, limits, least_cycles, plans);
}

int32_t sj_plan_samples(int32_t n, double cycle_time_s, const void *states, const void *limits,
                        const void *unit, int64_t least_cycles, int32_t *synchronization,
                        sj_plan *plans)
{
    const sj_state *start = states, *end = start + n;
    const sj_limits *limit = limits, *one = unit;
    sj_request request[SJ_AXES];
    sj_limits per_cycle[SJ_AXES];
    double a1[SJ_AXES];
    int32_t accelerated = 0;
    if (n < 1 || n > SJ_AXES)
        return SJ_PLAN_INVALID;
    for (int32_t i = 0; i < n; i++) {
        a1[i] = end[i].acceleration * cycle_time_s * cycle_time_s;
        accelerated |= a1[i] != 0.0;
        request[i] = request_between(cycle_time_s, &start[i], &end[i]);
        per_cycle[i] = (sj_limits){
            limit[i].velocity * one->velocity, limit[i].acceleration * one->acceleration,
            limit[i].jerk * one->jerk, limit[i].deceleration * one->deceleration,
            limit[i].deceleration_jerk * one->deceleration_jerk};
    }
    if (accelerated)
        return sj_plan_arrivals(n, request, a1, per_cycle, least_cycles, synchronization, plans);
    return sj_plan_axes(n, request, per_cycle, least_cycles, synchronization, plans);
}

/* One axis. */
int32_t sj_plan_sample(double cycle_time_s, const void *from, const void *to, const void *limits,
                       sj_plan *plan)
{
    const sj_state *end = to;
    sj_request r = request_between(cycle_time_s, from, end);
    if (end->acceleration != 0.0)
        return sj_plan_arrival(r.distance, r.v0, r.a0, r.v1,
                               end->acceleration * cycle_time_s * cycle_time_s, limits, plan);
    return sj_plan_move(r.distance, r.v0, r.a0, r.v1, limits, plan);
}

sj_plan sj_plan_between(const void *between)
{
    const sj_between *asked = between;
    sj_plan plan;
    if (sj_plan_sample(asked->cycle_time_s, &asked->from, &asked->to, &asked->limits, &plan) !=
        SJ_PLAN_OK)
        plan.count = -1;
    return plan;
}

/* Where the settled sample is after a change to v1 from `at`: Eqs. (2), (3), (5) along the phases. */
static double end_of(continuous at, double v1, const sj_plan *plan)
{
    for (int32_t i = 0; i < plan->count; i++) {
        double n = (double)plan->phase[i].cycles;
        sj_exact j = exact_of(plan->phase[i].jerk), n2 = exact_two_product(n, n);
        at.P = exact_add(at.P, exact_scale(at.V, n));
        at.P = exact_add(at.P, exact_half(exact_multiply(at.A, n2)));
        at.P = exact_add(at.P, exact_divide(exact_multiply(exact_scale(j, n), n2), 6.0));
        at.V = exact_add(at.V, exact_add(exact_scale(at.A, n), exact_half(exact_multiply(j, n2))));
        at.A = exact_add(at.A, exact_scale(j, n));
    }
    return exact_add(at.P, exact_of(0.5 * v1)).hi;
}

int32_t sj_plan_sample_velocities(int32_t n, double cycle_time_s, const void *from,
                                  const double *v1, const void *limits, int32_t *synchronization,
                                  sj_plan *plans, double *ends)
{
    const double T = cycle_time_s;
    const sj_state *start = from;
    sj_request request[SJ_AXES];
    continuous at[SJ_AXES];
    if (n < 1 || n > SJ_AXES)
        return SJ_PLAN_INVALID;
    for (int32_t i = 0; i < n; i++) {
        at[i] = lemma(exact_of(start[i].position), exact_of(start[i].velocity * T),
                      exact_of(start[i].acceleration * T * T), exact_of(0.0));
        request[i] = (sj_request){0.0, at[i].V.hi, at[i].A.hi, v1[i] * T};
    }
    int32_t status = sj_plan_velocities(n, request, limits, synchronization, plans);
    for (int32_t i = 0; i < n && status == SJ_PLAN_OK; i++)
        ends[i] = end_of(at[i], request[i].v1, &plans[i]);
    return status;
}
