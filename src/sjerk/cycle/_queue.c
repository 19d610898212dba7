/* Queued moves, PLCopen's buffer modes: a move is begun when its axes are done with the one before,
 * or the one before is planned anew to blend into it.
 *
 * A blend is tried once per cycle, with all of the velocity that _blend.c chose, then three quarters,
 * a half and a quarter of it; where none serves, or both moves together would take longer than
 * waiting, the move waits: a blend that cannot be is a buffered move. It is taken back when a hold,
 * an override or a stop comes in between. Nothing depends on a record that may not come: a move is
 * blended only into one that waits already.
 *
 * Never here: the ring and whose turn it is (_lookahead.c), velocities and plans of a blend
 * (_blend.c), drives, time.
 */
#include <stddef.h>
#include <stdint.h>
#include "cycle/_axis.h"
#include "cycle/_blend.h"
#include "cycle/_goals.h"
#include "cycle/_motion.h"
#include "cycle/_queue.h"
#include "cycle/_stops.h"

/* ---- judging and beginning ---- */

int32_t sj_queue_judge(const sj_kernel *kernel, sj_waiting *waiting)
{
    const sj_record *record = &waiting->record;
    if (record->mode < SJ_BUFFER_BUFFERED || record->mode > SJ_BUFFER_HIGH ||
        record->synchronization < SJ_SYNC_NONE || record->synchronization > SJ_SYNC_PHASE)
        return SJ_RESULT_KIND;
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        const sj_axis_goal *goal = &record->axis[i].goal;
        int32_t result;
        if (goal->kind == SJ_GOAL_NONE)
            continue;
        waiting->refused = i;
        if (goal->kind != SJ_GOAL_ABSOLUTE && goal->kind != SJ_GOAL_RELATIVE)
            return SJ_RESULT_KIND;
        if (ax->state == SJ_AXIS_STOPPING || ax->state == SJ_AXIS_ERROR_STOP)
            return SJ_RESULT_STATE;
        if (!ax->enable || (!ax->following && ax->state != SJ_AXIS_HOMING))
            return SJ_RESULT_NOT_FOLLOWING;
        result = sj_axis_possible(ax, goal);
        if (result != SJ_RESULT_ACCEPTED)
            return result;
    }
    waiting->refused = -1;
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

