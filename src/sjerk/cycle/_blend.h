/* A passage, shared by _queue.c (when) and _passage.c (how fast, along which plans). */
#pragma once

/* A move under way and the next one, on the axes of both. */
typedef struct {
    int32_t n, m;
    int32_t axes[SJ_AXES], next[SJ_AXES];
    int32_t place[SJ_AXES];             /* of next[k] among axes, or -1: at rest until it begins */
    continuous at[SJ_AXES];             /* where axes[i] is */
    sj_limits limits[SJ_AXES], next_limits[SJ_AXES];    /* under the override */
    sj_axis_goal goal[SJ_AXES];         /* of next[k] */
    double velocity[SJ_AXES];           /* axes[i] is to pass its goal with */
} passage;

/* Fills `velocity` as the buffer mode asks, as far as both ways allow; whether any axis passes. */
int32_t sj_passage_choose(sj_kernel *kernel, int32_t mode, int32_t synchronization, passage *p);
/* The axes of the move under way to their goals with these velocities, into kernel->trial. The cycles
 * it takes; -1: not without a way round, or not within the position limits. */
int64_t sj_passage_before(sj_kernel *kernel, const passage *p, const double *velocity);
/* The next move from these velocities to its own goals; its cycles, or -1. */
int64_t sj_passage_next(sj_kernel *kernel, const passage *p, const sj_record *record,
                        const double *velocity);
/* Takes over what sj_passage_before planned. */
void sj_passage_load(sj_kernel *kernel, const passage *p, const double *velocity);
