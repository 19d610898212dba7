/* Ways that exist where no plan near the optimum does: the acceleration brought to zero first, or a
   stop, a plan from rest to rest, a wait of any length and the run-up to the target's velocity. The
   last one always exists, so that a legal request is never refused.

   Each asks the planner (sj_move) once more, for a simpler task and without rescue: no deeper
   recursion.

   Never here: the choice of when they are needed (_profile.c). */
#include "_plan.h"

/* Whether the velocity leaves +-vmax along the path, at nodes or at zeros of the acceleration. */
static int leaves_velocity(const path *x, double v, double vmax)
{
    vmax *= 1 + SLACK;
    for (int i = 0; i + 1 < x->count; i++) {
        double n = x->k[i + 1] - x->k[i], a = x->a[i], b = x->a[i + 1];
        if (a * b < 0 && fabs(v + n * a * a / (2 * (a - b))) > vmax) return 1;
        v += n * (a + b) / 2;
        if (fabs(v) > vmax) return 1;
    }
    return 0;
}

/* One cycle across zero, with the jerk that lets the velocity peak at its limit: where cycles are so
   long that zero acceleration on a node would carry it over. 0: no jerk does. */
static int cross(task *t, sj_plan *p)
{
    double s = t->a0 > 0 ? 1 : -1, a = fabs(t->a0), room = t->vmax - s * t->v0;
    double j = a * a / (2 * room), most_j = least(least(t->ju, t->jd), a + (s > 0 ? t->ad : t->au));
    if (!(room > 0 && j <= most_j)) return 0;
    j = most(j, a);
    sj_put(p, 1, -s * t->sign * j);
    t->h -= t->v0 + t->a0 / 2 - s * j / 6;
    t->v0 += t->a0 - s * j / 2;
    t->a0 -= s * j;
    return 1;
}

/* Fastest ramp to (v, 0) from a start that can keep the limits, put into the plan. */
int sj_go_to_velocity(task *t, double v, sj_plan *p)
{
    path x;
    double j = t->ju;
    if (t->ju != t->jd) {
        double jz = t->a0 > 0 ? t->ju : t->jd, z = t->v0 + t->a0 * fabs(t->a0) / (2 * jz);
        if (t->a0 != 0 && (t->a0 > 0 ? v >= z + jz / 8 : v <= z - jz / 8)) j = jz;
        else {
            /* the sign changes: on a node, or in a cycle of the smaller jerk */
            sj_shed(t, p);
            j = v > t->v0 ? t->ju : t->jd;
            if (t->a0 != 0) j = least(t->ju, t->jd);
        }
    }
    if (!sj_ramp(t->v0, t->a0, v - t->v0, t->vmax * (1 + SLACK), t->au, t->ad, j, &x)) return 0;
    for (int i = 0; i < 3 && t->a0 != 0 && leaves_velocity(&x, t->v0, t->vmax); i++) {
        j = least(t->ju, t->jd);
        if (!cross(t, p)) break;
        if (!sj_ramp(t->v0, t->a0, v - t->v0, t->vmax * (1 + SLACK), t->au, t->ad, j, &x)) return 0;
    }
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
    for (int i = 0; i < head.count; i++)
        sj_put(p, (double)head.phase[i].cycles, head.phase[i].jerk);
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
    for (int i = 0; i < runup.count; i++)
        sj_put(p, (double)runup.phase[i].cycles, runup.phase[i].jerk);
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
