/* A cruise at the velocity limit exactly, for what must pass at a given velocity (a laser, a nozzle).

   Other plans cruise a little slower, so that whole cycles cover the distance. Here both ramps are the
   fastest, the cruise is at V_max, and what does not make whole cycles of it,
       r = h - (distance of both ramps) - k V_max,   0 <= r < V_max,
   is taken up behind it: the last ramp at once with j cycles at v1 behind it, and the last ramp
   after j cycles more of cruise, are combined (_convex.c). They cover j v1 and j V_max more than the
   ramp, and j is the least for which r and j - 1 cycles of the cruise lie between.

   Never here: a velocity limit that is not reached. */
#include "planner/_internal.h"

/* Both ramps with `cruise` cycles between them and `wait` behind. */
static int with_cruise(const task *t, double cruise, double wait, path *x)
{
    x->count = 0;
    if (!sj_add_ramp(t, t->v0, t->vmax, x))
        return 0;
    sj_node(x, x->k[x->count - 1] + cruise, 0);
    if (!sj_add_ramp(t, t->vmax, t->v1, x))
        return 0;
    sj_node(x, x->k[x->count - 1] + wait, 0);
    return 1;
}

/* Whether the ramp up to V_max keeps the sign of the acceleration: beyond what zero on a node costs. */
static int keeps_its_sign(const task *t)
{
    double n = whole(t->a0 / t->ju);
    return t->a0 > 0 && t->vmax - t->v0 >= n * (t->a0 - n * t->ju / 2) + (t->a0 - n * t->ju) / 2;
}

/* From a start that is within its limits, to the target; 0 where there is no cycle of that cruise. */
static int by_exact_cruise(task *t, sj_plan *p)
{
    path x, y;
    double top = t->vmax, more = 1;
    if (t->ju != t->jd && t->a0 != 0 && !keeps_its_sign(t))
        sj_end_acceleration(t, p);
    if (!with_cruise(t, 0, 0, &x))
        return 0;
    double left = t->h - sj_path_distance(&x, t->v0), k = down(left / top), r = left - k * top;
    if (t->v1 > r)
        more = t->v1 < top ? up((t->v1 - r) / (top - t->v1)) + 1 : INFINITY;
    k -= more - 1;
    if (!(k >= 1) || !(k + more < LONGEST))
        return 0;
    if (!with_cruise(t, k, more, &x) || !with_cruise(t, k + more, 0, &y))
        return 0;
    return sj_convex_of(t, x.k[x.count - 1], &x, &y, p);
}

int32_t sj_plan_exact_cruise(double h, double v0, double a0, double v1, const sj_limits *l,
                             sj_plan *p)
{
    sj_begin(p);
    if (!sj_valid(h, v0, a0, v1, l))
        return SJ_PLAN_INVALID;
    task t = sj_task_of(h, v0, a0, v1, l);
    if (!sj_recover(&t, p))
        sj_cross_gently(&t, p);
    int ok = by_exact_cruise(&t, p);
    sj_note_scale(p, l);
    return ok ? SJ_PLAN_OK : SJ_PLAN_NO_CRUISE;
}
