/* The bilinear interpolator, Eqs. (15)-(17). */
#pragma once
#include <stdint.h>
#include "base/_types.h"

enum sj_load_status {
    SJ_LOAD_OK = 0,
    SJ_LOAD_PHASES = 1, /* a phase count or length out of range */
    SJ_LOAD_MISSES = 2  /* the phases do not lead to the goal */
};

/* A phase as it is integrated: its jerk is the difference of two acceleration levels over its
 * length, so that an acceleration that is planned as zero is exactly zero. */
typedef struct {
    int64_t cycles;
    sj_exact jerk;
} sj_leg;

/* The bilinear integrator, Eqs. (15)-(17), in cycle units, and the legs ahead of it. */
typedef struct {
    sj_exact q, v, a, j;         /* the sample of this cycle */
    sj_exact spread_v, spread_q; /* per cycle: what rounding the plan to doubles costs */
    double goal, goal_velocity, goal_acceleration; /* the settled end, cycle N + 1 */
    int64_t left;                                  /* cycles left of the present leg */
    int64_t cycles_left;                           /* until settled; 0 = settled */
    int32_t leg, count;
    int32_t goal_free; /* 1: a change of velocity, the end position is open */
    int32_t reserved;
    sj_leg legs[SJ_PHASES];
} sj_interpolator;

/* Rows of a sampled motion; every column has room for `rows`. */
typedef struct {
    int64_t rows;
    double *time, *position, *velocity, *acceleration, *jerk;
} sj_table;

void sj_interpolator_start(sj_interpolator *ip, const sj_state *sample);
int32_t sj_interpolator_load(sj_interpolator *ip, const sj_plan *plan, double goal,
                             double goal_velocity, int32_t goal_free);
/* The same to an end with an acceleration, in which the motion then goes on. */
int32_t sj_interpolator_load_to(sj_interpolator *ip, const sj_plan *plan, const sj_state *end,
                                int32_t goal_free);
int32_t sj_interpolator_step(sj_interpolator *ip);
void sj_interpolator_fill(sj_interpolator *ip, double cycle_time_s, int64_t first_row,
                          const sj_table *out);
int32_t sj_sample(const sj_plan *plan, const void *start, const void *end, double cycle_time_s,
                  const sj_table *out);
void sj_lemma_plan(const sj_state *sample, double jerk, sj_state *plan);
void sj_lemma_sample(const sj_state *plan, double jerk, sj_state *sample);
