/* Goals: what is planned for them when, always from the commanded state.
 *
 * A goal is taken by all its axes or by none. Override and hold plan the goals anew under other
 * velocities, so all limits hold throughout. Never here: drives, memory, time.
 */
#include <math.h>   /* fabs, floor, isfinite, sqrt */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcmp of limits */
#include "_cycle.h"
#include "base/_double_double.h" /* double-double sums */
#include "base/_continuous.h" /* from samples to the continuous motion and back */

static void widen(double way, double *low, double *high)
{
    *low = fmin(*low, way);
    *high = fmax(*high, way);
}

double sj_goal_way(const sj_plan *plan, double v, double a, double *low, double *high)
{
    double way = 0.0;
    *low = *high = 0.0;
    for (int32_t i = 0; i < plan->count; i++) {
        double n = (double)plan->phase[i].cycles, j = plan->phase[i].jerk;
        double root = a * a - 2.0 * j * v, turn[2];
        if (root >= 0.0) { /* v + a t + j t^2/2 = 0, both ways of writing its roots */
            double q = -(a + copysign(sqrt(root), a));
            turn[0] = j != 0.0 ? q / j : -1.0;
            turn[1] = q != 0.0 ? 2.0 * v / q : -1.0;
            for (int k = 0; k < 2; k++)
                if (turn[k] > 0.0 && turn[k] < n)
                    widen(way + turn[k] * (v + turn[k] * (a / 2.0 + turn[k] * j / 6.0)), low, high);
        }
        way += n * (v + n * (a / 2.0 + n * j / 6.0));
        v += n * (a + n * j / 2.0);
        a += n * j;
        widen(way, low, high);
    }
    return way;
}

/* ---- limits that are lowered on the way ---- */

static void raise(double *limit, double least)
{
    *limit = fmax(*limit, least);
}

static void raise_all(sj_limits *limits, const sj_limits *least)
{
    raise(&limits->velocity, least->velocity);
    raise(&limits->acceleration, least->acceleration);
    raise(&limits->jerk, least->jerk);
    raise(&limits->deceleration, least->deceleration);
    raise(&limits->deceleration_jerk, least->deceleration_jerk);
}

/* At rest the limits of the axis; else the largest since then, of the axis and of its goals: a motion
 * keeps its own though those of the axis have been lowered meanwhile. */
void sj_goal_ceiling(sj_axis *ax)
{
    if (!axis_moving(ax))
        ax->ceiling = ax->config.limits;
    else
        raise_all(&ax->ceiling, &ax->config.limits);
    if (axis_moving(ax) && ax->goal.kind != SJ_GOAL_NONE)
        raise_all(&ax->ceiling, &ax->goal.limits);
}

/* Whichever way the next plan leads: its two jerks and accelerations change places with it. */
static int32_t keeps(const continuous *at, const sj_limits *limits, double velocity)
{
    const sj_limits *l = limits;
    sj_limits one = {velocity, l->acceleration, l->jerk, l->deceleration, l->deceleration_jerk};
    sj_limits other = {velocity, l->deceleration, l->deceleration_jerk, l->acceleration, l->jerk};
    return sj_plan_keeps(at->V.hi, at->A.hi, &one) && sj_plan_keeps(at->V.hi, at->A.hi, &other);
}

static void raise_jerk(sj_limits *limits, double least)
{
    raise(&limits->jerk, least);
    raise(&limits->deceleration_jerk, least);
}

/* Limits lower than those of the motion so far may not keep its velocity any more: what is left of an
 * acceleration a adds a^2 / 2j. Then they are raised to the jerk that adds no more than there is room
 * for, in whole cycles by one that crosses zero (planner.md, section 4); where that does not serve
 * either, to the limits under which the motion came here. */
sj_limits sj_goal_kept(const sj_axis *ax, const continuous *at, const sj_limits *asked)
{
    const sj_limits *own = &ax->ceiling;
    double a = at->A.hi, room = fmax(0.0, own->velocity - copysign(1.0, a) * at->V.hi);
    double most = fmax(own->jerk, own->deceleration_jerk);
    sj_limits limits = *asked;
    if (a == 0.0 || keeps(at, asked, own->velocity))
        return limits;
    raise_jerk(&limits, fmin(a * a / (2.0 * room), most));
    if (!keeps(at, &limits, own->velocity)) {
        raise_jerk(&limits, most);
        raise(&limits.acceleration, own->acceleration);
        raise(&limits.deceleration, own->deceleration);
    }
    return limits;
}

/* ---- goals ---- */

