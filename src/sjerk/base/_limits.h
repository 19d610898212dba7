/* Limits of one motion that several axes share. */
#pragma once
#include <math.h>        /* fabs, fmin */
#include "base/_types.h" /* sj_limits */

/* Narrows the limits of a motion s(t), so that an axis that moves by `ratio` of it keeps its own:
 *     |ratio| s' <= velocity,  and so on, hence  s' <= velocity / |ratio|. */
static inline void limits_narrow(sj_limits *limits, const sj_limits *axis, double ratio)
{
    ratio = fabs(ratio);
    limits->velocity = fmin(limits->velocity, axis->velocity / ratio);
    limits->acceleration = fmin(limits->acceleration, axis->acceleration / ratio);
    limits->jerk = fmin(limits->jerk, axis->jerk / ratio);
    limits->deceleration = fmin(limits->deceleration, axis->deceleration / ratio);
    limits->deceleration_jerk = fmin(limits->deceleration_jerk, axis->deceleration_jerk / ratio);
}
