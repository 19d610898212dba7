/* What one axis can do: whether a goal is possible in its state and within its limits, which limits a
 * plan from its present state may have, where a plan goes.
 *
 * Pure functions of the axis. Never here: other axes, plans for goals, drives, memory, time.
 */
#include <math.h> /* fabs, fmax, fmin, isfinite, sqrt */
#include <stdint.h>
#include "cycle/_axis.h"
#include "cycle/_motion.h"

/* ---- where a plan goes ---- */

static void widen(double distance, double *low, double *high)
{
    *low = fmin(*low, distance);
    *high = fmax(*high, distance);
}

double sj_axis_distance(const sj_plan *plan, double v, double a, double *low, double *high)
{
    double distance = 0.0;
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
                    widen(distance + turn[k] * (v + turn[k] * (a / 2.0 + turn[k] * j / 6.0)), low,
                          high);
        }
        distance += n * (v + n * (a / 2.0 + n * j / 6.0));
        v += n * (a + n * j / 2.0);
        a += n * j;
        widen(distance, low, high);
    }
    return distance;
}

int32_t sj_axis_inside(const sj_axis *ax, const sj_axis_goal *goal, const sj_limits *limits,
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
    sj_axis_distance(plan, at.V.hi, at.A.hi, &low, &high);
    if (goal->goal_velocity != 0.0) { /* and after the goal there is room to come to rest */
        if (sj_plan_velocity(goal->goal_velocity, 0.0, 0.0, limits, &rest) != SJ_PLAN_OK)
            return 0;
        beyond =
            goal->goal + sj_axis_distance(&rest, goal->goal_velocity, 0.0, &rest_low, &rest_high);
        if (beyond < config->position_min - slack || beyond > config->position_max + slack)
            return 0;
    }
    return at.P.hi + low >= fmin(config->position_min, at.P.hi) - slack &&
           at.P.hi + high <= fmax(config->position_max, at.P.hi) + slack;
}

/* ---- limits that are lowered in motion ---- */

static void raise(double *limit, double least) { *limit = fmax(*limit, least); }

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
void sj_axis_ceiling(sj_axis *ax)
{
    if (!axis_moving(ax))
        ax->ceiling = ax->config.limits;
    else
        raise_all(&ax->ceiling, &ax->config.limits);
    if (axis_moving(ax) && ax->goal.kind != SJ_GOAL_NONE)
        raise_all(&ax->ceiling, &ax->goal.limits);
}

/* Whichever direction the next plan has: its two jerks and accelerations change places with it. */
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
sj_limits sj_axis_kept(const sj_axis *ax, const continuous *at, const sj_limits *asked)
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

/* ---- whether a goal can be ---- */

int32_t sj_axis_trigger_of(const sj_axis_goal *goal)
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
           asked->acceleration <= own->acceleration * slack && asked->jerk <= own->jerk * slack &&
           asked->deceleration <= own->deceleration * slack &&
           asked->deceleration_jerk <= own->deceleration_jerk * slack;
}

int32_t sj_axis_possible(const sj_axis *ax, const sj_axis_goal *goal)
{
    const sj_axis_config *config = &ax->config;
    if (!within(&goal->limits, &config->limits))
        return SJ_RESULT_LIMITS;
    /* beyond 2^52 increments two of them are one double */
    if (!(fabs(goal->goal * config->counts_per_unit) < 4503599627370496.0))
        return SJ_RESULT_RANGE;
    if (!(fabs(goal->goal_velocity) <= goal->limits.velocity))
        return SJ_RESULT_PLAN;
    if (goal->kind == SJ_GOAL_ABSOLUTE &&
        (goal->goal < config->position_min || goal->goal > config->position_max))
        return SJ_RESULT_LIMIT;
    return SJ_RESULT_ACCEPTED;
}

int32_t sj_axis_judge(const sj_axis *ax, const sj_axis_goal *goal)
{
    if (goal->kind < SJ_GOAL_ABSOLUTE || goal->kind > SJ_GOAL_HOME)
        return SJ_RESULT_RANGE;
    if (sj_axis_next(ax->state, sj_axis_trigger_of(goal)) < 0)
        return ax->following || ax->error || ax->state == SJ_AXIS_HOMING ? SJ_RESULT_STATE
                                                                         : SJ_RESULT_NOT_FOLLOWING;
    if (!ax->following || !ax->enable)
        return SJ_RESULT_NOT_FOLLOWING;
    return goal->kind == SJ_GOAL_HOME ? SJ_RESULT_ACCEPTED : sj_axis_possible(ax, goal);
}

sj_limits sj_axis_limits(const sj_axis *ax, const sj_axis_goal *goal, double override)
{
    sj_limits limits = goal->limits;
    double most = fmax(limits.velocity, ax->config.limits.velocity);
    limits.velocity = fmin(limits.velocity * override, most);
    return limits;
}
