/* Queued moves, PLCopen's buffer modes: a move is begun when its axes are done with the one before,
 * or the one before is planned anew to pass its goal with a velocity that the next takes over.
 *
 * Nothing depends on a record that may not come: a move that is passed to has come. Never here: the
 * ring, time, drives, velocities and plans of a passage (_passage.c).
 */
#include <stddef.h>
#include <stdint.h>
#include "_cycle.h"
#include "_blend.h"

/* ---- judging and beginning ---- */

int32_t sj_queue_judge(const sj_kernel *kernel, sj_held *held)
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
        held->refused = i;
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
    held->refused = -1;
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
    sj_stop_halt(kernel, axes);
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
    held->refused = set.refused;
    come_to_rest(kernel, held->passing);
    return -result;
}

/* ---- the passage ---- */

static void add_before(const sj_kernel *kernel, passage *p, int32_t axis)
{
    const sj_axis *ax = &kernel->axis[axis];
    p->axes[p->n] = axis;
    p->at[p->n] = axis_commanded(ax);
    p->limits[p->n] = sj_goal_limits(kernel, ax, &ax->goal);
    p->limits[p->n] = sj_goal_kept(ax, &p->at[p->n], &p->limits[p->n]);
    p->n++;
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

/* Distances are known now: -(enum sj_result) where a goal cannot be. */
static int32_t still_possible(const sj_kernel *kernel, sj_held *held, const passage *p)
{
    for (int32_t k = 0; k < p->m; k++) {
        int32_t result = sj_goal_possible(&kernel->axis[p->next[k]], &p->goal[k]);
        if (result != SJ_RESULT_ACCEPTED) {
            held->refused = p->next[k];
            return -result;
        }
    }
    return OFFER_WAIT;
}

/* One try per cycle; where it fails the next is a slower one. Never slower than waiting. */
static int32_t pass(sj_kernel *kernel, sj_held *held)
{
    static const double rest[SJ_AXES] = {0};
    double velocity[SJ_AXES];
    int64_t before, next, waiting, left = 0;
    int32_t possible;
    passage p;

    if (!find(kernel, held, &p)) {
        held->share = 0.0;
        return OFFER_WAIT;
    }
    possible = still_possible(kernel, held, &p);
    if (possible < 0)
        return possible;
    if (!sj_passage_choose(kernel, held->record.mode, held->record.synchronization, &p)) {
        held->share = 0.0;
        return OFFER_WAIT;
    }
    for (int32_t i = 0; i < p.n; i++) {
        velocity[i] = held->share * p.velocity[i];
        if (kernel->axis[p.axes[i]].interpolator.ahead - 1 > left)
            left = kernel->axis[p.axes[i]].interpolator.ahead - 1;
    }
    held->share -= 0.25;
    waiting = sj_passage_next(kernel, &p, &held->record, rest);
    next = sj_passage_next(kernel, &p, &held->record, velocity);
    if (waiting < 0 || next < 0)
        return OFFER_WAIT;
    before = sj_passage_before(kernel, &p, velocity);
    if (before < 0 || before > left || before + next > left + waiting)
        return OFFER_WAIT;
    sj_passage_load(kernel, &p, velocity);
    held->passing = 0;
    for (int32_t i = 0; i < p.n; i++)
        held->passing |= (uint64_t)(velocity[i] != 0.0) << p.axes[i];
    held->share = 0.0;
    return OFFER_WAIT;
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
        return pass(kernel, held);
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
        if (onward(kernel, set, 1) != 0 || sj_passage_before(kernel, &p, rest) < 0)
            return 0;
        sj_passage_load(kernel, &p, rest);
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
