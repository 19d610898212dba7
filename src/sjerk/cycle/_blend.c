/* Blending: a move passes its goal with a velocity, and the next one takes over there (PLCopen motion
 * control part 1, BufferMode BlendingLow, Previous, Next, High).
 *
 * The blend is a new plan of the move under way: from the commanded state to its goal, which
 * stays exact, on its cycle, *with* a velocity v. The next move starts from this state. For each axis
 * that both moves have, in the direction of the next distance D:
 *
 *   v = 0, where the two moves go in opposite directions or one of them does not move the axis
 *   v <= the velocity that the mode asks for: of the lower, previous, next, or higher move; that of
 *        an axis is the one on a straight line that is run as fast as the tightest axis allows
 *   v <= the highest with stopping_distance(v) <= |D|: the next move can come to rest on its own
 *        goal, so nothing depends on a record that may not come
 *   v <= the highest with reaching_distance(v) <= the distance that the move under way has left
 *
 * Each bound is searched by bisection: the first one with an estimate in closed form, confirmed by
 * the planner; the second one depends on the present acceleration and asks the planner each time. The
 * work is bounded by HALVINGS, TRIES and CLOSE_HALVINGS. A plan that goes back before its goal,
 * or leaves the position limits, is no blend.
 *
 * Acceleration and jerk are those of the move under way, in every cycle. So is the velocity
 * limit, with the exception that the modes ask for: a blend above the limit of one of the moves is a
 * run-up just before the goal, or a run-down just behind it (_run_down.c).
 *
 * Never here: which move is next and when to try (_queue.c), the ring, time.
 */
#include <math.h> /* fabs, ceil, sqrt */
#include <stddef.h>
#include <stdint.h>
#include "cycle/_axis.h"
#include "cycle/_blend.h"
#include "cycle/_run_down.h"

/* ---- the velocity at the goal ---- */

/* Velocities on a straight line that is run as fast as its tightest axis allows:
 *   |v_i| = |d_i| min_k (v_max,k / |d_k|) */
static void line_velocities(int32_t n, const double *distance, const sj_limits *limits,
                            double *velocity)
{
    double share = INFINITY;
    for (int32_t i = 0; i < n; i++)
        if (distance[i] != 0.0)
            share = fmin(share, limits[i].velocity / fabs(distance[i]));
    for (int32_t i = 0; i < n; i++)
        velocity[i] = distance[i] != 0.0 ? fabs(distance[i]) * share : 0.0;
}

/* The distance of a change of velocity, in the direction of `sign`; INFINITY: there is no plan. */
static double change_distance(double v0, double a0, double v1, const sj_limits *limits, double sign,
                              sj_plan *plan)
{
    double low, high;
    if (sj_plan_velocity(v0, a0, v1, limits, plan) != SJ_PLAN_OK)
        return INFINITY;
    return sign * sj_axis_distance(plan, v0, a0, &low, &high);
}

/* An estimate of it: the mean velocity over whole cycles, with v = |v1 - v0|:
 *   t = v/a + a/j, or 2 sqrt(v/j) where v j < a^2        d = (v0 + v1)/2 ceil(t) */
static double change_estimate(double v0, double v1, double acceleration, double jerk)
{
    double v = fabs(v1 - v0);
    double t = v * jerk >= acceleration * acceleration ? v / acceleration + acceleration / jerk
                                                       : 2.0 * sqrt(v / jerk);
    return 0.5 * (v0 + v1) * ceil(t);
}

enum { HALVINGS = 40, TRIES = 6, CLOSE_HALVINGS = 16 };

static sj_limits raised_to(const sj_limits *limits, double velocity)
{
    sj_limits wide = *limits;
    wide.velocity = fmax(wide.velocity, velocity);
    return wide;
}

/* The distance from v to rest, down to the velocity limit of the move first. A blend has v in a
 * sample, a plan in the continuous motion: half a cycle of v lies between them (_continuous.h). */
static double stopping_distance(double v, const sj_limits *limits, double sign, sj_plan *plan)
{
    double within = fmin(v, limits->velocity), distance = 0.5 * v;
    sj_limits wide = raised_to(limits, v);
    if (v > within)
        distance += change_distance(sign * v, 0.0, sign * within, &wide, sign, plan);
    return distance + change_distance(sign * within, 0.0, 0.0, limits, sign, plan);
}

