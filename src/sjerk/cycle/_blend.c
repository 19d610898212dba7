/* Passing a goal: the velocity to pass with, and the plans of the move before and of the next one.
 *
 * The velocity is such that the next move can come to rest at its own goal, and that the one before
 * reaches it within its own way. Below its own velocity limit a move keeps it; a passage at more is a
 * run-up before the goal, or a run-down behind it. Never here: which move is next, the ring, time.
 */
#include <math.h>   /* fabs, ceil, sqrt */
#include <stddef.h>
#include <stdint.h>
#include "_cycle.h"
#include "_blend.h"

/* ---- velocities to pass with ---- */

/* The shares of a straight line that is run as fast as its tightest axis allows. */
static void along(int32_t n, const double *way, const sj_limits *limits, double *velocity)
{
    double share = INFINITY;
    for (int32_t i = 0; i < n; i++)
        if (way[i] != 0.0)
            share = fmin(share, limits[i].velocity / fabs(way[i]));
    for (int32_t i = 0; i < n; i++)
        velocity[i] = way[i] != 0.0 ? fabs(way[i]) * share : 0.0;
}

/* What a change of velocity covers, in the direction of `sign`. */
static double covers(double v0, double a0, double v1, const sj_limits *limits, double sign,
                     sj_plan *plan)
{
    double low, high;
    if (sj_plan_velocity(v0, a0, v1, limits, plan) != SJ_PLAN_OK)
        return INFINITY;
    return sign * sj_goal_way(plan, v0, a0, &low, &high);
}

/* Its estimate: the mean velocity over whole cycles. */
static double about(double v0, double v1, double acceleration, double jerk)
{
    double v = fabs(v1 - v0);
    double t = v * jerk >= acceleration * acceleration ? v / acceleration + acceleration / jerk
                                                       : 2.0 * sqrt(v / jerk);
    return 0.5 * (v0 + v1) * ceil(t);
}

enum { HALVINGS = 40, TRIES = 6, CLOSE_HALVINGS = 16 };

static sj_limits up_to(const sj_limits *limits, double velocity)
{
    sj_limits wide = *limits;
    wide.velocity = fmax(wide.velocity, velocity);
    return wide;
}

/* What a move covers from v to rest, down to its velocity limit first. The plan runs from sample to
 * sample: half a cycle of the velocity is the lemma's. */
static double to_rest(double v, const sj_limits *limits, double sign, sj_plan *plan)
{
    double within = fmin(v, limits->velocity), way = 0.5 * v;
    sj_limits wide = up_to(limits, v);
    if (v > within)
        way += covers(sign * v, 0.0, sign * within, &wide, sign, plan);
    return way + covers(sign * within, 0.0, 0.0, limits, sign, plan);
}

static double about_to_rest(double v, const sj_limits *limits)
{
    double within = fmin(v, limits->velocity);
    double a = limits->deceleration, j = limits->deceleration_jerk;
    return 0.5 * v + about(v, within, a, j) + about(within, 0.0, a, j);
}

/* The highest velocity, up to `most`, from which `way` is enough to come to rest. */
static double stops_within(double way, double most, const sj_limits *limits, double sign,
                           sj_plan *plan)
{
    double low = 0.0, high = most, v = most;
    if (about_to_rest(v, limits) > way) {
        for (int32_t k = 0; k < HALVINGS; k++) {
            v = 0.5 * (low + high);
            if (about_to_rest(v, limits) > way)
                high = v;
            else
                low = v;
        }
        v = low;
    }
    for (int32_t k = 0; k < TRIES; k++) {
        double needed = to_rest(v, limits, sign, plan);
        if (needed <= way)
            return v;
        v *= fmin(way / needed, 1.0) * (1.0 - 1e-9);
    }
    return 0.0;
}

/* What an axis needs to reach v: under its limits, and beyond their velocity by a run-up at the end. */
static double needs(const continuous *at, double v, const sj_limits *limits, double sign,
                    sj_plan *plan)
{
    double within = fmin(v, limits->velocity);
    double way = covers(at->V.hi, at->A.hi, sign * within, limits, sign, plan) + 0.5 * v;
    sj_limits wide = up_to(limits, v);
    return v <= within ? way : way + covers(sign * within, 0.0, sign * v, &wide, sign, plan);
}

static double reaches(const continuous *at, double way, double most, const sj_limits *limits,
                      double sign, sj_plan *plan)
{
    double low = 0.0, high = most;
    if (needs(at, most, limits, sign, plan) <= way)
        return most;
    for (int32_t k = 0; k < CLOSE_HALVINGS; k++) {
        double v = 0.5 * (low + high);
        if (needs(at, v, limits, sign, plan) <= way)
            low = v;
        else
            high = v;
    }
    return low;
}

