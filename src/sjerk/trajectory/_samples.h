/* Segments of constant jerk, sampled. */
#pragma once
#include <stdint.h>

/* The samples of `count` segments as read, without the first knot's; the number of rows. */
typedef struct {
    double *position, *velocity, *acceleration, *jerk; /* (rows, joints), per cycle */
} sj_follow_samples;

int64_t sj_follow_sample(int64_t count, int64_t joints, const double *position,
                         const double *velocity, const double *acceleration,
                         const double *last_jerk, const int64_t *length, const double *jerk,
                         const sj_follow_samples *out);