static int32_t trigger_of(const sj_axis_goal *goal)
{
    if (goal->kind == SJ_GOAL_HOME)
        return SJ_TRIGGER_HOME;
    return goal->kind == SJ_GOAL_JOG || goal->goal_velocity != 0.0 ? SJ_TRIGGER_JOG
                                                                   : SJ_TRIGGER_MOVE;
}

/* No limit of a goal may exceed the axis's own, which its drive was checked against. */
static int32_t within(const sj_limits *asked, const sj_limits *own)
{
    const double slack = 1.0 + 1e-12; /* for conversions to cycle units and back */
    return asked->velocity <= own->velocity * slack &&
           asked->acceleration <= own->acceleration * slack &&
           asked->jerk <= own->jerk * slack &&
           asked->deceleration <= own->deceleration * slack &&
           asked->deceleration_jerk <= own->deceleration_jerk * slack;
}

int32_t sj_goal_possible(const sj_axis *ax, const sj_axis_goal *goal)
{
    const sj_axis_config *config = &ax->config;
    if (!within(&goal->limits, &config->limits))
        return SJ_RESULT_LIMITS;
    /* beyond 2^52 increments a double no longer tells two of them apart */
    if (!(fabs(goal->goal * config->counts_per_unit) < 4503599627370496.0))
        return SJ_RESULT_RANGE;
    if (!(fabs(goal->goal_velocity) <= goal->limits.velocity))
        return SJ_RESULT_PLAN;
    if (goal->kind == SJ_GOAL_ABSOLUTE &&
        (goal->goal < config->position_min || goal->goal > config->position_max))
        return SJ_RESULT_LIMIT;
    return SJ_RESULT_ACCEPTED;
}

int32_t sj_goal_judge(const sj_axis *ax, const sj_axis_goal *goal)
{
    if (goal->kind < SJ_GOAL_ABSOLUTE || goal->kind > SJ_GOAL_HOME)
        return SJ_RESULT_RANGE;
    if (sj_axis_next(ax->state, trigger_of(goal)) < 0)
        return ax->following || ax->error || ax->homing ? SJ_RESULT_STATE : SJ_RESULT_NOT_FOLLOWING;
    if (!ax->following || !ax->enable)
        return SJ_RESULT_NOT_FOLLOWING;
    return goal->kind == SJ_GOAL_HOME ? SJ_RESULT_ACCEPTED : sj_goal_possible(ax, goal);
}

static int32_t same_goal(const sj_axis_goal *x, const sj_axis_goal *y)
{
    return x->kind == y->kind && x->goal == y->goal && x->goal_velocity == y->goal_velocity &&
           memcmp(&x->limits, &y->limits, sizeof x->limits) == 0;
}

sj_limits sj_goal_limits(const sj_kernel *kernel, const sj_axis *ax, const sj_axis_goal *goal)
{
    sj_limits limits = goal->limits;
    double most = fmax(limits.velocity, ax->config.limits.velocity);
    limits.velocity = fmin(limits.velocity * kernel->override, most);
    return limits;
}

static double clamp(double x, double most)
{
    return fmax(-most, fmin(most, x));
}

