/* Goals: the plans of one goal for all its axes, always from the commanded state.
 *
 * A goal is taken by all its axes or by none. An override lowers or raises the velocities of its plans,
 * so all limits hold throughout. Never here: which goals there are (_command.c, _queue.c), drives,
 * memory, time.
 */
#include <math.h> /* fabs, fmax, fmin, isfinite */
#include <stdint.h>
#include "cycle/_axis.h"
#include "cycle/_events.h"
#include "cycle/_goals.h"
#include "cycle/_group.h"
#include "cycle/_hold.h"
#include "cycle/_motion.h"
#include "cycle/_run_down.h"

static double clamp(double x, double most) { return fmax(-most, fmin(most, x)); }

/* A jog is a move to the position limit at the jog's velocity; without a limit, a velocity. */
static int32_t plan_jog(const sj_kernel *kernel, const sj_axis *ax, const sj_axis_goal *goal,
                        sj_plan *plan, sj_interpolator *trial)
{
    continuous at = axis_commanded(ax);
    sj_limits wanted = sj_axis_limits(ax, goal, kernel->override);
    sj_limits limits = sj_axis_kept(ax, &at, &wanted);
    double v = clamp(goal->goal_velocity * kernel->override, limits.velocity);
    double end = v > 0.0 ? ax->config.position_max : ax->config.position_min;
    int32_t status;

    if (v == 0.0 || !isfinite(end)) {
        status = sj_plan_velocity(at.V.hi, at.A.hi, v, &limits, plan);
        if (status != SJ_PLAN_OK || sj_interpolator_load(trial, plan, 0.0, v, 1) != SJ_LOAD_OK)
            return SJ_RESULT_PLAN;
        return SJ_RESULT_ACCEPTED;
    }
    if ((end - ax->interpolator.q.hi) * v <= 0.0)
        return SJ_RESULT_LIMIT;
    limits.velocity = fabs(v);
    status = sj_plan_move(lemma_distance(&at, end, 0.0), at.V.hi, at.A.hi, 0.0, &limits, plan);
    if (status != SJ_PLAN_OK || sj_interpolator_load(trial, plan, end, 0.0, 0) != SJ_LOAD_OK)
        return SJ_RESULT_PLAN;
    return SJ_RESULT_ACCEPTED;
}

int32_t sj_goal_plan(sj_kernel *kernel, sj_goal_set *set, int32_t line)
{
    int32_t together[SJ_AXES], of[SJ_AXES], m = 0;
    sj_request request[SJ_AXES];
    sj_limits limits[SJ_AXES];

    set->planned = set->synchronization;
    set->refused = -1;
    for (int32_t i = 0; i < set->n; i++) {
        const sj_axis *ax = &kernel->axis[set->axes[i]];
        continuous at = axis_commanded(ax);
        double v;
        if (set->goal[i].kind != SJ_GOAL_ABSOLUTE)
            continue;
        limits[m] = sj_axis_limits(ax, &set->goal[i], kernel->override);
        limits[m] = sj_axis_kept(ax, &at, &limits[m]);
        v = clamp(set->goal[i].goal_velocity, limits[m].velocity);
        request[m] = (sj_request){lemma_distance(&at, set->goal[i].goal, v), at.V.hi, at.A.hi, v};
        set->distance[i] = request[m].distance;
        together[m] = set->axes[i];
        of[m++] = i;
    }
    if (m > 0 && !(line && sj_group_line(kernel, together, m, limits, 0) == 0) &&
        sj_run_down(m, request, limits, set->least_cycles, &set->planned, kernel->plan) !=
            SJ_PLAN_OK)
        return SJ_RESULT_PLAN;
    for (int32_t k = 0; k < m; k++) {
        const sj_axis_goal *goal = &set->goal[of[k]];
        sj_interpolator *trial = &kernel->trial[of[k]];
        interpolator_copy(trial, &kernel->axis[together[k]].interpolator);
        if (!sj_axis_inside(&kernel->axis[together[k]], goal, &limits[k], &kernel->plan[k])) {
            set->refused = together[k];
            return SJ_RESULT_LIMIT;
        }
        if (sj_interpolator_load(trial, &kernel->plan[k], goal->goal + kernel->plan[k].slipped,
                                 request[k].v1, 0) != SJ_LOAD_OK)
            return SJ_RESULT_PLAN;
    }
    for (int32_t i = 0; i < set->n; i++) {
        const sj_axis *ax = &kernel->axis[set->axes[i]];
        int32_t result;
        if (set->goal[i].kind != SJ_GOAL_JOG)
            continue;
        interpolator_copy(&kernel->trial[i], &ax->interpolator);
        result = plan_jog(kernel, ax, &set->goal[i], &kernel->plan[0], &kernel->trial[i]);
        if (result != SJ_RESULT_ACCEPTED) {
            set->refused = set->axes[i];
            return result;
        }
    }
    return SJ_RESULT_ACCEPTED;
}

