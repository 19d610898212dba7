/* Way-points as segments of constant jerk. */
#pragma once
#include <stdint.h>
#include "base/_types.h"

/* A window of way-points, followed by the samples. All memory is the caller's: `rows` of
 * points * sj_follow_row(joints) doubles, `spare` of sj_follow_spare(joints). Cycle units. */
enum sj_follow_status {
    SJ_FOLLOW_OK = 0,
    SJ_FOLLOW_INVALID = 1,  /* no segment, or a number that is none */
    SJ_FOLLOW_TOO_LONG = 2, /* more than SJ_CYCLES_MAX cycles */
    SJ_FOLLOW_STUCK = 3     /* stretching found no end: the start state leads nowhere */
};

typedef struct {
    int64_t points; /* way-points; the last is a stop */
    int32_t joints;
    int32_t shorter;        /* a neighbour so many times shorter is stretched instead */
    const double *position; /* (points, joints) */
    const double *velocity; /* (points, joints) to be had at the way-points, or NULL */
    const int64_t *least;   /* cycles asked for the segment that ends at point i */
    int64_t *cycles;        /* cycles it takes; in: where to begin */
    const double *limits;   /* (joints, 3): velocity, acceleration, jerk */
    double *rows;
    double *spare;
} sj_follow;

int64_t sj_follow_row(int32_t joints);
int64_t sj_follow_spare(int32_t joints);
void sj_follow_begin(const sj_follow *s, const double *velocity, const double *acceleration,
                     const double *last_jerk);
int32_t sj_follow_plan(const sj_follow *s);
/* Solve for the cycles as they are; share (points): the largest use of any limit per segment. */
void sj_follow_shares(const sj_follow *s, double *share);
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

/* For C only. */

int64_t sj_follow_least(const sj_follow *s, int64_t i);
int32_t sj_follow_could_lose(const sj_follow *s, int64_t i);
