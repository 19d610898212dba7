/* Way-points as segments of constant jerk. */
#pragma once
#include <stdint.h>
#include "base/_types.h"

/* A state and way-points in their cycles, the last a stop. All memory is the caller's: `rows` of
 * points * sj_follow_row(joints) doubles. Cycle units. */
typedef struct {
    int64_t points;
    int32_t joints;
    const double *position; /* (points, joints) */
    const double *velocity; /* (points, joints) to be had at the way-points, or NULL */
    const int64_t *cycles;  /* (points): of the segment that ends at point i */
    const double *limits;   /* (joints, 3): velocity, acceleration, jerk */
    double *rows;
} sj_follow;

int64_t sj_follow_row(int32_t joints);
/* Solve from a state; share (points): the largest use of any limit per segment. */
void sj_follow_shares(const sj_follow *s, const double *velocity, const double *acceleration,
                      const double *last_jerk, double *share);
void sj_follow_read(const sj_follow *s, int64_t count, int64_t *length, double *jerk,
                    double *velocity, double *acceleration, double *last_jerk);
/* The samples of `count` segments as read, without the first knot's; the number of rows. */
typedef struct {
    double *position, *velocity, *acceleration, *jerk; /* (rows, joints), per cycle */
} sj_follow_samples;

int64_t sj_follow_sample(int64_t count, int64_t joints, const double *position,
                         const double *velocity, const double *acceleration,
                         const double *last_jerk, const int64_t *length, const double *jerk,
                         const sj_follow_samples *out);
