/* Run-up and run-down: the ramps of velocity by which a motion passes a goal faster than its own limit
 * allows. A run-up stands before the goal, a run-down behind it.
 *
 * All axes share one ramp s from 0 to 1: axis i has the velocity from_i + (to_i - from_i) s, so that a
 * straight line stays one. Its limits are the tightest of |to_i - from_i| s' and s'' against the axes'
 * acceleration and jerk. Never here: which motion passes which goal, the state of a kernel, time.
 */
#include <math.h> /* fabs, fmax, fmin, INFINITY */
#include <stdint.h>
#include "cycle/_axis.h"
#include "cycle/_run_down.h"

int32_t sj_run_forward(const sj_plan *plan, double v, double a, double distance, double of)
{
    double sign = distance < 0.0 ? -1.0 : 1.0, least = -1e-9 * of;
    int32_t forward = sign * v >= least;
    for (int32_t i = 0; i < plan->count; i++) {
        double n = (double)plan->phase[i].cycles, j = plan->phase[i].jerk, lowest;
        double end_v = v + n * (a + 0.5 * n * j), end_a = a + n * j;
        lowest = sign * end_v;
        if (a * sign < 0.0 && end_a * sign > 0.0)
            lowest = fmin(lowest, sign * (v - a * a / (2.0 * j)));
        if (forward && lowest < least)
            return 0;
        forward |= sign * end_v >= 0.0;
        v = end_v;
        a = end_a;
    }
    return 1;
}

int64_t sj_run_ramp(int32_t n, const sj_limits *limits, const double *from, const double *to,
                    sj_plan *ramp)
{
    sj_limits one = {1.0, INFINITY, INFINITY, INFINITY, INFINITY};
    int32_t any = 0;
    for (int32_t i = 0; i < n; i++) {
        double change = fabs(to[i] - from[i]);
        int32_t up = fabs(to[i]) > fabs(from[i]);
        if (change == 0.0)
            continue;
        one.acceleration =
            fmin(one.acceleration, (up ? limits[i].acceleration : limits[i].deceleration) / change);
        one.jerk = fmin(one.jerk, (up ? limits[i].jerk : limits[i].deceleration_jerk) / change);
        any = 1;
    }
    if (!any)
        return 0;
    one.deceleration = one.acceleration;
    one.deceleration_jerk = one.jerk;
    return sj_plan_velocity(0.0, 0.0, 1.0, &one, ramp) == SJ_PLAN_OK ? ramp->cycles : -1;
}

int32_t sj_run_join(sj_plan *plan, const sj_plan *ramp, double change, int32_t before)
{
    int32_t at = before ? 0 : plan->count;
    if (plan->count + ramp->count > SJ_PHASES)
        return 0;
    for (int32_t k = plan->count - 1; k >= at; k--)
        plan->phase[k + ramp->count] = plan->phase[k];
    for (int32_t k = 0; k < ramp->count; k++)
        plan->phase[at + k] = (sj_phase){ramp->phase[k].cycles, ramp->phase[k].jerk * change};
    plan->count += ramp->count;
    plan->cycles += ramp->cycles;
    return 1;
}

double sj_run_distance(const sj_plan *ramp, double from, double to)
{
    double low, high;
    return (double)ramp->cycles * from +
           (to - from) * sj_axis_distance(ramp, 0.0, 0.0, &low, &high);
}

int32_t sj_run_down(int32_t n, const sj_request *request, const sj_limits *limits,
                    int64_t least_cycles, int32_t *synchronization, sj_plan *plans)
{
    double from[SJ_AXES], to[SJ_AXES];
    sj_request rest[SJ_AXES];
    int32_t asked = *synchronization, steady = 1, done;
    int64_t down;
    sj_plan ramp;

    for (int32_t i = 0; i < n; i++) {
        steady &= request[i].a0 == 0.0;
        from[i] = request[i].v0;
        to[i] = fmax(-limits[i].velocity, fmin(limits[i].velocity, from[i]));
    }
    down = steady ? sj_run_ramp(n, limits, from, to, &ramp) : 0;
    if (down <= 0)
        return sj_plan_axes(n, request, limits, least_cycles, synchronization, plans);
    for (int32_t i = 0; i < n; i++)
        rest[i] = (sj_request){request[i].distance - sj_run_distance(&ramp, from[i], to[i]), to[i],
                               0.0, request[i].v1};
    done = sj_plan_axes(n, rest, limits, least_cycles - down, synchronization, plans) == SJ_PLAN_OK;
    for (int32_t i = 0; i < n && done; i++) {
        plans[i].velocity = fmax(plans[i].velocity, fabs(from[i]));
        done = sj_run_join(&plans[i], &ramp, to[i] - from[i], 1) &&
               sj_run_forward(&plans[i], from[i], 0.0, request[i].distance, limits[i].velocity);
    }
    if (done)
        return SJ_PLAN_OK;
    *synchronization = asked;
    return sj_plan_axes(n, request, limits, least_cycles, synchronization, plans);
}