static double wanted(int32_t mode, double previous, double next)
{
    switch (mode) {
    case SJ_BUFFER_PREVIOUS:
        return previous;
    case SJ_BUFFER_NEXT:
        return next;
    case SJ_BUFFER_HIGH:
        return fmax(previous, next);
    default:
        return fmin(previous, next);
    }
}

int32_t sj_passage_choose(sj_kernel *kernel, int32_t mode, int32_t synchronization, passage *p)
{
    double way[SJ_AXES], next_way[SJ_AXES], own[SJ_AXES], next[SJ_AXES], most = 0.0;

    for (int32_t i = 0; i < p->n; i++) {
        const sj_axis *ax = &kernel->axis[p->axes[i]];
        way[i] = ax->goal.goal - ax->start;
        p->velocity[i] = 0.0;
    }
    for (int32_t k = 0; k < p->m; k++) {
        const sj_axis *ax = &kernel->axis[p->next[k]];
        next_way[k] = p->goal[k].goal -
                      (p->place[k] < 0 ? ax->interpolator.q.hi : ax->goal.goal);
    }
    along(p->n, way, p->limits, own);
    along(p->m, next_way, p->next_limits, next);
    for (int32_t k = 0; k < p->m && synchronization == SJ_SYNC_NONE; k++)
        next[k] = p->next_limits[k].velocity;
    for (int32_t k = 0; k < p->m; k++) {
        int32_t i = p->place[k];
        double sign = next_way[k] < 0.0 ? -1.0 : 1.0, v, left;
        if (i < 0 || way[i] * next_way[k] <= 0.0)
            continue;
        left = sign * lemma_distance(&p->at[i], kernel->axis[p->axes[i]].goal.goal, 0.0);
        v = wanted(mode, own[i], next[k]);
        v = stops_within(fabs(next_way[k]), v, &p->next_limits[k], sign, &kernel->plan[0]);
        v = reaches(&p->at[i], left, v, &p->limits[i], sign, &kernel->plan[0]);
        p->velocity[i] = sign * v;
        most = fmax(most, v);
    }
    return most > 0.0;
}

/* ---- planning the passage ---- */

