/* One kernel: set up, then cycle by cycle. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* 0, or -1: the number of axes is out of range. Then every axis must be set. */
int32_t  sj_kernel_init(sj_kernel *kernel, void *segment, int32_t axes, double cycle_time_s);
/* As sj_drive_init. */
int32_t  sj_kernel_axis(sj_kernel *kernel, int32_t axis, const sj_drive_config *drive,
                        const sj_axis_config *config);
void     sj_kernel_cycles(sj_kernel *kernel, int64_t cycles); /* in a caller's own loop */
void     sj_kernel_step(sj_kernel *kernel);                   /* the same, one */

/* For C only. */

/* Top to bottom in the order of the data. now_ns: the begin of the cycle, any monotonic clock. */
void     sj_kernel_cycle(sj_kernel *kernel, uint64_t now_ns);
int32_t  sj_kernel_at_rest(const sj_kernel *kernel);    /* nothing moves, no drive is enabled */
/* Between cycles: a plan that nothing uses, so that the planner is in the caches when it is needed. */
void     sj_goal_rehearse(sj_kernel *kernel);

/* temporary: what is not apart yet */
#include "cycle/_motion.h"
#include "cycle/_axis.h"
#include "cycle/_events.h"
#include "cycle/_inputs.h"
#include "cycle/_trace.h"
#include "cycle/_run_down.h"
/* The reaction that is set for a cause, on a set of axes (bit n = axis n). */
void sj_cycle_react(sj_kernel *kernel, int32_t cause, uint64_t axes);

typedef struct {
    uint64_t id;
    int64_t least_cycles;
    int32_t synchronization, n;
    int32_t refused;                    /* axis, or -1 */
    int32_t axes[64];
    sj_axis_goal goal[64];              /* of axes[i] */
} goal_set;

/* Plans and takes over a goal that was judged, for all its axes or for none: enum sj_result. */
int32_t sj_goal_begin(sj_kernel *kernel, goal_set *set);
/* A goal for all its axes or for none; stopped: it came with a stop. */
void sj_goal_take(sj_kernel *kernel, int32_t stopped);
/* The goals in execution anew, after a change of override or hold. planned: the override under which
 * they were planned, and on whose way they are held; 0: by stops of their own. */
void sj_goal_again(sj_kernel *kernel, double planned);
/* An axis that has reached its goal with a velocity goes on, and to rest at a position limit. */
void sj_goal_reached(sj_kernel *kernel, int32_t axis);
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