static double stopping_estimate(double v, const sj_limits *limits)
{
    double within = fmin(v, limits->velocity);
    double a = limits->deceleration, j = limits->deceleration_jerk;
    return 0.5 * v + change_estimate(v, within, a, j) + change_estimate(within, 0.0, a, j);
}

/* The highest velocity, up to `most`, from which `distance` is enough to come to rest. */
static double fastest_to_stop(double distance, double most, const sj_limits *limits, double sign,
                              sj_plan *plan)
{
    double low = 0.0, high = most, v = most;
    if (stopping_estimate(v, limits) > distance) {
        for (int32_t k = 0; k < HALVINGS; k++) {
            v = 0.5 * (low + high);
            if (stopping_estimate(v, limits) > distance)
                high = v;
            else
                low = v;
        }
        v = low;
    }
    for (int32_t k = 0; k < TRIES; k++) {
        double needed = stopping_distance(v, limits, sign, plan);
        if (needed <= distance)
            return v;
        v *= fmin(distance / needed, 1.0) * (1.0 - 1e-9);
    }
    return 0.0;
}

/* The distance that an axis needs to reach v: under its limits, and above their velocity by a run-up at
 * the end. */
static double reaching_distance(const continuous *at, double v, const sj_limits *limits,
                                double sign, sj_plan *plan)
{
    double within = fmin(v, limits->velocity);
    double distance =
        change_distance(at->V.hi, at->A.hi, sign * within, limits, sign, plan) + 0.5 * v;
    sj_limits wide = raised_to(limits, v);
    if (v <= within)
        return distance;
    return distance + change_distance(sign * within, 0.0, sign * v, &wide, sign, plan);
}

static double fastest_to_reach(const continuous *at, double distance, double most,
                               const sj_limits *limits, double sign, sj_plan *plan)
{
    double low = 0.0, high = most;
    if (reaching_distance(at, most, limits, sign, plan) <= distance)
        return most;
    for (int32_t k = 0; k < CLOSE_HALVINGS; k++) {
        double v = 0.5 * (low + high);
        if (reaching_distance(at, v, limits, sign, plan) <= distance)
            low = v;
        else
            high = v;
    }
    return low;
}

static double asked_velocity(int32_t mode, double previous, double next)
{
    switch (mode) {
    case SJ_BUFFER_PREVIOUS: return previous;
    case SJ_BUFFER_NEXT: return next;
    case SJ_BUFFER_HIGH: return fmax(previous, next);
    default: return fmin(previous, next);
    }
}

int32_t sj_blend_choose(sj_kernel *kernel, int32_t mode, int32_t synchronization, sj_blend *b)
{
    double distance[SJ_AXES], next_distance[SJ_AXES], own[SJ_AXES], next[SJ_AXES], most = 0.0;

    for (int32_t i = 0; i < b->n; i++) {
        const sj_axis *ax = &kernel->axis[b->axes[i]];
        distance[i] = ax->goal.goal - ax->start;
        b->velocity[i] = 0.0;
    }
    for (int32_t k = 0; k < b->m; k++) {
        const sj_axis *ax = &kernel->axis[b->next[k]];
        next_distance[k] =
            b->goal[k].goal - (b->place[k] < 0 ? ax->interpolator.q.hi : ax->goal.goal);
    }
    line_velocities(b->n, distance, b->limits, own);
    line_velocities(b->m, next_distance, b->next_limits, next);
    for (int32_t k = 0; k < b->m && synchronization == SJ_SYNC_NONE; k++)
        next[k] = b->next_limits[k].velocity;
    for (int32_t k = 0; k < b->m; k++) {
        int32_t i = b->place[k];
        double sign = next_distance[k] < 0.0 ? -1.0 : 1.0, v, left;
        if (i < 0 || distance[i] * next_distance[k] <= 0.0)
            continue;
        left = sign * lemma_distance(&b->at[i], kernel->axis[b->axes[i]].goal.goal, 0.0);
        v = asked_velocity(mode, own[i], next[k]);
        v = fastest_to_stop(fabs(next_distance[k]), v, &b->next_limits[k], sign, &kernel->plan[0]);
        v = fastest_to_reach(&b->at[i], left, v, &b->limits[i], sign, &kernel->plan[0]);
        b->velocity[i] = sign * v;
        most = fmax(most, v);
    }
    return most > 0.0;
}

