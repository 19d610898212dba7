/* What an axis can do, judged by itself: no other axis, nothing changes but its own ceiling. */
#pragma once
#include <stdint.h>
#include "base/_continuous.h"
#include "cycle/_state.h"
#include "planner/_planner.h"

/* enum sj_trigger: what a goal means to the axis' state. */
int32_t sj_axis_trigger_of(const sj_axis_goal *goal);
/* enum sj_result: whether the axis can have this goal in its state. */
int32_t sj_axis_judge(const sj_axis *ax, const sj_axis_goal *goal);
/* The same of the goal's numbers alone. */
int32_t sj_axis_possible(const sj_axis *ax, const sj_axis_goal *goal);
/* The goal's limits under an override: never faster than the goal or the axis allows. */
sj_limits sj_axis_limits(const sj_axis *ax, const sj_axis_goal *goal, double override);
/* For a plan from the state at hand: a jerk lower than that of the motion under way could carry it
 * beyond the velocity of its axis before the acceleration is gone; then so much more of the axis' own
 * as it takes. */
sj_limits sj_axis_kept(const sj_axis *ax, const continuous *at, const sj_limits *asked);
/* After a change of the axis' limits, and before a motion is planned. */
void sj_axis_ceiling(sj_axis *ax);
/* Whether a plan stays within the position limits, or at least within where the axis is. */
int32_t sj_axis_inside(const sj_axis *ax, const sj_axis_goal *goal, const sj_limits *limits,
                       const sj_plan *plan);
/* The distance that a plan covers from (v, a), and between which bounds it stays. */
double sj_axis_distance(const sj_plan *plan, double v, double a, double *low, double *high);