/* Done with the motion before: at rest, past its goal, or at the velocity of a jog. */
static int32_t is_free(const sj_kernel *kernel, const sj_axis *ax)
{
    const sj_interpolator *ip = &ax->interpolator;
    if (!ax->following && ax->state != SJ_AXIS_HOMING)
        return 1; /* and refused */
    if (ax->homing || ax->held || ax->state == SJ_AXIS_SYNCHRONIZED ||
        ax->state == SJ_AXIS_HOMING || ax->state == SJ_AXIS_STOPPING)
        return 0;
    if (ax->goal.kind == SJ_GOAL_JOG && ip->v.hi != 0.0)
        return ip->a.hi == 0.0 && ip->j.hi == 0.0;
    return ip->cycles_left == 0 && (ax->goal.kind != SJ_GOAL_ABSOLUTE || is_done(kernel, ax));
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

static int32_t begin(sj_kernel *kernel, sj_waiting *waiting)
{
    const sj_record *record = &waiting->record;
    sj_goal_set set;
    int32_t result = SJ_RESULT_ACCEPTED;

    set.id = record->goal_id;
    set.least_cycles = record->least_cycles;
    set.synchronization = record->synchronization;
    set.n = 0;
    set.refused = -1;
    for (int32_t i = 0; i < kernel->axes && result == SJ_RESULT_ACCEPTED; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if ((waiting->axes >> i & 1) == 0)
            continue;
        set.goal[set.n] = resolved(ax, &record->axis[i].goal);
        result = sj_axis_judge(ax, &set.goal[set.n]);
        if (result != SJ_RESULT_ACCEPTED)
            set.refused = i;
        set.axes[set.n++] = i;
    }
    if (result == SJ_RESULT_ACCEPTED)
        result = sj_goal_begin(kernel, &set);
    if (result == SJ_RESULT_ACCEPTED)
        return OFFER_TAKEN;
    waiting->refused = set.refused;
    sj_stop_halt(kernel, waiting->blending); /* passed their goals for it */
    return -result;
}

/* ---- blending ---- */

static void add_before(const sj_kernel *kernel, sj_blend *b, int32_t axis)
{
    const sj_axis *ax = &kernel->axis[axis];
    b->axes[b->n] = axis;
    b->at[b->n] = axis_commanded(ax);
    b->limits[b->n] = sj_axis_limits(ax, &ax->goal, kernel->override);
    b->limits[b->n] = sj_axis_kept(ax, &b->at[b->n], &b->limits[b->n]);
    b->n++;
}

static int32_t under_way(const sj_axis *ax)
{
    return ax->following && ax->goal.kind == SJ_GOAL_ABSOLUTE && !ax->reached && !ax->held &&
           !ax->interpolator.goal_free;
}

/* Both moves of a blend; whether all axes of the next one are at rest or in one move that may pass its
 * goal. */
static int32_t find(const sj_kernel *kernel, const sj_waiting *waiting, sj_blend *b)
{
    uint64_t before = 0, goal_id = 0;
    b->n = b->m = 0;
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if ((waiting->axes >> i & 1) == 0 || (is_free(kernel, ax) && ax->interpolator.v.hi == 0.0))
            continue;
        if (!under_way(ax) || ax->blends || (before && ax->goal_id != goal_id))
            return 0;
        goal_id = ax->goal_id;
        before |= axis_bit(i);
    }
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if (!under_way(ax) || ax->goal_id != goal_id)
            continue;
        if (ax->goal.goal_velocity != 0.0)
            return 0; /* its velocity at the goal was asked for */
        add_before(kernel, b, i);
    }
    for (int32_t i = 0; i < b->n && b->n > 1; i++)
        if (sj_sync_is_alone(kernel->axis[b->axes[i]].synchronization) ||
            kernel->axis[b->axes[i]].line != 0.0)
            return 0; /* arrive one by one, or leave their straight line */
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if ((waiting->axes >> i & 1) == 0)
            continue;
        b->goal[b->m] = resolved(ax, &waiting->record.axis[i].goal);
        b->next_limits[b->m] = sj_axis_limits(ax, &b->goal[b->m], kernel->override);
        b->place[b->m] = -1;
        for (int32_t k = 0; k < b->n; k++)
            if (b->axes[k] == i)
                b->place[b->m] = k;
        b->next[b->m++] = i;
    }
    return b->n > 0;
}

/* Distances are known now: -(enum sj_result) where a goal cannot be. */
static int32_t still_possible(const sj_kernel *kernel, sj_waiting *waiting, const sj_blend *b)
{
    for (int32_t k = 0; k < b->m; k++) {
        int32_t result = sj_axis_possible(&kernel->axis[b->next[k]], &b->goal[k]);
        if (result != SJ_RESULT_ACCEPTED) {
            waiting->refused = b->next[k];
            return -result;
        }
    }
    return OFFER_WAIT;
}

