/* What every file of the cycle asks of an axis or of a set of axes, in a line or two. Never here: plans,
 * decisions, anything outside the state. */
#pragma once
#include <stddef.h> /* offsetof */
#include <stdint.h>
#include <string.h>           /* memcpy of an interpolator */
#include "base/_continuous.h" /* the continuous motion behind the commanded sample */
#include "cycle/_state.h"

/* Cycles until a drive's answer is about this homing, not the last. */
enum { HOMING_SETTLES = 4 };

/* Sets of axes are bits: bit n is axis n. */
static inline uint64_t axis_bit(int32_t axis) { return UINT64_C(1) << axis; }

static inline uint64_t all_axes(const sj_kernel *kernel)
{
    return kernel->axes == 64 ? UINT64_MAX : (UINT64_C(1) << kernel->axes) - 1;
}

static inline int32_t axis_moving(const sj_axis *ax)
{
    return ax->interpolator.cycles_left > 0 || ax->interpolator.v.hi != 0.0;
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
    ax->held = ax->reached = ax->blends = 0;
}

/* Whether motions are held. */
static inline int32_t goal_held(const sj_kernel *kernel)
{
    return kernel->hold || kernel->override == 0.0;
}
