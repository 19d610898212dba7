/* Stops: what brings axes to rest, always from the commanded state.
 *
 * A halt slows all axes of a goal together; a quick stop brings each to rest as soon as its own stop
 * limits allow. What comes to rest by itself as soon as a stop would is left to do so. Never here:
 * goals to come, drives, memory, time.
 */
#include <math.h>   /* fabs */
#include <stdint.h>
#include "_cycle.h"
#include "base/_double_double.h" /* double-double sums */
#include "base/_continuous.h" /* from samples to the continuous motion and back */

static int32_t plan_stop(const sj_axis *ax, const sj_limits *limits, sj_plan *plan)
{
    continuous at = axis_commanded(ax);
    return sj_plan_velocity(at.V.hi, at.A.hi, 0.0, limits, plan);
}

/* Whether it comes to rest by itself within so many cycles. */
static int32_t rests_within(const sj_axis *ax, int64_t cycles)
{
    return ax->interpolator.goal_velocity == 0.0 && ax->interpolator.ahead <= cycles + 1;
}

static void load_stop(sj_axis *ax, const sj_plan *plan)
{
    if (sj_interpolator_load(&ax->interpolator, plan, 0.0, 0.0, 1) != SJ_LOAD_OK)
        ax->drive_stop = 1;
}

static const sj_limits *limits_of(const sj_axis *ax)
{
    return ax->goal.kind != SJ_GOAL_NONE ? &ax->goal.limits : &ax->config.limits;
}

/* The same stop in exactly so many cycles where that works, and not beyond the goal. */
static void stretch(const sj_axis *ax, const sj_limits *own, int64_t cycles, sj_plan *plan)
{
    continuous at = axis_commanded(ax);
    double low, high, way = sj_goal_way(plan, at.V.hi, at.A.hi, &low, &high);
    sj_limits limits = sj_goal_kept(ax, &at, own);
    sj_plan longer;
    way *= (double)cycles / (double)(plan->cycles > 0 ? plan->cycles : 1);
    if (!ax->interpolator.goal_free) {
        double left = lemma_distance(&at, ax->interpolator.goal, 0.0);
        if (left * way > 0.0 && fabs(way) > fabs(left))
            way = left;
    }
    if (sj_plan_duration(way, at.V.hi, at.A.hi, 0.0, &limits, cycles, &longer) == SJ_PLAN_OK)
        *plan = longer;
}

void sj_stop_together(sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    sj_limits limits[SJ_AXES];
    int64_t longest = 0;
    int32_t rest = 1;

    for (int32_t i = 0; i < n; i++) {
        const sj_axis *ax = &kernel->axis[axes[i]];
        continuous at = axis_commanded(ax);
        limits[i] = sj_goal_kept(ax, &at, limits_of(ax));
    }
    if (sj_group_line(kernel, axes, n, limits, 1) != 0) {
        for (int32_t i = 0; i < n; i++) {
            if (plan_stop(&kernel->axis[axes[i]], &limits[i], &kernel->plan[i]) != SJ_PLAN_OK) {
                kernel->axis[axes[i]].drive_stop = 1;
                return;
            }
            if (kernel->plan[i].cycles > longest)
                longest = kernel->plan[i].cycles;
        }
        for (int32_t i = 0; i < n; i++)
            if (kernel->plan[i].cycles < longest)
                stretch(&kernel->axis[axes[i]], &limits[i], longest, &kernel->plan[i]);
    }
    for (int32_t i = 0; i < n; i++)
        rest &= rests_within(&kernel->axis[axes[i]], kernel->plan[i].cycles);
    for (int32_t i = 0; i < n && !rest; i++) /* else: left to rest by itself */
        load_stop(&kernel->axis[axes[i]], &kernel->plan[i]);
}

void sj_stop_halt(sj_kernel *kernel, uint64_t set)
{
    set &= ~sj_path_halt(kernel, set);
    for (int32_t i = 0; i < kernel->axes; i++) {
        int32_t axes[SJ_AXES], n;
        if ((set >> i & 1) == 0 || !kernel->axis[i].following)
            continue;
        n = sj_group_of(kernel, i, &set, axes);
        for (int32_t k = 0; k < n; k++) {
            sj_paced_hand_over(kernel, UINT64_C(1) << axes[k]);
            sj_paced_release(kernel, UINT64_C(1) << axes[k]);
            sj_goal_ceiling(&kernel->axis[axes[k]]);
            sj_ahead_stop(kernel, UINT64_C(1) << axes[k]);
            sj_cycle_trigger(kernel, axes[k], SJ_TRIGGER_HALT);
        }
        sj_stop_together(kernel, axes, n);
        for (int32_t k = 0; k < n; k++) {
            sj_axis *ax = &kernel->axis[axes[k]];
            if (!(ax->interpolator.ahead > 0 && !ax->interpolator.goal_free && !ax->parked))
                if (!(ax->reached && !axis_moving(ax)))
                    axis_give_up(ax);
        }
    }
}

void sj_stop_quick(sj_kernel *kernel, uint64_t set, uint64_t together)
{
    uint64_t planned = 0;
    int64_t longest = 0;
    sj_path_leave(kernel, set);
    sj_paced_hand_over(kernel, set);
    sj_paced_release(kernel, set);
    for (int32_t i = 0; i < kernel->axes; i++) {
        if ((set >> i & 1) == 0 || !kernel->axis[i].following)
            continue;
        sj_goal_ceiling(&kernel->axis[i]);
        sj_ahead_stop(kernel, UINT64_C(1) << i); /* plans for itself: before all stops are planned */
        sj_cycle_trigger(kernel, i, SJ_TRIGGER_QUICK_STOP);
    }
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        continuous at;
        sj_limits limits;
        if ((set >> i & 1) == 0 || !ax->following)
            continue;
        if (!axis_moving(ax)) {
            if (!ax->reached) /* held on its way */
                axis_give_up(ax);
            continue;
        }
        at = axis_commanded(ax);
        limits = sj_goal_kept(ax, &at, &ax->config.stop_limits);
        if (plan_stop(ax, &limits, &kernel->plan[i]) != SJ_PLAN_OK) {
            ax->drive_stop = 1;
            continue;
        }
        planned |= UINT64_C(1) << i;
        if ((together >> i & 1) && kernel->plan[i].cycles > longest)
            longest = kernel->plan[i].cycles;
    }
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        if ((planned >> i & 1) == 0)
            continue;
        if ((together >> i & 1) && kernel->plan[i].cycles < longest)
            stretch(ax, &ax->config.stop_limits, longest, &kernel->plan[i]);
        if (!rests_within(ax, kernel->plan[i].cycles)) {
            load_stop(ax, &kernel->plan[i]);
            axis_give_up(ax);
        }
    }
}
