/* What the files of the cycle share: _cycle.c (top to bottom), _goals.c (goals), _group.c (the axes of
 * one goal), _stops.c (halt and quick stop), _ahead.c (what waits for its turn), _queue.c with
 * _passage.c (moves among it), _path.c (the path in play) and _paced.c (moves held on their way). */
#pragma once

#include <stddef.h> /* offsetof */
#include <string.h> /* memcpy of an interpolator */
#include "cycle/_state.h"
#include "dpram/_dpram.h"
#include "base/_continuous.h" /* the continuous motion behind the commanded sample */

static inline int32_t axis_moving(const sj_axis *ax)
{
    return ax->interpolator.ahead > 0 || ax->interpolator.v.hi != 0.0;
}

static inline continuous axis_commanded(const sj_axis *ax)
{
    const sj_interpolator *ip = &ax->interpolator;
    return lemma(ip->q, ip->v, ip->a, ip->j);
}

/* Without the legs that it has not: most plans have a fifth of what there is room for. */
static inline void interpolator_copy(sj_interpolator *to, const sj_interpolator *from)
{
    memcpy(to, from, offsetof(sj_interpolator, legs) + (size_t)from->count * sizeof from->legs[0]);
}

static inline void axis_give_up(sj_axis *ax)
{
    ax->goal.kind = SJ_GOAL_NONE; /* the same goal again is a new motion */
    ax->parked = ax->reached = ax->onward = 0;
}

/* Motions wait on their way. */
static inline int32_t goal_held(const sj_kernel *kernel)
{
    return kernel->hold || kernel->override == 0.0;
}

/* 0, or -1: refused in this state. Every change is told as an event. */
int32_t sj_cycle_trigger(sj_kernel *kernel, int32_t axis, int32_t trigger);
void sj_cycle_tell(sj_kernel *kernel, int32_t kind, int32_t axis, int32_t code, double value);
/* The one answer to a goal; axis: the one that refused, or -1. */
void sj_cycle_answer(sj_kernel *kernel, uint64_t goal_id, int32_t axis, int32_t result);
void sj_cycle_reached(sj_kernel *kernel, uint64_t goal_id);
/* The reaction that is set for a cause, on a set of axes (bit n = axis n). */
void sj_cycle_react(sj_kernel *kernel, int32_t cause, uint64_t axes);
uint64_t sj_cycle_all(const sj_kernel *kernel);

typedef struct {
    uint64_t id;
    int64_t least_cycles;
    int32_t synchronization, n;
    int32_t refused;                    /* axis, or -1 */
    int32_t axes[64];
    sj_axis_goal goal[64];              /* of axes[i] */
} goal_set;

/* enum sj_result: whether an axis can have this goal in its state. */
int32_t sj_goal_judge(const sj_axis *ax, const sj_axis_goal *goal);
/* The same of its numbers alone. */
int32_t sj_goal_possible(const sj_axis *ax, const sj_axis_goal *goal);
/* Plans and takes over a goal that was judged, for all its axes or for none: enum sj_result. */
int32_t sj_goal_begin(sj_kernel *kernel, goal_set *set);
/* The goal's limits under the override: never faster than the goal or the axis allows. */
sj_limits sj_goal_limits(const sj_kernel *kernel, const sj_axis *ax, const sj_axis_goal *goal);
/* For a plan from the state at hand: a jerk lower than that of the motion under way could carry it
 * beyond the velocity of its axis before the acceleration is gone; then so much more of the axis' own
 * as it takes. */
sj_limits sj_goal_kept(const sj_axis *ax, const continuous *at, const sj_limits *asked);
/* Whether a plan stays within the position limits, or at least within where the axis is. */
int32_t sj_goal_inside(const sj_axis *ax, const sj_axis_goal *goal, const sj_limits *limits,
                       const sj_plan *plan);
/* As sj_plan_axes; a steady start above the velocity limits runs down to them first. */
int32_t sj_passage_plan(int32_t n, const sj_request *request, const sj_limits *limits,
                        int64_t least_cycles, int32_t *synchronization, sj_plan *plans);
/* The way of a plan from (v, a), and between which bounds it stays. */
double sj_goal_way(const sj_plan *plan, double v, double a, double *low, double *high);
/* A goal for all its axes or for none; stopped: it came with a stop. */
void sj_goal_take(sj_kernel *kernel, int32_t stopped);
/* The goals in execution anew, after a change of override or hold. planned: the override under which
 * they were planned, and on whose way they are held; 0: by stops of their own. */