/* A jog is a move to the position limit at the jog's velocity; without a limit, a velocity. */
static int32_t plan_jog(const sj_kernel *kernel, const sj_axis *ax, const sj_axis_goal *goal,
                        sj_plan *plan, sj_interpolator *trial)
{
    continuous at = axis_commanded(ax);
    sj_limits wanted = sj_goal_limits(kernel, ax, goal), limits = sj_goal_kept(ax, &at, &wanted);
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

int32_t sj_goal_inside(const sj_axis *ax, const sj_axis_goal *goal, const sj_limits *limits,
                            const sj_plan *plan)
{
    const sj_axis_config *config = &ax->config;
    double low, high, beyond = 0.0, rest_low, rest_high, slack;
    continuous at;
    sj_plan rest;

    if (!isfinite(config->position_min) && !isfinite(config->position_max))
        return 1;
    at = axis_commanded(ax);
    slack = 1e-9 * (fabs(at.P.hi) + fabs(goal->goal));
    sj_goal_way(plan, at.V.hi, at.A.hi, &low, &high);
    if (goal->goal_velocity != 0.0) { /* and after the goal there is room to come to rest */
        if (sj_plan_velocity(goal->goal_velocity, 0.0, 0.0, limits, &rest) != SJ_PLAN_OK)
            return 0;
        beyond = goal->goal + sj_goal_way(&rest, goal->goal_velocity, 0.0, &rest_low, &rest_high);
        if (beyond < config->position_min - slack || beyond > config->position_max + slack)
            return 0;
    }
    return at.P.hi + low >= fmin(config->position_min, at.P.hi) - slack &&
           at.P.hi + high <= fmax(config->position_max, at.P.hi) + slack;
}

/* Plans for these goals into kernel->plan and trial, nothing else. line: the axes are on their way
 * along a straight line to the same goals. */
static int32_t plan_goals(sj_kernel *kernel, const int32_t *axes, const sj_axis_goal *goals,
                          int32_t n, int32_t *synchronization, int64_t least_cycles, int32_t line,
                          int32_t *refused, double *ways)
{
    int32_t together[SJ_AXES], of[SJ_AXES], m = 0;
    sj_request request[SJ_AXES];
    sj_limits limits[SJ_AXES];

    for (int32_t i = 0; i < n; i++) {
        const sj_axis *ax = &kernel->axis[axes[i]];
        continuous at = axis_commanded(ax);
        double v;
        if (goals[i].kind != SJ_GOAL_ABSOLUTE)
            continue;
        limits[m] = sj_goal_limits(kernel, ax, &goals[i]);
        limits[m] = sj_goal_kept(ax, &at, &limits[m]);
        v = clamp(goals[i].goal_velocity, limits[m].velocity);
        request[m] = (sj_request){lemma_distance(&at, goals[i].goal, v), at.V.hi, at.A.hi, v};
        ways[i] = request[m].distance;
        together[m] = axes[i];
        of[m++] = i;
    }
    if (m > 0 && !(line && sj_group_line(kernel, together, m, limits, 0) == 0) &&
        sj_passage_plan(m, request, limits, least_cycles, synchronization, kernel->plan) !=
            SJ_PLAN_OK)
        return SJ_RESULT_PLAN;
    for (int32_t k = 0; k < m; k++) {
        const sj_axis_goal *goal = &goals[of[k]];
        sj_interpolator *trial = &kernel->trial[of[k]];
        interpolator_copy(trial, &kernel->axis[together[k]].interpolator);
        *refused = together[k];
        if (!sj_goal_inside(&kernel->axis[together[k]], goal, &limits[k], &kernel->plan[k]))
            return SJ_RESULT_LIMIT;
        *refused = -1;
        if (sj_interpolator_load(trial, &kernel->plan[k], goal->goal, request[k].v1, 0) !=
            SJ_LOAD_OK)
            return SJ_RESULT_PLAN;
    }
    for (int32_t i = 0; i < n; i++) {
        const sj_axis *ax = &kernel->axis[axes[i]];
        int32_t result;
        if (goals[i].kind != SJ_GOAL_JOG)
            continue;
        interpolator_copy(&kernel->trial[i], &ax->interpolator);
        result = plan_jog(kernel, ax, &goals[i], &kernel->plan[0], &kernel->trial[i]);
        if (result != SJ_RESULT_ACCEPTED) {
            *refused = axes[i];
            return result;
        }
    }
    return SJ_RESULT_ACCEPTED;
}

static void take_over(sj_kernel *kernel, const goal_set *set, int32_t synchronization,
                      const double *ways)
{
    for (int32_t i = 0; i < set->n; i++) {
        sj_axis *ax = &kernel->axis[set->axes[i]];
        if (set->goal[i].kind == SJ_GOAL_HOME) {
            ax->homing = 1;
        } else {
            interpolator_copy(&ax->interpolator, &kernel->trial[i]);
            ax->line = synchronization == SJ_SYNC_PHASE && set->goal[i].kind == SJ_GOAL_ABSOLUTE
                           ? ways[i] : 0.0;
        }
        ax->parked = 0;
    }
}

int32_t sj_goal_begin(sj_kernel *kernel, goal_set *set)
{
    int32_t synchronization = set->synchronization, result, wait = goal_held(kernel);
    double ways[SJ_AXES];
    uint64_t together = 0;

    set->refused = -1;
    for (int32_t i = 0; i < set->n; i++) {
        together |= UINT64_C(1) << set->axes[i];
        sj_goal_ceiling(&kernel->axis[set->axes[i]]);
    }
    sj_paced_hand_over(kernel, together);
    if (!wait) {
        result = plan_goals(kernel, set->axes, set->goal, set->n, &synchronization,
                            set->least_cycles, 0, &set->refused, ways);
        if (result != SJ_RESULT_ACCEPTED)
            return result;
        for (int32_t i = 0; i < set->n; i++)
            kernel->axis[set->axes[i]].start = kernel->axis[set->axes[i]].interpolator.q.hi;
        take_over(kernel, set, synchronization, ways);
    }
    sj_paced_release(kernel, together);
    for (int32_t i = 0; i < set->n; i++) {
        sj_axis *ax = &kernel->axis[set->axes[i]];
        sj_axis_feedback *out = &kernel->feedback.axis[set->axes[i]];
        ax->goal_id = set->id;
        ax->goal_axes = together;
        ax->goal = set->goal[i];
        ax->synchronization = set->synchronization;
        ax->least_cycles = set->least_cycles;
        ax->reached = ax->onward = 0;
        sj_cycle_trigger(kernel, set->axes[i], trigger_of(&set->goal[i]));
        if (wait) { /* planned when the hold ends */
            ax->start = ax->interpolator.q.hi;
            ax->line = 0.0;
            ax->parked = set->goal[i].kind != SJ_GOAL_HOME;
            ax->homing = set->goal[i].kind == SJ_GOAL_HOME;
        }
        out->peak_velocity = out->peak_acceleration = out->peak_jerk = 0.0;
    }
    if (wait)
        sj_goal_again(kernel, 0.0);
    return SJ_RESULT_ACCEPTED;
}

void sj_goal_take(sj_kernel *kernel, int32_t stopped)
{
    const sj_command *command = &kernel->command;
    sj_feedback *feedback = &kernel->feedback;
    int32_t result = stopped ? SJ_RESULT_STOPPED : SJ_RESULT_ACCEPTED, changed = 0;
    uint64_t chosen = 0;
    goal_set set;

    kernel->goal_id = set.id = command->goal_id;
    set.least_cycles = command->least_cycles;
    set.synchronization = command->synchronization;
    set.n = 0;
    set.refused = -1;
    for (int32_t i = 0; i < kernel->axes && result == SJ_RESULT_ACCEPTED; i++) {
        sj_axis *ax = &kernel->axis[i];
        sj_axis_goal *goal = &set.goal[set.n];
        if (command->axis[i].goal.kind == SJ_GOAL_NONE)
            continue;
        *goal = command->axis[i].goal;
        sj_path_hand_over(kernel, i);
        if (goal->kind == SJ_GOAL_RELATIVE) {
            goal->kind = SJ_GOAL_ABSOLUTE;
            goal->goal += ax->interpolator.q.hi;
            changed = 1;
        }
        result = sj_goal_judge(ax, goal);
        if (result != SJ_RESULT_ACCEPTED)
            set.refused = i;
        changed |= !same_goal(&ax->goal, goal) || goal->kind == SJ_GOAL_HOME;
        set.axes[set.n++] = i;
        chosen |= UINT64_C(1) << i;
    }
    if (result == SJ_RESULT_ACCEPTED && changed)
        result = sj_goal_begin(kernel, &set);
    if (result == SJ_RESULT_ACCEPTED)
        sj_path_release(kernel, chosen);
    if (result == SJ_RESULT_ACCEPTED)
        sj_ahead_drop(kernel, chosen, 0, command->goal_records, SJ_RESULT_SUPERSEDED);
    for (int32_t i = 0; i < set.n && result == SJ_RESULT_ACCEPTED; i++)
        kernel->axis[set.axes[i]].goal_id = command->goal_id;
    feedback->result_goal_id = command->goal_id;
    feedback->result = result;
    feedback->result_axis = set.refused;
    sj_cycle_answer(kernel, command->goal_id, set.refused, result);
}

/* Held where a stop of its own leads; parked unless that is its goal. */
static void hold_by_stop(sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    sj_stop_together(kernel, axes, n);
    for (int32_t k = 0; k < n; k++) {
        sj_axis *ax = &kernel->axis[axes[k]];
        ax->parked = ax->interpolator.goal_free || ax->interpolator.ahead == 0;
    }
}

static void hold_on_way(sj_kernel *kernel, uint64_t set, double planned)
{
    int32_t axes[SJ_AXES], n;
    if (set == 0 || sj_paced_begin(kernel, set, planned))
        return;
    for (int32_t i = 0; i < kernel->axes; i++)
        if (set >> i & 1) {
            n = sj_group_of(kernel, i, &set, axes);
            hold_by_stop(kernel, axes, n);
        }
}

void sj_goal_again(sj_kernel *kernel, double planned)
{
    uint64_t set = 0, waits = 0;
    if (!goal_held(kernel) && kernel->override != kernel->paced.override) {
        sj_paced_hand_over(kernel, kernel->paced.axes);
        sj_paced_release(kernel, kernel->paced.axes);
    }
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        sj_goal_ceiling(ax);
        if (ax->following && (ax->goal.kind == SJ_GOAL_JOG ||
                              (ax->goal.kind == SJ_GOAL_ABSOLUTE && !ax->reached)))
            set |= UINT64_C(1) << i;
    }
    set &= ~kernel->paced.axes;
    for (int32_t i = 0; i < kernel->axes; i++) {
        int32_t axes[SJ_AXES], n, synchronization, refused, rest = 1;
        sj_axis_goal goals[SJ_AXES];
        double ways[SJ_AXES];
        if ((set >> i & 1) == 0)
            continue;
        n = sj_group_of(kernel, i, &set, axes);
        if (!sj_queue_release(kernel, axes, n))
            continue; /* too late to do anything before the goal; the next move does it */
        if (goal_held(kernel)) {
            if (planned > 0.0 && sj_paced_can(kernel, axes, n))
                for (int32_t k = 0; k < n; k++)
                    waits |= UINT64_C(1) << axes[k];
            else
                hold_by_stop(kernel, axes, n);
            continue;
        }
        for (int32_t k = 0; k < n; k++) {
            goals[k] = kernel->axis[axes[k]].goal;
            rest &= !axis_moving(&kernel->axis[axes[k]]);
        }
        synchronization = kernel->axis[i].synchronization;
        if (plan_goals(kernel, axes, goals, n, &synchronization, 0, !rest, &refused, ways) !=
            SJ_RESULT_ACCEPTED) {
            sj_stop_together(kernel, axes, n);
            for (int32_t k = 0; k < n; k++)
                axis_give_up(&kernel->axis[axes[k]]);
            continue;
        }
        for (int32_t k = 0; k < n; k++) {
            sj_axis *ax = &kernel->axis[axes[k]];
            interpolator_copy(&ax->interpolator, &kernel->trial[k]);
            ax->parked = 0;
            if (rest)
                ax->line = synchronization == SJ_SYNC_PHASE ? ways[k] : 0.0;
        }
    }
    hold_on_way(kernel, waits, planned);
}

