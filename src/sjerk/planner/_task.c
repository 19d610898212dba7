/* The task: what is asked, and whether it can be asked.

   Clause of the contract: acceleration and jerk in the direction of the move, deceleration and
   deceleration jerk against it, whatever the sign of the velocity; the direction is the sign of h, or
   of v1, v0, a0, the first that is not zero.

   Never here: how it is done. */
#include "planner/_internal.h"

int sj_valid(double h, double v0, double a0, double v1, const sj_limits *l)
{
    return isfinite(h) && isfinite(v0) && isfinite(a0) && isfinite(v1) && isfinite(l->velocity) &&
           isfinite(l->acceleration) && isfinite(l->jerk) && isfinite(l->deceleration) &&
           isfinite(l->deceleration_jerk) && l->velocity > 0 && l->acceleration > 0 &&
           l->jerk > 0 && l->deceleration > 0 && l->deceleration_jerk > 0 &&
           fabs(v1) <= l->velocity * (1 + SLACK);
}

/* The task with "up" in the direction of the move: the sign of the first of these that is not
   zero. */
task sj_task_of(double h, double v0, double a0, double v1, const sj_limits *l)
{
    double direction = h != 0 ? h : v1 != 0 ? v1 : v0 != 0 ? v0 : a0;
    double d = direction < 0 ? -1 : 1;
    return (task){d * h,   d * v0,          d * a0,
                  d * v1,  l->velocity,     l->acceleration,
                  l->jerk, l->deceleration, l->deceleration_jerk,
                  d,       d * a0,          0};
}