/* ---- the two plans ---- */

int64_t sj_blend_before(sj_kernel *kernel, const sj_blend *b, const double *velocity)
{
    double within[SJ_AXES];
    sj_request request[SJ_AXES];
    int32_t synchronization = b->n > 1 ? SJ_SYNC_TIME : SJ_SYNC_NONE;
    int64_t least = 0, run_up;
    sj_plan ramp;

    for (int32_t i = 0; i < b->n; i++)
        within[i] = fmax(-b->limits[i].velocity, fmin(b->limits[i].velocity, velocity[i]));
    run_up = sj_run_ramp(b->n, b->limits, within, velocity, &ramp);
    if (run_up < 0)
        return -1;
    for (int32_t i = 0; i < b->n; i++) {
        const sj_axis *ax = &kernel->axis[b->axes[i]];
        double distance = lemma_distance(&b->at[i], ax->goal.goal, velocity[i]);
        if (run_up > 0)
            distance -= sj_run_distance(&ramp, within[i], velocity[i]);
        request[i] = (sj_request){distance, b->at[i].V.hi, b->at[i].A.hi, within[i]};
        if (ax->least_cycles > 0 && ax->interpolator.cycles_left - 1 - run_up > least)
            least = ax->interpolator.cycles_left - 1 - run_up;
    }
    if (sj_run_down(b->n, request, b->limits, least, &synchronization, kernel->plan) != SJ_PLAN_OK)
        return -1;
    for (int32_t i = 0; i < b->n; i++) {
        const sj_axis *ax = &kernel->axis[b->axes[i]];
        sj_axis_goal goal = ax->goal;
        sj_plan *plan = &kernel->plan[i];
        goal.goal_velocity = velocity[i];
        if (run_up > 0) {
            if (!sj_run_join(plan, &ramp, velocity[i] - within[i], 0))
                return -1;
            plan->velocity = fmax(plan->velocity, fabs(velocity[i]));
        }
        interpolator_copy(&kernel->trial[i], &ax->interpolator);
        if (!sj_run_forward(plan, b->at[i].V.hi, b->at[i].A.hi,
                            lemma_distance(&b->at[i], goal.goal, velocity[i]),
                            b->limits[i].velocity) ||
            !sj_axis_inside(ax, &goal, &b->limits[i], plan) ||
            sj_interpolator_load(&kernel->trial[i], plan, goal.goal, velocity[i], 0) != SJ_LOAD_OK)
            return -1;
    }
    return kernel->plan[0].cycles;
}

int64_t sj_blend_next(sj_kernel *kernel, const sj_blend *b, const sj_record *record,
                      const double *velocity)
{
    sj_request request[SJ_AXES];
    int32_t synchronization = record->synchronization;
    int64_t longest = 0;

    for (int32_t k = 0; k < b->m; k++) {
        const sj_axis *ax = &kernel->axis[b->next[k]];
        int32_t i = b->place[k];
        double v = i < 0 ? 0.0 : velocity[i], v1 = b->goal[k].goal_velocity;
        double from = i < 0 ? ax->interpolator.q.hi : ax->goal.goal;
        v1 = fmax(-b->next_limits[k].velocity, fmin(b->next_limits[k].velocity, v1));
        request[k] = (sj_request){b->goal[k].goal - from - 0.5 * (v + v1), v, 0.0, v1};
    }
    if (sj_run_down(b->m, request, b->next_limits, record->least_cycles, &synchronization,
                    kernel->plan) != SJ_PLAN_OK)
        return -1;
    for (int32_t k = 0; k < b->m; k++) {
        if (!sj_run_forward(&kernel->plan[k], request[k].v0, 0.0, request[k].distance,
                            b->next_limits[k].velocity))
            return -1;
        if (kernel->plan[k].cycles > longest)
            longest = kernel->plan[k].cycles;
    }
    return longest;
}

void sj_blend_load(sj_kernel *kernel, const sj_blend *b, const double *velocity)
{
    for (int32_t i = 0; i < b->n; i++) {
        sj_axis *ax = &kernel->axis[b->axes[i]];
        interpolator_copy(&ax->interpolator, &kernel->trial[i]);
        ax->goal.goal_velocity = velocity[i];
        ax->blends = velocity[i] != 0.0;
        ax->line = 0.0;
    }
}
