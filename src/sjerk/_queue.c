/* Queued moves, PLCopen's buffer modes: a move is begun when its axes are done with the one before,
 * or the one before is planned anew to pass its goal with a velocity that the next takes over.
 *
 * The velocity to pass with is such that the next move can come to rest at its own goal, so nothing
 * depends on a record that may not come. Never here: the ring, time, drives, the equations of a plan.
 */
#include <math.h>   /* fabs, ceil, sqrt */
#include <stddef.h>
#include <stdint.h>
#include "_kernel.h"
#include "_cycle.h"

/* A move under way and the next one, on the axes of both. */
typedef struct {
    int32_t n, m;
    int32_t axes[SJ_AXES], next[SJ_AXES];
    int32_t place[SJ_AXES];             /* of next[k] among axes, or -1: at rest until it begins */
    continuous at[SJ_AXES];             /* where axes[i] is */
    sj_limits limits[SJ_AXES], next_limits[SJ_AXES];    /* under the override */
    sj_axis_goal goal[SJ_AXES];         /* of next[k] */
    double velocity[SJ_AXES];           /* axes[i] is to pass its goal with */
} passage;

/* ---- judging and beginning ---- */

int32_t sj_queue_judge(const sj_kernel *kernel, const sj_held *held)
{
    const sj_record *record = &held->record;
    if (record->mode < SJ_BUFFER_BUFFERED || record->mode > SJ_BUFFER_HIGH ||
        record->synchronization < SJ_SYNC_NONE || record->synchronization > SJ_SYNC_PHASE)
        return SJ_RESULT_KIND;
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        const sj_axis_goal *goal = &record->axis[i].goal;
        int32_t result;
        if (goal->kind == SJ_GOAL_NONE)
            continue;
        if (goal->kind != SJ_GOAL_ABSOLUTE && goal->kind != SJ_GOAL_RELATIVE)
            return SJ_RESULT_KIND;
        if (ax->state == SJ_AXIS_STOPPING || ax->state == SJ_AXIS_ERROR_STOP)
            return SJ_RESULT_STATE;
        if (!ax->enable || (!ax->following && ax->state != SJ_AXIS_HOMING))
            return SJ_RESULT_NOT_FOLLOWING;
        result = sj_goal_possible(ax, goal);
        if (result != SJ_RESULT_ACCEPTED)
            return result;
    }
    return SJ_RESULT_ACCEPTED;
}

/* Its move is on its goal on every axis that still has it. */
static int32_t is_done(const sj_kernel *kernel, const sj_axis *ax)
{
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *other = &kernel->axis[i];
        if ((ax->goal_axes >> i & 1) && other->goal_id == ax->goal_id &&
            other->goal.kind == SJ_GOAL_ABSOLUTE && !other->reached)
            return 0;
    }
    return 1;
}

/* Done with what it did: at rest, past its goal, or at the velocity of a jog. */
static int32_t is_free(const sj_kernel *kernel, const sj_axis *ax)
{
    const sj_interpolator *ip = &ax->interpolator;
    if (!ax->following && ax->state != SJ_AXIS_HOMING)
        return 1; /* and refused */
    if (ax->homing || ax->parked || ax->state == SJ_AXIS_SYNCHRONIZED ||
        ax->state == SJ_AXIS_HOMING || ax->state == SJ_AXIS_STOPPING)
        return 0;
    if (ax->goal.kind == SJ_GOAL_JOG && ip->v.hi != 0.0)
        return ip->a.hi == 0.0 && ip->j.hi == 0.0;
    return ip->ahead == 0 && (ax->goal.kind != SJ_GOAL_ABSOLUTE || is_done(kernel, ax));
}

/* A distance counts from the goal before. */
static sj_axis_goal resolved(const sj_axis *ax, const sj_axis_goal *asked)
{
    sj_axis_goal goal = *asked;
    if (goal.kind == SJ_GOAL_RELATIVE) {
        goal.kind = SJ_GOAL_ABSOLUTE;
        goal.goal += ax->goal.kind == SJ_GOAL_ABSOLUTE ? ax->goal.goal : ax->interpolator.q.hi;
    }
    return goal;
}

/* Axes that have passed a goal for a move that is not begun. */
static void come_to_rest(sj_kernel *kernel, uint64_t axes)
{
    uint64_t stop = kernel->ahead.stop;
    kernel->ahead.stop = 0; /* what waits behind it may go on */
    sj_goal_halt(kernel, axes);
    kernel->ahead.stop = stop;
}

