/* One velocity ramp for several axes, before a plan or behind it. */
#pragma once
#include <stdint.h>
#include "base/_types.h"
#include "planner/_planner.h"

/* As sj_plan_axes; a steady start above the velocity limits runs down to them first. */
int32_t sj_run_down(int32_t n, const sj_request *request, const sj_limits *limits,
                    int64_t least_cycles, int32_t *synchronization, sj_plan *plans);
/* One ramp from 0 to 1 that is each axis' change of velocity by its share, upward or braking. Its
 * cycles, 0 for none, -1: it cannot be. */
int64_t sj_run_ramp(int32_t n, const sj_limits *limits, const double *from, const double *to,
                    sj_plan *ramp);
/* The ramp's phases for this change of velocity, before those of the plan or behind them. 0: more than
 * a plan holds. */
int32_t sj_run_join(sj_plan *plan, const sj_plan *ramp, double change, int32_t before);
/* The distance that the ramp covers between two velocities. */
double sj_run_distance(const sj_plan *ramp, double from, double to);
/* Whether a plan from (v, a) over this distance goes forward only: once it goes towards its end, never
 * back by more than rounding `of` a velocity. */
int32_t sj_run_forward(const sj_plan *plan, double v, double a, double distance, double of);
