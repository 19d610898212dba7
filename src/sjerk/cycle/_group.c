/* The axes of one goal: who they are, and the one plan for all of a straight line.
 *
 * Never here: what a goal or a stop does with them, drives, memory, time.
 */
#include <math.h> /* fabs, fmin, INFINITY */
#include <stdint.h>
#include "cycle/_group.h"
#include "cycle/_motion.h"
#include "base/_limits.h" /* straight lines */

int32_t sj_group_of(const sj_kernel *kernel, int32_t axis, uint64_t *set, int32_t *axes)
{
    const sj_axis *ax = &kernel->axis[axis];
    int32_t n = 0;
    axes[n++] = axis;
    *set &= ~axis_bit(axis);
    if (ax->goal.kind != SJ_GOAL_ABSOLUTE || sj_sync_is_alone(ax->synchronization))
        return n;
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *other = &kernel->axis[i];
        if (i == axis || other->goal.kind != SJ_GOAL_ABSOLUTE || other->goal_id != ax->goal_id ||
            !other->following || other->reached)
            continue;
        axes[n++] = i;
        *set &= ~axis_bit(i);
    }
    return n;
}

static int32_t leader_of(const sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    int32_t leader = axes[0];
    for (int32_t i = 0; i < n; i++) {
        if (kernel->axis[axes[i]].line == 0.0)
            return -1;
        if (fabs(kernel->axis[axes[i]].line) > fabs(kernel->axis[leader].line))
            leader = axes[i];
    }
    return leader;
}

int32_t sj_group_line(sj_kernel *kernel, const int32_t *axes, int32_t n, const sj_limits *limits,
                      int32_t stop)
{
    int32_t leader = leader_of(kernel, axes, n), status;
    const sj_axis *ax = &kernel->axis[leader < 0 ? 0 : leader];
    continuous at = axis_commanded(ax);
    sj_limits own = {INFINITY, INFINITY, INFINITY, INFINITY, INFINITY};
    sj_plan plan;

    if (leader < 0)
        return -1;
    for (int32_t i = 0; i < n; i++)
        limits_narrow(&own, &limits[i], kernel->axis[axes[i]].line / ax->line);
    status = stop ? sj_plan_velocity(at.V.hi, at.A.hi, 0.0, &own, &plan)
                  : sj_plan_move(lemma_distance(&at, ax->goal.goal, 0.0), at.V.hi, at.A.hi, 0.0,
                                 &own, &plan);
    if (status != SJ_PLAN_OK)
        return -1;
    for (int32_t i = 0; i < n; i++) {
        double ratio = kernel->axis[axes[i]].line / ax->line;
        kernel->plan[i] = plan;
        kernel->plan[i].velocity *= fabs(ratio);
        kernel->plan[i].acceleration *= fabs(ratio);
        for (int32_t k = 0; k < plan.count; k++)
            kernel->plan[i].phase[k].jerk *= ratio;
    }
    return 0;
}
