/* A blend of two moves, shared by _queue.c (when) and _blend.c (how fast, by which plans). */
#pragma once
#include <stdint.h>
#include "cycle/_motion.h"

/* A move under way and the next one, on the axes of both. */
typedef struct {
    int32_t n, m;
    int32_t axes[SJ_AXES], next[SJ_AXES];
    int32_t place[SJ_AXES]; /* of next[k] among axes, or -1: at rest until it begins */
    continuous at[SJ_AXES]; /* where axes[i] is */
    sj_limits limits[SJ_AXES], next_limits[SJ_AXES]; /* under the override */
    sj_axis_goal goal[SJ_AXES];                      /* of next[k] */
    double velocity[SJ_AXES];                        /* of axes[i] at its goal */
} sj_blend;

/* Fills `velocity` as the buffer mode asks, as far as both distances allow; whether any axis blends. */
int32_t sj_blend_choose(sj_kernel *kernel, int32_t mode, int32_t synchronization, sj_blend *b);
/* The axes of the move under way to their goals with these velocities, into kernel->trial. The cycles
 * it takes; -1: not without going back, or not within the position limits. */
int64_t sj_blend_before(sj_kernel *kernel, const sj_blend *b, const double *velocity);
/* The next move from these velocities to its own goals; its cycles, or -1. */
int64_t sj_blend_next(sj_kernel *kernel, const sj_blend *b, const sj_record *record,
                      const double *velocity);
/* Takes over what sj_blend_before planned. */
void sj_blend_load(sj_kernel *kernel, const sj_blend *b, const double *velocity);
