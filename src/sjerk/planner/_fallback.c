/* Ways that exist where no plan near the optimum does: the acceleration brought to zero first, or a
   stop, a plan from rest to rest, a wait of any duration and the run-up to the target's velocity. The
   last one always exists, so that a legal request is never refused.

   Each asks for a simpler task once (sj_move_direct), so there is no recursion.

   Never here: the choice of when they are needed (_plan.c). */
#include "planner/_internal.h"

/* Stop, rest to rest, wait if the plan is to last `duration` cycles, run-up: what always
   exists. */
int sj_by_stopping(const task *start, double duration, sj_plan *p)
{
    task t = *start, r;
    sj_plan head, runup;
    sj_begin(&head);
    sj_begin(&runup);
    if (!sj_go_to_velocity(&t, 0, &head))
        return 0;
    t = sj_resume(start, &head);
    t.v0 = t.a0 = 0;
    sj_append(p, &head);
    double v1 = t.v1;
    if (v1 != 0) {
        r = t;
        r.h = r.first = 0;
        if (!sj_go_to_velocity(&r, v1, &runup))
            return 0;
        t.h += r.h;
        t.v1 = 0;
    }
    if (!sj_move_direct(&t, p))
        return 0;
    double wait = duration - (double)(p->cycles + runup.cycles);
    if (wait < 0)
        return 0;
    if (wait < LONGEST)
        sj_put_cruise(p, &t, wait);
    sj_append(p, &runup);
    p->kind = SJ_PLAN_STOP;
    return 1;
}

/* Acceleration to zero first: serves where the velocity limit, a cycle ahead, leaves nothing
   else. */
static int by_ending_acceleration(const task *start, sj_plan *p)
{
    task t = *start;
    sj_plan q = *p;
    sj_end_acceleration(&t, &q);
    if (!sj_move_direct(&t, &q))
        return 0;
    *p = q;
    return 1;
}

/* Where sj_move_direct has failed. */
int sj_fallback(const task *start, sj_plan *p)
{
    return (start->a0 != 0 && by_ending_acceleration(start, p)) ||
           sj_by_stopping(start, INFINITY, p);
}