/* One try per cycle; where it fails the next try is a slower one. Never slower than waiting. */
static int32_t blend(sj_kernel *kernel, sj_waiting *waiting)
{
    static const double rest[SJ_AXES] = {0};
    double velocity[SJ_AXES];
    int64_t before, next, from_rest, left = 0;
    int32_t possible;
    sj_blend b;

    if (!find(kernel, waiting, &b)) {
        waiting->share = 0.0;
        return OFFER_WAIT;
    }
    possible = still_possible(kernel, waiting, &b);
    if (possible < 0)
        return possible;
    if (!sj_blend_choose(kernel, waiting->record.mode, waiting->record.synchronization, &b)) {
        waiting->share = 0.0;
        return OFFER_WAIT;
    }
    for (int32_t i = 0; i < b.n; i++) {
        velocity[i] = waiting->share * b.velocity[i];
        if (kernel->axis[b.axes[i]].interpolator.cycles_left - 1 > left)
            left = kernel->axis[b.axes[i]].interpolator.cycles_left - 1;
    }
    waiting->share -= 0.25;
    from_rest = sj_blend_next(kernel, &b, &waiting->record, rest);
    next = sj_blend_next(kernel, &b, &waiting->record, velocity);
    if (from_rest < 0 || next < 0)
        return OFFER_WAIT;
    before = sj_blend_before(kernel, &b, velocity);
    if (before < 0 || before > left || before + next > left + from_rest)
        return OFFER_WAIT;
    sj_blend_load(kernel, &b, velocity);
    waiting->blending = 0;
    for (int32_t i = 0; i < b.n; i++)
        waiting->blending |= (uint64_t)(velocity[i] != 0.0) << b.axes[i];
    waiting->share = 0.0;
    return OFFER_WAIT;
}

/* Of these axes the ones that blend into another move; reached: and have passed their goal. */
static uint64_t blending_of(const sj_kernel *kernel, uint64_t axes, int32_t reached)
{
    uint64_t found = 0;
    for (int32_t i = 0; i < kernel->axes; i++)
        if ((axes >> i & 1) && kernel->axis[i].blends && (!reached || kernel->axis[i].reached))
            found |= axis_bit(i);
    return found;
}

int32_t sj_queue_offer(sj_kernel *kernel, sj_waiting *waiting)
{
    const sj_record *record = &waiting->record;
    int32_t ready = 1;

    if (waiting->spent) {
        uint64_t blending = blending_of(kernel, waiting->blending, 0);
        if (blending_of(kernel, blending, 1) != blending)
            return OFFER_WAIT;
        sj_stop_halt(kernel, blending);
        return OFFER_TAKEN;
    }
    for (int32_t i = 0; i < kernel->axes; i++)
        if (waiting->axes >> i & 1)
            ready &= is_free(kernel, &kernel->axis[i]);
    if (ready)
        return begin(kernel, waiting);
    if (record->mode > SJ_BUFFER_BUFFERED && waiting->share > 0.0 && !goal_held(kernel) &&
        record->synchronization != SJ_SYNC_PHASE)
        return blend(kernel, waiting);
    return OFFER_WAIT;
}

/* ---- taking it back ---- */

int32_t sj_queue_release(sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    static const double rest[SJ_AXES] = {0};
    uint64_t set = 0;
    sj_blend b;

    b.n = 0;
    for (int32_t i = 0; i < n; i++) {
        set |= axis_bit(axes[i]);
        add_before(kernel, &b, axes[i]);
    }
    if (blending_of(kernel, set, 0) != 0) {
        if (blending_of(kernel, set, 1) != 0 || sj_blend_before(kernel, &b, rest) < 0)
            return 0;
        sj_blend_load(kernel, &b, rest);
    }
    for (int32_t i = 0; i < kernel->lookahead.count; i++) {
        sj_waiting *waiting = &kernel->lookahead.waiting[kernel->lookahead.order[i]];
        if ((waiting->axes & set) == 0 || waiting->spent)
            continue;
        waiting->blending = 0;
        waiting->share = 1.0;
    }
    return 1;
}

int32_t sj_queue_drop(sj_kernel *kernel, sj_waiting *waiting)
{
    uint64_t blending = blending_of(kernel, waiting->blending, 0), goal_id = 0;
    int32_t axes[SJ_AXES], n = 0;

    if (blending == 0)
        return 0;
    for (int32_t i = 0; i < kernel->axes; i++)
        if (blending >> i & 1)
            goal_id = kernel->axis[i].goal_id;
    for (int32_t i = 0; i < kernel->axes; i++)
        if (kernel->axis[i].goal_id == goal_id && under_way(&kernel->axis[i]))
            axes[n++] = i;
    if (blending_of(kernel, blending, 1) == 0 && sj_queue_release(kernel, axes, n))
        return 0;
    waiting->blending = blending;
    waiting->spent = 1;
    return 1;
}