void sj_goal_again(sj_kernel *kernel, double planned);
/* An axis that has reached its goal with a velocity goes on, and to rest at a position limit. */
void sj_goal_reached(sj_kernel *kernel, int32_t axis);
/* After a change of the axis' limits, and before a motion is planned. */
void sj_goal_ceiling(sj_axis *ax);

/* The moving axes that share a goal with this one, itself first; cleared from the set. How many. */
int32_t sj_group_of(const sj_kernel *kernel, int32_t axis, uint64_t *set, int32_t *axes);
/* One plan for all axes of a straight line, so that they stay on it, into kernel->plan: to rest, or
 * to their goals. -1: they are not on one. */
int32_t sj_group_line(sj_kernel *kernel, const int32_t *axes, int32_t n,
                      const sj_limits *limits, int32_t stop);

/* Stops of the axes of a set, from the commanded state. */
void sj_stop_halt(sj_kernel *kernel, uint64_t axes);
/* together: those of them that are slowed to stop with the slowest. */
void sj_stop_quick(sj_kernel *kernel, uint64_t axes, uint64_t together);
/* The axes of one goal to rest, together where that works; their goals stay. */
void sj_stop_together(sj_kernel *kernel, const int32_t *axes, int32_t n);

/* Records that have come: taken in order, a few per cycle, each offered to its room when its turn has
 * come, that is when no earlier record of its axes waits. */
void sj_ahead_start(sj_ahead *ahead);
void sj_ahead_see(sj_kernel *kernel);   /* before all else in a cycle */
void sj_ahead_take(sj_kernel *kernel);  /* after the command */
/* Records first .. last of these axes are not begun, be they taken or still in the ring; each is
 * answered with `result`. */
void sj_ahead_drop(sj_kernel *kernel, uint64_t axes, uint64_t first, uint64_t last, int32_t result);
void sj_ahead_stop(sj_kernel *kernel, uint64_t axes);   /* all that were given before this stop */

/* The path in play leads its axes: positions from the track instead of the interpolator. */
int32_t sj_path_offer(sj_kernel *kernel, sj_held *held);
void sj_path_step(sj_kernel *kernel);
/* Of these axes the ones it leads: it comes to rest on the path, and is forgotten. */
uint64_t sj_path_halt(sj_kernel *kernel, uint64_t axes);
/* It is left at once, if it leads one of these axes; the others halt. */
void sj_path_leave(sj_kernel *kernel, uint64_t axes);
/* The interpolator of an axis as it goes on from the path; and to let go of axes. */
void sj_path_hand_over(sj_kernel *kernel, int32_t axis);
void sj_path_release(sj_kernel *kernel, uint64_t axes);

/* Synchronised moves under way are held on it: one pace of time for all axes, and back to 1. Whether
 * the axes of a goal can be; and all that can, 0: they stay as they were. */
int32_t sj_paced_can(const sj_kernel *kernel, const int32_t *axes, int32_t n);
int32_t sj_paced_begin(sj_kernel *kernel, uint64_t axes, double planned);
void sj_paced_step(sj_kernel *kernel);
/* The interpolators of these axes as they go on from it; and to let go of them. */
void sj_paced_hand_over(sj_kernel *kernel, uint64_t axes);
void sj_paced_release(sj_kernel *kernel, uint64_t axes);

/* What a room says to a record: wait, begun, or refused with -(enum sj_result); then held->refused is
 * the axis that it is about, or -1. */
enum { OFFER_WAIT = 0, OFFER_TAKEN = 1 };

/* enum sj_result: whether a move that has just come can ever be begun; held->refused as above. */
int32_t sj_queue_judge(const sj_kernel *kernel, sj_held *held);
/* It is its turn: begun if its axes are free; else the move before may be told to pass its goal. */
int32_t sj_queue_offer(sj_kernel *kernel, sj_held *held);
/* The moves of these axes are not to pass their goal but to rest on it. 0: too late, they pass. */
int32_t sj_queue_release(sj_kernel *kernel, const int32_t *axes, int32_t n);
/* A move that is not to be begun. 1: it must be, since the one before passes its goal for it. */
int32_t sj_queue_drop(sj_kernel *kernel, sj_held *held);