/* All axes of its goal are on it: told once, by the last. */
static void tell_reached(sj_kernel *kernel, const sj_axis *ax)
{
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *other = &kernel->axis[i];
        if ((ax->goal_axes >> i & 1) && (other->goal_id != ax->goal_id || !other->reached))
            return;
    }
    sj_cycle_reached(kernel, ax->goal_id);
}

void sj_goal_reached(sj_kernel *kernel, int32_t axis)
{
    sj_axis *ax = &kernel->axis[axis];
    if (ax->parked || ax->goal.kind != SJ_GOAL_ABSOLUTE || ax->interpolator.ahead > 0)
        return;
    if (!ax->reached) {
        ax->reached = 1;
        tell_reached(kernel, ax);
    }
    if (ax->interpolator.v.hi == 0.0 || ax->onward)
        return;
    ax->goal.kind = SJ_GOAL_JOG; /* with the velocity it arrived with */
    if (isfinite(ax->config.position_min) || isfinite(ax->config.position_max)) {
        interpolator_copy(&kernel->trial[0], &ax->interpolator);
        if (plan_jog(kernel, ax, &ax->goal, &kernel->plan[0], &kernel->trial[0]) ==
            SJ_RESULT_ACCEPTED)
            interpolator_copy(&ax->interpolator, &kernel->trial[0]);
    }
}

/* Two axes by turns, to a goal that needs all phases; into kernel->plan and trial, which nothing
 * reads between cycles. */
void sj_goal_rehearse(sj_kernel *kernel)
{
    const uint64_t axes = (uint64_t)kernel->axes;
    int32_t chosen[2], n = axes > 1 ? 2 : 1, refused, synchronization = SJ_SYNC_TIME;
    sj_axis_goal goals[2];
    double ways[2];
    for (int32_t i = 0; i < n; i++) {
        const sj_axis *ax;
        chosen[i] = (int32_t)((kernel->feedback.cycle + (uint64_t)i) % axes);
        ax = &kernel->axis[chosen[i]];
        goals[i] = (sj_axis_goal){.kind = SJ_GOAL_ABSOLUTE, .limits = ax->config.limits};
        goals[i].goal = ax->interpolator.q.hi + 4.0 * goals[i].limits.velocity *
                                                    goals[i].limits.velocity /
                                                    goals[i].limits.acceleration;
    }
    plan_goals(kernel, chosen, goals, n, &synchronization, 0, 0, &refused, ways);
}
