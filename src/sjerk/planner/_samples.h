/* Requests between samples. */
#pragma once
#include "planner/_planner.h"

/* From sample to sample, no jerk before the start and behind the end; SI units of time, limits per cycle.
 * The lemma in plain doubles: what that rounds is far below what the interpolator takes out exactly. */
static inline sj_request request_between(double T, const sj_state *from, const sj_state *to)
{
    double v = from->velocity * T, a = from->acceleration * T * T, v1 = to->velocity * T;
    if (to->acceleration != 0.0) {
        /* the plan's end lies half a cycle before the sample */
        double a1 = to->acceleration * T * T;
        return (sj_request){(to->position - from->position) - 0.5 * (v1 + v) + (a - a1) / 12.0,
                            v + 0.5 * a, a, v1 - 0.5 * a1};
    }
    return (sj_request){(to->position - from->position) - 0.5 * (v1 + v) + a / 12.0, v + 0.5 * a, a,
                        v1};
}
