/* Plans from any state to any target, in whole control cycles, as soon as possible.

   A start outside its limits is brought back first (_recovery.c, _settling.c); then the methods that
   lead to the target at once are tried (_direct.c), and where they fail the one that always exists
   (_fallback.c).

   Frame: cycle = 1, position relative to the start; the task is turned so that its push is up.

   Never here: a duration that is given (_duration.c), how a method works, memory, clocks, statics,
   input or output, cycle time. */
#include "planner/_internal.h"

static int move(const task *start, sj_plan *p)
{
    return sj_move_direct(start, p) || sj_fallback(start, p);
}

/* A move, or a change of velocity where `ramp`, whose first acceleration would break the velocity
   limit if it ended on a node. The methods may cross zero by themselves; else a crossing comes first,
   the gentlest or the hardest, whichever is sooner. */
static int plan_crossing(const task *start, int ramp, sj_plan *p)
{
    sj_plan q = *p, r = *p;
    task t = *start;
    int64_t used = p->cycles;
    int ok = 0;
    if ((ramp ? sj_go_to_velocity(&t, t.v1, &q) : move(&t, &q)) &&
        !sj_leaves_velocity(start, &q, used)) {
        if (start->ju == start->jd || q.kind != SJ_PLAN_CONVEX) {
            *p = q;
            return 1;
        }
        ok = 1;
    }
    t = *start;
    if (!ok) {
        q = *p;
        sj_cross_gently(&t, &q);
        ok = ramp ? sj_go_to_velocity(&t, t.v1, &q) : move(&t, &q);
        t = *start;
    }
    if (sj_cross_hard(&t, &r) && (ramp ? sj_go_to_velocity(&t, t.v1, &r) : move(&t, &r)) &&
        (!ok || r.cycles < q.cycles)) {
        *p = r;
        return 1;
    }
    *p = q;
    return ok;
}

/* slip: how far the target moves on in a cycle in which it may be met, or 0. */
static int32_t plan_move(double h, double v0, double a0, double v1, const sj_limits *l, double slip,
                         sj_plan *p)
{
    sj_begin(p);
    if (!sj_valid(h, v0, a0, v1, l))
        return SJ_PLAN_INVALID;
    task t = sj_task_of(h, v0, a0, v1, l);
    t.slip = t.sign * slip;
    int lands = sj_recover_acceleration(&t, p), above = is_above(&t);
    int ok = above && sj_move_from_above(&t, 0, p);
    int back = above || p->count > 0 ? SJ_PLAN_RECOVERY : 0;
    if (!ok) {
        if (above)
            lands = sj_settle(&t, p);
        ok = lands ? move(&t, p) : plan_crossing(&t, 0, p);
    }
    p->kind += back;
    sj_note_scale(p, l);
    return ok ? SJ_PLAN_OK : SJ_PLAN_TOO_LONG;
}

int32_t sj_plan_move(double h, double v0, double a0, double v1, const sj_limits *l, sj_plan *p)
{
    return plan_move(h, v0, a0, v1, l, 0, p);
}

int32_t sj_plan_meeting(double h, double v0, double a0, double v1, const sj_limits *l, sj_plan *p)
{
    return plan_move(h, v0, a0, v1, l, v1, p);
}

int32_t sj_plan_velocity(double v0, double a0, double v1, const sj_limits *l, sj_plan *p)
{
    sj_begin(p);
    if (!sj_valid(0, v0, a0, v1, l))
        return SJ_PLAN_INVALID;
    task t = sj_task_of(0, v0, a0, v1, l);
    int lands = sj_recover_acceleration(&t, p), back = p->count > 0 ? SJ_PLAN_RECOVERY : 0;
    if (!(lands ? sj_go_to_velocity(&t, t.v1, p) : plan_crossing(&t, 1, p)))
        return SJ_PLAN_TOO_LONG;
    p->kind = SJ_PLAN_RAMP + back;
    sj_note_scale(p, l);
    return SJ_PLAN_OK;
}