static void take_over(sj_kernel *kernel, const sj_goal_set *set)
{
    for (int32_t i = 0; i < set->n; i++) {
        sj_axis *ax = &kernel->axis[set->axes[i]];
        if (set->goal[i].kind == SJ_GOAL_HOME) {
            ax->homing = 1;
        } else {
            interpolator_copy(&ax->interpolator, &kernel->trial[i]);
            ax->line = set->planned == SJ_SYNC_PHASE && set->goal[i].kind == SJ_GOAL_ABSOLUTE
                           ? set->distance[i]
                           : 0.0;
        }
        ax->held = 0;
    }
}

int32_t sj_goal_begin(sj_kernel *kernel, sj_goal_set *set)
{
    int32_t result, wait = goal_held(kernel);
    uint64_t together = 0;

    set->refused = -1;
    for (int32_t i = 0; i < set->n; i++) {
        together |= axis_bit(set->axes[i]);
        sj_axis_ceiling(&kernel->axis[set->axes[i]]);
    }
    sj_hold_hand_over(kernel, together);
    if (!wait) {
        result = sj_goal_plan(kernel, set, 0);
        if (result != SJ_RESULT_ACCEPTED)
            return result;
        for (int32_t i = 0; i < set->n; i++)
            kernel->axis[set->axes[i]].start = kernel->axis[set->axes[i]].interpolator.q.hi;
        take_over(kernel, set);
    }
    sj_hold_release(kernel, together);
    for (int32_t i = 0; i < set->n; i++) {
        sj_axis *ax = &kernel->axis[set->axes[i]];
        sj_axis_feedback *out = &kernel->feedback.axis[set->axes[i]];
        ax->goal_id = set->id;
        ax->goal_axes = together;
        ax->goal = set->goal[i];
        ax->synchronization = set->synchronization;
        ax->least_cycles = set->least_cycles;
        ax->reached = ax->blends = 0;
        sj_events_trigger(kernel, set->axes[i], sj_axis_trigger_of(&set->goal[i]));
        if (wait) {
            ax->start = ax->interpolator.q.hi;
            ax->line = 0.0;
            ax->held = set->goal[i].kind != SJ_GOAL_HOME;
            ax->homing = set->goal[i].kind == SJ_GOAL_HOME;
        }
        out->peak_velocity = out->peak_acceleration = out->peak_jerk = 0.0;
    }
    return SJ_RESULT_ACCEPTED;
}

/* All axes of its goal are on it: reported once, by the last. */
static void report_reached(sj_kernel *kernel, const sj_axis *ax)
{
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *other = &kernel->axis[i];
        if ((ax->goal_axes >> i & 1) && (other->goal_id != ax->goal_id || !other->reached))
            return;
    }
    sj_events_reached(kernel, ax->goal_id);
}

void sj_goal_reached(sj_kernel *kernel, int32_t axis)
{
    sj_axis *ax = &kernel->axis[axis];
    if (ax->held || ax->goal.kind != SJ_GOAL_ABSOLUTE || ax->interpolator.cycles_left > 0)
        return;
    if (!ax->reached) {
        ax->reached = 1;
        report_reached(kernel, ax);
    }
    if (ax->interpolator.v.hi == 0.0 || ax->blends)
        return;
    ax->goal.kind = SJ_GOAL_JOG; /* with the velocity it arrived with */
    if (isfinite(ax->config.position_min) || isfinite(ax->config.position_max)) {
        interpolator_copy(&kernel->trial[0], &ax->interpolator);
        if (plan_jog(kernel, ax, &ax->goal, &kernel->plan[0], &kernel->trial[0]) ==
            SJ_RESULT_ACCEPTED)
            interpolator_copy(&ax->interpolator, &kernel->trial[0]);
    }
}

void sj_goal_homed(sj_kernel *kernel, int32_t axis)
{
    kernel->axis[axis].reached = 1;
    report_reached(kernel, &kernel->axis[axis]);
}

/* Two axes by turns, to a goal that needs all phases; into kernel->plan and trial, which nothing
 * reads between cycles. */
void sj_goal_rehearse(sj_kernel *kernel)
{
    const uint64_t axes = (uint64_t)kernel->axes;
    sj_goal_set set;
    set.synchronization = SJ_SYNC_TIME;
    set.least_cycles = 0;
    set.n = axes > 1 ? 2 : 1;
    for (int32_t i = 0; i < set.n; i++) {
        const int32_t axis = (int32_t)((kernel->feedback.cycle + (uint64_t)i) % axes);
        const sj_axis *ax = &kernel->axis[axis];
        const sj_limits *limits = &ax->config.limits;
        set.axes[i] = axis;
        set.goal[i] = (sj_axis_goal){.kind = SJ_GOAL_ABSOLUTE, .limits = *limits};
        set.goal[i].goal = ax->interpolator.q.hi +
                           4.0 * limits->velocity * limits->velocity / limits->acceleration;
    }
    sj_goal_plan(kernel, &set, 0);
}
