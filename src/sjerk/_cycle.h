/* What the two files of the cycle share: _cycle.c (top to bottom) and _goals.c (goals and stops). */
#ifndef SJ_CYCLE_H
#define SJ_CYCLE_H

static inline int32_t axis_moving(const sj_axis *ax)
{
    return ax->interpolator.ahead > 0 || ax->interpolator.v.hi != 0.0;
}

/* 0, or -1: refused in this state. Every change is told as an event. */
int32_t sj_cycle_trigger(sj_kernel *kernel, int32_t axis, int32_t trigger);
void sj_cycle_tell(sj_kernel *kernel, int32_t kind, int32_t axis, int32_t code, double value);

/* A goal for all its axes or for none; stopped: it came with a stop. */
void sj_goal_take(sj_kernel *kernel, int32_t stopped);
/* The goals in execution anew, after a change of override or hold. */
void sj_goal_again(sj_kernel *kernel);
/* An axis that has reached its goal with a velocity goes on, and to rest at a position limit. */
void sj_goal_reached(sj_kernel *kernel, int32_t axis);
/* Stops of the axes of a set (bit n = axis n), from the commanded state. */
void sj_goal_halt(sj_kernel *kernel, uint64_t axes);
void sj_goal_quick_stop(sj_kernel *kernel, uint64_t axes);

#endif