static int32_t begin(sj_kernel *kernel, sj_held *held)
{
    const sj_record *record = &held->record;
    goal_set set;
    int32_t result = SJ_RESULT_ACCEPTED;

    set.id = record->goal_id;
    set.least_cycles = record->least_cycles;
    set.synchronization = record->synchronization;
    set.n = 0;
    set.refused = -1;
    for (int32_t i = 0; i < kernel->axes && result == SJ_RESULT_ACCEPTED; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if ((held->axes >> i & 1) == 0)
            continue;
        set.goal[set.n] = resolved(ax, &record->axis[i].goal);
        result = sj_goal_judge(ax, &set.goal[set.n]);
        if (result != SJ_RESULT_ACCEPTED)
            set.refused = i;
        set.axes[set.n++] = i;
    }
    if (result == SJ_RESULT_ACCEPTED)
        result = sj_goal_begin(kernel, &set);
    if (result == SJ_RESULT_ACCEPTED)
        return OFFER_TAKEN;
    come_to_rest(kernel, held->passing);
    return -result;
}

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

/* Its estimate for a ramp to rest: the mean velocity over whole cycles. */
static double ramp_covers(double v, double acceleration, double jerk)
{
    double t = v * jerk >= acceleration * acceleration ? v / acceleration + acceleration / jerk
                                                       : 2.0 * sqrt(v / jerk);
    return 0.5 * v * ceil(t);
}

enum { HALVINGS = 40, TRIES = 6, CLOSE_HALVINGS = 16 };

/* The highest velocity, up to `most`, from which `way` is enough to come to rest. The plan runs from
 * sample to sample: half a cycle of the velocity is the lemma's. */
