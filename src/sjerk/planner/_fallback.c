/* Ways that exist where no plan near the optimum does: the acceleration brought to zero first, or a
   stop, a plan from rest to rest, a wait of any length and the run-up to the target's velocity. The
   last one always exists, so that a legal request is never refused.

   Each asks the planner (sj_move) once more, for a simpler task and without rescue: no deeper
   recursion.

   Never here: the choice of when they are needed (_profile.c). */
#include "_plan.h"

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
        if (a > 0 && s * (v - t->v0) >= landed) j = jz;
        else {
            sj_shed(t, p);
            j = v > t->v0 ? t->ju : t->jd;
        }
    }
    if (!sj_ramp(t->v0, t->a0, v - t->v0, t->vmax * (1 + SLACK), t->au, t->ad, j, &x)) return 0;
    sj_path_put(p, &x, t);
    t->h -= sj_path_distance(&x, t->v0);
    t->v0 = v;
    t->a0 = 0;
    return 1;
}

/* Stop, rest to rest, wait if the plan is to last `length` cycles, run-up: the way that is always
   there. */
int sj_by_stopping(const task *start, double length, sj_plan *p)
{
    task t = *start, r;
    sj_plan head, runup;
    sj_begin(&head);
    sj_begin(&runup);
    if (!sj_go_to_velocity(&t, 0, &head)) return 0;
    t = sj_resume(start, &head);
    t.v0 = t.a0 = 0;
    sj_append(p, &head);
    double v1 = t.v1;
    if (v1 != 0) {
        r = t; r.h = r.first = 0;
        if (!sj_go_to_velocity(&r, v1, &runup)) return 0;
        t.h += r.h;
        t.v1 = 0;
    }
    if (!sj_move(&t, p, 0)) return 0;
    double wait = length - (double)(p->cycles + runup.cycles);
    if (wait < 0) return 0;
    if (wait < LONGEST) sj_put_cruise(p, &t, wait);
    sj_append(p, &runup);
    p->kind = SJ_PLAN_STOP;
    return 1;
}

/* Acceleration to zero first: serves where the velocity limit, a cycle ahead, leaves no other way.
   */
int sj_by_shedding(const task *start, sj_plan *p)
{
    task t = *start;
    sj_plan q = *p;
    sj_shed(&t, &q);
    if (!sj_move(&t, &q, 0)) return 0;
    *p = q;
    return 1;
}