/* Forward only: once it goes towards its end, never back. */
static int32_t is_direct(const sj_plan *plan, double v, double a, double way, double of)
{
    double sign = way < 0.0 ? -1.0 : 1.0, least = -1e-9 * of;
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

/* One ramp for all axes, of their changes of velocity; upward or braking. Its cycles, 0 for none, -1:
 * it cannot be. */
static int64_t plan_ramp(int32_t n, const sj_limits *limits, const double *from, const double *to,
                         sj_plan *ramp)
{
    sj_limits one = {1.0, INFINITY, INFINITY, INFINITY, INFINITY};
    int32_t any = 0;
    for (int32_t i = 0; i < n; i++) {
        double change = fabs(to[i] - from[i]);
        int32_t up = fabs(to[i]) > fabs(from[i]);
        if (change == 0.0)
            continue;
        one.acceleration = fmin(one.acceleration, (up ? limits[i].acceleration
                                                      : limits[i].deceleration) / change);
        one.jerk = fmin(one.jerk, (up ? limits[i].jerk : limits[i].deceleration_jerk) / change);
        any = 1;
    }
    if (!any)
        return 0;
    one.deceleration = one.acceleration;
    one.deceleration_jerk = one.jerk;
    return sj_plan_velocity(0.0, 0.0, 1.0, &one, ramp) == SJ_PLAN_OK ? ramp->cycles : -1;
}

/* The ramp's phases for a change of velocity, before those of the plan or behind them. */
static int32_t join(sj_plan *plan, const sj_plan *ramp, double change, int32_t before)
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

static double ramp_way(const sj_plan *ramp, double from, double to)
{
    double low, high;
    return (double)ramp->cycles * from + (to - from) * sj_goal_way(ramp, 0.0, 0.0, &low, &high);
}

/* As sj_plan_axes. A steady start above the velocity limits runs down to them first; that is also a
 * plan where the planner would have to turn. */
int32_t sj_passage_plan(int32_t n, const sj_request *request, const sj_limits *limits,
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
    down = steady ? plan_ramp(n, limits, from, to, &ramp) : 0;
    if (down <= 0)
        return sj_plan_axes(n, request, limits, least_cycles, synchronization, plans);
    for (int32_t i = 0; i < n; i++)
        rest[i] = (sj_request){request[i].distance - ramp_way(&ramp, from[i], to[i]), to[i], 0.0,
                               request[i].v1};
    done = sj_plan_axes(n, rest, limits, least_cycles - down, synchronization, plans) == SJ_PLAN_OK;
    for (int32_t i = 0; i < n && done; i++) {
        plans[i].velocity = fmax(plans[i].velocity, fabs(from[i]));
        done = join(&plans[i], &ramp, to[i] - from[i], 1) &&
               is_direct(&plans[i], from[i], 0.0, request[i].distance, limits[i].velocity);
    }
    if (done)
        return SJ_PLAN_OK;
    *synchronization = asked;
    return sj_plan_axes(n, request, limits, least_cycles, synchronization, plans);
}

int64_t sj_passage_before(sj_kernel *kernel, const passage *p, const double *velocity)
{
    double within[SJ_AXES];
    sj_request request[SJ_AXES];
    int32_t synchronization = p->n > 1 ? SJ_SYNC_TIME : SJ_SYNC_NONE;
    int64_t least = 0, run_up;
    sj_plan ramp;

    for (int32_t i = 0; i < p->n; i++)
        within[i] = fmax(-p->limits[i].velocity, fmin(p->limits[i].velocity, velocity[i]));
    run_up = plan_ramp(p->n, p->limits, within, velocity, &ramp);
    if (run_up < 0)
        return -1;
    for (int32_t i = 0; i < p->n; i++) {
        const sj_axis *ax = &kernel->axis[p->axes[i]];
        double way = lemma_distance(&p->at[i], ax->goal.goal, velocity[i]);
        if (run_up > 0)
            way -= ramp_way(&ramp, within[i], velocity[i]);
        request[i] = (sj_request){way, p->at[i].V.hi, p->at[i].A.hi, within[i]};
        if (ax->least_cycles > 0 && ax->interpolator.ahead - 1 - run_up > least)
            least = ax->interpolator.ahead - 1 - run_up;
    }
    if (sj_passage_plan(p->n, request, p->limits, least, &synchronization, kernel->plan) !=
        SJ_PLAN_OK)
        return -1;
    for (int32_t i = 0; i < p->n; i++) {
        const sj_axis *ax = &kernel->axis[p->axes[i]];
        sj_axis_goal goal = ax->goal;
        sj_plan *plan = &kernel->plan[i];
        goal.goal_velocity = velocity[i];
        if (run_up > 0) {
            if (!join(plan, &ramp, velocity[i] - within[i], 0))
                return -1;
            plan->velocity = fmax(plan->velocity, fabs(velocity[i]));
        }
        interpolator_copy(&kernel->trial[i], &ax->interpolator);
        if (!is_direct(plan, p->at[i].V.hi, p->at[i].A.hi,
                       lemma_distance(&p->at[i], goal.goal, velocity[i]), p->limits[i].velocity) ||
            !sj_goal_inside(ax, &goal, &p->limits[i], plan) ||
            sj_interpolator_load(&kernel->trial[i], plan, goal.goal, velocity[i], 0) != SJ_LOAD_OK)
            return -1;
    }
    return kernel->plan[0].cycles;
}

int64_t sj_passage_next(sj_kernel *kernel, const passage *p, const sj_record *record,
                        const double *velocity)
{
    sj_request request[SJ_AXES];
    int32_t synchronization = record->synchronization;
    int64_t longest = 0;

    for (int32_t k = 0; k < p->m; k++) {
        const sj_axis *ax = &kernel->axis[p->next[k]];
        int32_t i = p->place[k];
        double v = i < 0 ? 0.0 : velocity[i], v1 = p->goal[k].goal_velocity;
        double from = i < 0 ? ax->interpolator.q.hi : ax->goal.goal;
        v1 = fmax(-p->next_limits[k].velocity, fmin(p->next_limits[k].velocity, v1));
        request[k] = (sj_request){p->goal[k].goal - from - 0.5 * (v + v1), v, 0.0, v1};
    }
    if (sj_passage_plan(p->m, request, p->next_limits, record->least_cycles, &synchronization,
                        kernel->plan) != SJ_PLAN_OK)
        return -1;
    for (int32_t k = 0; k < p->m; k++) {
        if (!is_direct(&kernel->plan[k], request[k].v0, 0.0, request[k].distance,
                       p->next_limits[k].velocity))
            return -1;
        if (kernel->plan[k].cycles > longest)
            longest = kernel->plan[k].cycles;
    }
    return longest;
}

void sj_passage_load(sj_kernel *kernel, const passage *p, const double *velocity)
{
    for (int32_t i = 0; i < p->n; i++) {
        sj_axis *ax = &kernel->axis[p->axes[i]];
        interpolator_copy(&ax->interpolator, &kernel->trial[i]);
        ax->goal.goal_velocity = velocity[i];
        ax->onward = velocity[i] != 0.0;
        ax->line = 0.0;
    }
}
