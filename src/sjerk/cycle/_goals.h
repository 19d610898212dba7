/* Goals of one or several axes, planned together. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* A goal and its axes. */
typedef struct {
    uint64_t id;
    int64_t least_cycles;
    int32_t synchronization; /* as asked, */
    int32_t planned;         /* as planned: enum sj_synchronization */
    int32_t n;
    int32_t refused; /* axis, or -1 */
    int32_t axes[SJ_AXES];
    sj_axis_goal goal[SJ_AXES]; /* of axes[i] */
    double distance[SJ_AXES];   /* planned for axes[i] */
} sj_goal_set;

/* Plans into kernel->plan and trial, nothing else: enum sj_result. line: the axes are
 * moving along a straight line to the same goals. */
int32_t sj_goal_plan(sj_kernel *kernel, sj_goal_set *set, int32_t line);
/* Plans and takes over a goal that was judged, for all its axes or for none: enum sj_result. While
 * motions are held it is taken over without a plan: the caller holds it (sj_override_hold). */
int32_t sj_goal_begin(sj_kernel *kernel, sj_goal_set *set);
/* An axis that has reached its goal with a velocity goes on, and to rest at a position limit. */
void sj_goal_reached(sj_kernel *kernel, int32_t axis);
/* An axis that has been homed and follows again. */
void sj_goal_homed(sj_kernel *kernel, int32_t axis);
/* Between cycles: a plan that nothing uses, so that the planner is in the caches when it is needed. */
void sj_goal_rehearse(sj_kernel *kernel);
