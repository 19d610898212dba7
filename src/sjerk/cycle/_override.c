/* Override and hold: the goals in execution are planned anew under other velocities, or held.
 *
 * A synchronised move is held on the path that was planned, all others by stops of their own; released,
 * each is planned anew from where it is. Never here: goals to come, how a move is held (_hold.c).
 */
#include <stdint.h>
#include "cycle/_axis.h"
#include "cycle/_goals.h"
#include "cycle/_group.h"
#include "cycle/_hold.h"
#include "cycle/_motion.h"
#include "cycle/_override.h"
#include "cycle/_queue.h"
#include "cycle/_stops.h"

static void hold_on_path(sj_kernel *kernel, uint64_t set, double planned)
{
    int32_t axes[SJ_AXES], n;
    if (set == 0 || sj_hold_begin(kernel, set, planned))
        return;
    for (int32_t i = 0; i < kernel->axes; i++)
        if (set & axis_bit(i)) {
            n = sj_group_of(kernel, i, &set, axes);
            sj_hold_by_stop(kernel, axes, n);
        }
}

/* The goals in execution that an override changes. */
static uint64_t in_execution(sj_kernel *kernel)
{
    uint64_t set = 0;
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        sj_axis_ceiling(ax);
        if (ax->following &&
            (ax->goal.kind == SJ_GOAL_JOG || (ax->goal.kind == SJ_GOAL_ABSOLUTE && !ax->reached)))
            set |= axis_bit(i);
    }
    return set;
}

/* The goals of these axes anew; they come to rest and forget them where that cannot be. */
static void plan_anew(sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    int32_t rest = 1;
    sj_goal_set set;
    set.synchronization = kernel->axis[axes[0]].synchronization;
    set.least_cycles = 0;
    set.n = n;
    for (int32_t k = 0; k < n; k++) {
        set.axes[k] = axes[k];
        set.goal[k] = kernel->axis[axes[k]].goal;
        rest &= !axis_moving(&kernel->axis[axes[k]]);
    }
    if (sj_goal_plan(kernel, &set, !rest) != SJ_RESULT_ACCEPTED) {
        sj_stop_together(kernel, axes, n);
        for (int32_t k = 0; k < n; k++)
            axis_give_up(&kernel->axis[axes[k]]);
        return;
    }
    for (int32_t k = 0; k < n; k++) {
        sj_axis *ax = &kernel->axis[axes[k]];
        interpolator_copy(&ax->interpolator, &kernel->trial[k]);
        ax->held = 0;
        if (rest)
            ax->line = set.planned == SJ_SYNC_PHASE ? set.distance[k] : 0.0;
    }
}

/* planned: the override under which the goals were planned; 0: a hold is by stops only. */
static void replan(sj_kernel *kernel, double planned)
{
    uint64_t set, waits = 0;
    if (!goal_held(kernel) && kernel->override != kernel->feed_hold.override) {
        sj_hold_hand_over(kernel, kernel->feed_hold.axes);
        sj_hold_release(kernel, kernel->feed_hold.axes);
    }
    set = in_execution(kernel) & ~kernel->feed_hold.axes;
    for (int32_t i = 0; i < kernel->axes; i++) {
        int32_t axes[SJ_AXES], n;
        if ((set & axis_bit(i)) == 0)
            continue;
        n = sj_group_of(kernel, i, &set, axes);
        if (!sj_queue_release(kernel, axes, n))
            continue; /* too late to do anything before the goal; the next move does it */
        if (!goal_held(kernel))
            plan_anew(kernel, axes, n);
        else if (planned > 0.0 && sj_hold_possible(kernel, axes, n))
            for (int32_t k = 0; k < n; k++)
                waits |= axis_bit(axes[k]);
        else
            sj_hold_by_stop(kernel, axes, n);
    }
    hold_on_path(kernel, waits, planned);
}

void sj_override_hold(sj_kernel *kernel)
{
    if (goal_held(kernel))
        replan(kernel, 0.0);
}

void sj_override_set(sj_kernel *kernel, double override, int32_t hold)
{
    double planned = kernel->override;
    if (!(override >= 0.0 && override <= 2.0))
        override = planned;
    if (override == planned && hold == kernel->hold)
        return;
    kernel->override = override;
    kernel->hold = hold;
    replan(kernel, planned);
}
