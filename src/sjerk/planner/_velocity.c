/* A change of velocity from any acceleration, put into the plan.

   With two jerks each side of zero acceleration has its own, so that the acceleration changes its
   sign on a node or not at all; then it is a ramp (_ramp.c).

   Never here: a distance to be met. */
#include "planner/_internal.h"

/* Fastest ramp to (v, 0) from a start whose acceleration can end on a node within the limits, put
   into the plan. */
int sj_go_to_velocity(task *t, double v, sj_plan *p)
{
    path x;
    double j = t->ju;
    if (t->ju != t->jd) {
        /* beyond what zero on a node costs the sign stays; else it changes on a node */
        double s = t->a0 > 0 ? 1 : -1, jz = s > 0 ? t->ju : t->jd, a = s * t->a0;
        double n = whole(a / jz), landed = n * (a - n * jz / 2) + (a - n * jz) / 2;
        if (a > 0 && s * (v - t->v0) >= landed)
            j = jz;
        else {
            sj_end_acceleration(t, p);
            j = v > t->v0 ? t->ju : t->jd;
        }
    }
    if (!sj_ramp(t->v0, t->a0, v - t->v0, t->vmax * (1 + SLACK), t->au, t->ad, j, &x))
        return 0;
    sj_path_put(p, &x, t);
    t->h -= sj_path_distance(&x, t->v0);
    t->v0 = v;
    t->a0 = 0;
    return 1;
}

/* To (v1, 0) in m cycles, gentler than the fastest: the acceleration keeps a lower level. 0 where that
   does not serve. */
int sj_velocity_in(const task *start, double m, sj_plan *p)
{
    task t = *start;
    path x;
    sj_plan q;
    sj_begin(&q);
    if (t.ju != t.jd)
        sj_end_acceleration(&t, &q);
    double j = t.v1 > t.v0 ? t.ju : t.jd;
    if (!sj_ramp_in(&t, t.v1 - t.v0, j, m - (double)q.cycles, &x))
        return 0;
    sj_path_put(&q, &x, &t);
    if (q.count > SJ_PHASES || sj_leaves_velocity(start, &q, 0))
        return 0;
    *p = q;
    return 1;
}