static double stops_within(double way, double most, const sj_limits *limits, double sign,
                           sj_plan *plan)
{
    double low = 0.0, v = most, needed;
    if (ramp_covers(v, limits->deceleration, limits->deceleration_jerk) + 0.5 * v > way) {
        double high = v;
        for (int32_t k = 0; k < HALVINGS; k++) {
            v = 0.5 * (low + high);
            if (ramp_covers(v, limits->deceleration, limits->deceleration_jerk) + 0.5 * v > way)
                high = v;
            else
                low = v;
        }
        v = low;
    }
    for (int32_t k = 0; k < TRIES; k++) {
        needed = covers(sign * v, 0.0, 0.0, limits, sign, plan) + 0.5 * v;
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
    sj_limits wide = *limits;
    if (v <= within)
        return way;
    wide.velocity = v;
    return way + covers(sign * within, 0.0, sign * v, &wide, sign, plan);
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

/* Returns whether any axis can pass its goal. */
static int32_t choose(sj_kernel *kernel, const sj_held *held, passage *p)
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
    for (int32_t k = 0; k < p->m && held->record.synchronization == SJ_SYNC_NONE; k++)
        next[k] = p->next_limits[k].velocity;
    for (int32_t k = 0; k < p->m; k++) {
        int32_t i = p->place[k];
        double sign = next_way[k] < 0.0 ? -1.0 : 1.0, v, left;
        if (i < 0 || way[i] * next_way[k] <= 0.0)
            continue;
        left = sign * lemma_distance(&p->at[i], kernel->axis[p->axes[i]].goal.goal, 0.0);
        v = wanted(held->record.mode, own[i], next[k]);
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

/* The run-up beyond the velocity limits of the move under way: one ramp for all axes, of their
 * differences. Its cycles, 0 for none, -1: it cannot be. */
static int64_t plan_run_up(const passage *p, const double *from, const double *to, sj_plan *ramp)
{
    sj_limits one = {1.0, INFINITY, INFINITY, INFINITY, INFINITY};
    int32_t any = 0;
    for (int32_t i = 0; i < p->n; i++) {
        double change = fabs(to[i] - from[i]);
        if (change == 0.0)
            continue;
        one.acceleration = fmin(one.acceleration, p->limits[i].acceleration / change);
        one.jerk = fmin(one.jerk, p->limits[i].jerk / change);
        any = 1;
    }
    if (!any)
        return 0;
    one.deceleration = one.acceleration;
    one.deceleration_jerk = one.jerk;
    return sj_plan_velocity(0.0, 0.0, 1.0, &one, ramp) == SJ_PLAN_OK ? ramp->cycles : -1;
}

/* The axes of the move under way to their goals with these velocities, into kernel->trial. The cycles
 * it takes; -1: not without a way round, or not within the position limits. */
static int64_t plan_before(sj_kernel *kernel, const passage *p, const double *velocity)
{
    double within[SJ_AXES];
    sj_request request[SJ_AXES];
    int32_t synchronization = p->n > 1 ? SJ_SYNC_TIME : SJ_SYNC_NONE;
    int64_t least = 0, run_up;
    sj_plan ramp;

    for (int32_t i = 0; i < p->n; i++)
        within[i] = fmax(-p->limits[i].velocity, fmin(p->limits[i].velocity, velocity[i]));
    run_up = plan_run_up(p, within, velocity, &ramp);
    if (run_up < 0)
        return -1;
    for (int32_t i = 0; i < p->n; i++) {
        const sj_axis *ax = &kernel->axis[p->axes[i]];
        double low, high, change = velocity[i] - within[i];
        double way = lemma_distance(&p->at[i], ax->goal.goal, velocity[i]);
        if (run_up > 0)
            way -= (double)run_up * within[i] + change * sj_goal_way(&ramp, 0.0, 0.0, &low, &high);
        request[i] = (sj_request){way, p->at[i].V.hi, p->at[i].A.hi, within[i]};
        if (ax->least_cycles > 0 && ax->interpolator.ahead - 1 - run_up > least)
            least = ax->interpolator.ahead - 1 - run_up;
    }
    if (sj_plan_axes(p->n, request, p->limits, least, &synchronization, kernel->plan) !=
        SJ_PLAN_OK)
        return -1;
    for (int32_t i = 0; i < p->n; i++) {
        const sj_axis *ax = &kernel->axis[p->axes[i]];
        sj_axis_goal goal = ax->goal;
        sj_plan *plan = &kernel->plan[i];
        goal.goal_velocity = velocity[i];
        if (run_up > 0) {
            if (plan->count + ramp.count > SJ_PHASES)
                return -1;
            for (int32_t k = 0; k < ramp.count; k++)
                plan->phase[plan->count++] = (sj_phase){
                    ramp.phase[k].cycles, ramp.phase[k].jerk * (velocity[i] - within[i])};
            plan->cycles += run_up;
            plan->velocity = fmax(plan->velocity, fabs(velocity[i]));
        }
        kernel->trial[i] = ax->interpolator;
        if (!is_direct(plan, p->at[i].V.hi, p->at[i].A.hi,
                       lemma_distance(&p->at[i], goal.goal, velocity[i]), p->limits[i].velocity) ||
            !sj_goal_inside(ax, &goal, &p->limits[i], plan) ||
            sj_interpolator_load(&kernel->trial[i], plan, goal.goal, velocity[i], 0) != SJ_LOAD_OK)
            return -1;
    }
    return kernel->plan[0].cycles;
}

/* The next move from these velocities to its own goals; its cycles, or -1. */
static int64_t plan_next(sj_kernel *kernel, const passage *p, const sj_record *record,
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
    if (sj_plan_axes(p->m, request, p->next_limits, record->least_cycles, &synchronization,
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

static void load_before(sj_kernel *kernel, const passage *p, const double *velocity)
{
    for (int32_t i = 0; i < p->n; i++) {
        sj_axis *ax = &kernel->axis[p->axes[i]];
        ax->interpolator = kernel->trial[i];
        ax->goal.goal_velocity = velocity[i];
        ax->onward = velocity[i] != 0.0;
        ax->line = 0.0;
    }
}

/* ---- the passage ---- */

static void add_before(const sj_kernel *kernel, passage *p, int32_t axis)
{
    const sj_axis *ax = &kernel->axis[axis];
    p->axes[p->n] = axis;
    p->at[p->n] = axis_commanded(ax);
    p->limits[p->n++] = sj_goal_limits(kernel, ax, &ax->goal);
}

static int32_t under_way(const sj_axis *ax)
{
    return ax->following && ax->goal.kind == SJ_GOAL_ABSOLUTE && !ax->reached && !ax->parked &&
           !ax->interpolator.goal_free;
}

/* Whether all axes of the next move are at rest or in one move that may pass its goal. */
static int32_t find(const sj_kernel *kernel, const sj_held *held, passage *p)
{
    uint64_t before = 0, goal_id = 0;
    p->n = p->m = 0;
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if ((held->axes >> i & 1) == 0 || (is_free(kernel, ax) && ax->interpolator.v.hi == 0.0))
            continue;
        if (!under_way(ax) || ax->onward || (before && ax->goal_id != goal_id))
            return 0;
        goal_id = ax->goal_id;
        before |= UINT64_C(1) << i;
    }
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if (!under_way(ax) || ax->goal_id != goal_id)
            continue;
        if (ax->goal.goal_velocity != 0.0)
            return 0; /* was told how to arrive */
        add_before(kernel, p, i);
    }
    for (int32_t i = 0; i < p->n && p->n > 1; i++)
        if (kernel->axis[p->axes[i]].synchronization == SJ_SYNC_NONE ||
            kernel->axis[p->axes[i]].line != 0.0)
            return 0; /* arrive one by one, or leave their straight line */
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if ((held->axes >> i & 1) == 0)
            continue;
        p->goal[p->m] = resolved(ax, &held->record.axis[i].goal);
        p->next_limits[p->m] = sj_goal_limits(kernel, ax, &p->goal[p->m]);
        p->place[p->m] = -1;
        for (int32_t k = 0; k < p->n; k++)
            if (p->axes[k] == i)
                p->place[p->m] = k;
        p->next[p->m++] = i;
    }
    return p->n > 0;
}

/* One try per cycle; where it fails the next is a slower one. Never slower than waiting. */
static void pass(sj_kernel *kernel, sj_held *held)
{
    static const double rest[SJ_AXES] = {0};
    double velocity[SJ_AXES];
    int64_t before, next, waiting, left = 0;
    passage p;

    if (!find(kernel, held, &p) || !choose(kernel, held, &p)) {
        held->share = 0.0;
        return;
    }
    for (int32_t i = 0; i < p.n; i++) {
        velocity[i] = held->share * p.velocity[i];
        if (kernel->axis[p.axes[i]].interpolator.ahead - 1 > left)
            left = kernel->axis[p.axes[i]].interpolator.ahead - 1;
    }
    held->share -= 0.25;
    waiting = plan_next(kernel, &p, &held->record, rest);
    next = plan_next(kernel, &p, &held->record, velocity);
    if (waiting < 0 || next < 0)
        return;
    before = plan_before(kernel, &p, velocity);
    if (before < 0 || before > left || before + next > left + waiting)
        return;
    load_before(kernel, &p, velocity);
    held->passing = 0;
    for (int32_t i = 0; i < p.n; i++)
        held->passing |= (uint64_t)(velocity[i] != 0.0) << p.axes[i];
    held->share = 0.0;
}

/* The set of axes whose moves do pass. */
static uint64_t onward(const sj_kernel *kernel, uint64_t axes, int32_t reached)
{
    uint64_t found = 0;
    for (int32_t i = 0; i < kernel->axes; i++)
        if ((axes >> i & 1) && kernel->axis[i].onward && (!reached || kernel->axis[i].reached))
            found |= UINT64_C(1) << i;
    return found;
}

int32_t sj_queue_offer(sj_kernel *kernel, sj_held *held)
{
    const sj_record *record = &held->record;
    int32_t ready = 1;

    if (held->spent) {
        uint64_t passing = onward(kernel, held->passing, 0);
        if (onward(kernel, passing, 1) != passing)
            return OFFER_WAIT;
        come_to_rest(kernel, passing);
        return OFFER_TAKEN;
    }
    for (int32_t i = 0; i < kernel->axes; i++)
        if (held->axes >> i & 1)
            ready &= is_free(kernel, &kernel->axis[i]);
    if (ready)
        return begin(kernel, held);
    if (record->mode > SJ_BUFFER_BUFFERED && held->share > 0.0 && !goal_held(kernel) &&
        record->synchronization != SJ_SYNC_PHASE)
        pass(kernel, held);
    return OFFER_WAIT;
}

/* ---- taking it back ---- */

int32_t sj_queue_release(sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    static const double rest[SJ_AXES] = {0};
    uint64_t set = 0;
    passage p;

    p.n = 0;
    for (int32_t i = 0; i < n; i++) {
        set |= UINT64_C(1) << axes[i];
        add_before(kernel, &p, axes[i]);
    }
    if (onward(kernel, set, 0) != 0) {
        if (onward(kernel, set, 1) != 0 || plan_before(kernel, &p, rest) < 0)
            return 0;
        load_before(kernel, &p, rest);
    }
    for (int32_t i = 0; i < kernel->ahead.count; i++) {
        sj_held *held = &kernel->ahead.held[kernel->ahead.order[i]];
        if ((held->axes & set) == 0 || held->spent)
            continue;
        held->passing = 0;
        held->share = 1.0;
    }
    return 1;
}

int32_t sj_queue_drop(sj_kernel *kernel, sj_held *held)
{
    uint64_t passing = onward(kernel, held->passing, 0), goal_id = 0;
    int32_t axes[SJ_AXES], n = 0;

    if (passing == 0)
        return 0;
    for (int32_t i = 0; i < kernel->axes; i++)
        if (passing >> i & 1)
            goal_id = kernel->axis[i].goal_id;
    for (int32_t i = 0; i < kernel->axes; i++)
        if (kernel->axis[i].goal_id == goal_id && under_way(&kernel->axis[i]))
            axes[n++] = i;
    if (onward(kernel, passing, 1) == 0 && sj_queue_release(kernel, axes, n))
        return 0;
    held->passing = passing;
    held->spent = 1;
    return 1;
}
