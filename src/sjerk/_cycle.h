/* What the files of the cycle share: _cycle.c (top to bottom), _goals.c (goals and stops), _ahead.c
 * (what waits for its turn) and _path.c (the path in play). */
#ifndef SJ_CYCLE_H
#define SJ_CYCLE_H

static inline int32_t axis_moving(const sj_axis *ax)
{
    return ax->interpolator.ahead > 0 || ax->interpolator.v.hi != 0.0;
}

/* 0, or -1: refused in this state. Every change is told as an event. */
int32_t sj_cycle_trigger(sj_kernel *kernel, int32_t axis, int32_t trigger);
void sj_cycle_tell(sj_kernel *kernel, int32_t kind, int32_t axis, int32_t code, double value);
/* The one answer to a goal; axis: the one that refused, or -1. */
void sj_cycle_answer(sj_kernel *kernel, uint64_t goal_id, int32_t axis, int32_t result);
/* The reaction that is set for a cause, on a set of axes (bit n = axis n). */
void sj_cycle_react(sj_kernel *kernel, int32_t cause, uint64_t axes);
uint64_t sj_cycle_all(const sj_kernel *kernel);

/* A goal for all its axes or for none; stopped: it came with a stop. */
void sj_goal_take(sj_kernel *kernel, int32_t stopped);
/* The goals in execution anew, after a change of override or hold. */
void sj_goal_again(sj_kernel *kernel);
/* An axis that has reached its goal with a velocity goes on, and to rest at a position limit. */
void sj_goal_reached(sj_kernel *kernel, int32_t axis);
/* After a change of the axis' limits, and before a motion is planned. */
void sj_goal_ceiling(sj_axis *ax);
/* Stops of the axes of a set, from the commanded state. */
void sj_goal_halt(sj_kernel *kernel, uint64_t axes);
void sj_goal_quick_stop(sj_kernel *kernel, uint64_t axes);

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
int32_t sj_path_offer(sj_kernel *kernel, const sj_held *held);
void sj_path_step(sj_kernel *kernel);
/* Of these axes the ones it leads: it comes to rest on the path, and is forgotten. */
uint64_t sj_path_halt(sj_kernel *kernel, uint64_t axes);
/* It is left at once, if it leads one of these axes; the others halt. */
void sj_path_leave(sj_kernel *kernel, uint64_t axes);
/* The interpolator of an axis as it goes on from the path; and to let go of axes. */
void sj_path_hand_over(sj_kernel *kernel, int32_t axis);
void sj_path_release(sj_kernel *kernel, uint64_t axes);

/* What a room says to a record: wait, consumed, or refused with -(enum sj_result). */
enum { OFFER_WAIT = 0, OFFER_TAKEN = 1 };

#endif
