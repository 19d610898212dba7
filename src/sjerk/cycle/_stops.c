/* Stops: what brings axes to rest, always from the commanded state.
 *
 * A halt slows all axes of a goal together; a quick stop brings each to rest as soon as its own stop
 * limits allow. What comes to rest by itself as soon as a stop would is left to do so. A stop moves
 * axes and drops nothing: what waits for them, their path and their hold are the caller's. Never
 * here: goals to come, drives, memory, time.
 */
#include <math.h> /* fabs */
#include <stdint.h>
#include "cycle/_axis.h"
#include "cycle/_events.h"
#include "cycle/_group.h"
#include "cycle/_motion.h"
#include "cycle/_stops.h"

static int32_t plan_stop(const sj_axis *ax, const sj_limits *limits, sj_plan *plan)
{
    continuous at = axis_commanded(ax);
    return sj_plan_velocity(at.V.hi, at.A.hi, 0.0, limits, plan);
}

/* Whether it comes to rest by itself within so many cycles. */
static int32_t at_rest_within(const sj_axis *ax, int64_t cycles)
{
    return ax->interpolator.goal_velocity == 0.0 && ax->interpolator.cycles_left <= cycles + 1;
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
static void lengthen(const sj_axis *ax, const sj_limits *own, int64_t cycles, sj_plan *plan)
{
    continuous at = axis_commanded(ax);
    double low, high, distance = sj_axis_distance(plan, at.V.hi, at.A.hi, &low, &high);
    sj_limits limits = sj_axis_kept(ax, &at, own);
    sj_plan longer;
    distance *= (double)cycles / (double)(plan->cycles > 0 ? plan->cycles : 1);
    if (!ax->interpolator.goal_free) {
        double left = lemma_distance(&at, ax->interpolator.goal, 0.0);
        if (left * distance > 0.0 && fabs(distance) > fabs(left))
            distance = left;
    }
    if (sj_plan_duration(distance, at.V.hi, at.A.hi, 0.0, &limits, cycles, &longer) == SJ_PLAN_OK)
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
        limits[i] = sj_axis_kept(ax, &at, limits_of(ax));
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
                lengthen(&kernel->axis[axes[i]], &limits[i], longest, &kernel->plan[i]);
    }
    for (int32_t i = 0; i < n; i++)
        rest &= at_rest_within(&kernel->axis[axes[i]], kernel->plan[i].cycles);
    for (int32_t i = 0; i < n && !rest; i++) /* else: left to rest by itself */
        load_stop(&kernel->axis[axes[i]], &kernel->plan[i]);
}

void sj_stop_alone(sj_axis *ax)
{
    sj_limits limits;
    sj_plan plan;
    continuous at = axis_commanded(ax);

    sj_axis_ceiling(ax);
    limits = sj_axis_kept(ax, &at, &ax->config.limits);
    if (plan_stop(ax, &limits, &plan) != SJ_PLAN_OK)
        ax->drive_stop = 1;
    else
        load_stop(ax, &plan);
}

void sj_stop_halt(sj_kernel *kernel, uint64_t set)
{
    for (int32_t i = 0; i < kernel->axes; i++) {
        int32_t axes[SJ_AXES], n;
        if ((set & axis_bit(i)) == 0 || !kernel->axis[i].following)
            continue;
        n = sj_group_of(kernel, i, &set, axes);
        for (int32_t k = 0; k < n; k++) {
            sj_axis_ceiling(&kernel->axis[axes[k]]);
            sj_events_trigger(kernel, axes[k], SJ_TRIGGER_HALT);
        }
        sj_stop_together(kernel, axes, n);
        for (int32_t k = 0; k < n; k++) {
            sj_axis *ax = &kernel->axis[axes[k]];
            if (!(ax->interpolator.cycles_left > 0 && !ax->interpolator.goal_free && !ax->held))
                if (!(ax->reached && !axis_moving(ax)))
                    axis_give_up(ax);
        }
    }
}

void sj_stop_quick(sj_kernel *kernel, uint64_t set, uint64_t together)
{
    uint64_t planned = 0;
    int64_t longest = 0;
    for (int32_t i = 0; i < kernel->axes; i++) {
        if ((set & axis_bit(i)) == 0 || !kernel->axis[i].following)
            continue;
        sj_axis_ceiling(&kernel->axis[i]);
        sj_events_trigger(kernel, i, SJ_TRIGGER_QUICK_STOP);
    }
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        continuous at;
        sj_limits limits;
        if ((set & axis_bit(i)) == 0 || !ax->following)
            continue;
        if (!axis_moving(ax)) {
            if (!ax->reached) /* held */
                axis_give_up(ax);
            continue;
        }
        at = axis_commanded(ax);
        limits = sj_axis_kept(ax, &at, &ax->config.stop_limits);
        if (plan_stop(ax, &limits, &kernel->plan[i]) != SJ_PLAN_OK) {
            ax->drive_stop = 1;
            continue;
        }
        planned |= axis_bit(i);
        if ((together & axis_bit(i)) && kernel->plan[i].cycles > longest)
            longest = kernel->plan[i].cycles;
    }
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        if ((planned & axis_bit(i)) == 0)
            continue;
        if ((together & axis_bit(i)) && kernel->plan[i].cycles < longest)
            lengthen(ax, &ax->config.stop_limits, longest, &kernel->plan[i]);
        if (!at_rest_within(ax, kernel->plan[i].cycles)) {
            load_stop(ax, &kernel->plan[i]);
            axis_give_up(ax);
        }
    }
}
