/* Settling: a start above its velocity limit, as left by limits that are lowered in motion.

   The velocity falls to the limit and arrives there without acceleration; the rest is a plan from a
   start that keeps its limits. So it does not pass below the limit, and over a long way this is also
   the fastest: what a deeper fall loses is (the area of V_max - v) / V_max of time.

   Where the target is nearer than that ramp and the braking behind it, the ramp leads to a lower
   velocity, two bites of braking instead of one:
       ramp v0 -> v,   ramp v -> v1,   v between v1 and V_max.
   As v falls from V_max to v1 the distance of both falls, without a jump but for whole cycles, to that
   of one ramp v0 -> v1. So where that ramp fits at all there is such a v, by bisection, and the
   velocity never turns. Where it does not fit the motion must turn: then it brakes as fast as jerk
   allows, and the shortest plan follows.

   Never here: an acceleration that has to be recovered first (_recovery.c), what follows. */
#include "planner/_internal.h"

enum { SETTLING_STEPS = 20 }; /* what they leave of the way is driven at the velocity found */

/* Whether the ramp to v, and the one from there to v1, leave some of the way; *p is the first, *u what
   is left after it. */
static int leaves_way(const task *t, double v, task *u, sj_plan *p)
{
    path x;
    int falls = v >= t->v1;
    *u = *t;
    if (!sj_go_to_velocity(u, v, p))
        return 0;
    if (!sj_ramp(v, 0, t->v1 - v, -1, t->au, t->ad, falls ? t->jd : t->ju, &x))
        return 0;
    return u->h >= sj_path_distance(&x, v);
}

/* Too near for any: brakes as fast as jerk allows up to the first cycle inside. */
static void brake_to_velocity(task *t, sj_plan *p)
{
    double top = t->vmax * (1 + SLACK / 2), v = t->v0;
    path x;
    if (!sj_ramp(v, t->a0, -t->vmax - v, -1, t->au, t->ad, t->jd, &x))
        return;
    sj_plan q;
    sj_begin(&q);
    for (int i = 1; i < x.count; i++) {
        double a = x.a[i - 1], m = x.k[i] - x.k[i - 1], jerk = (x.a[i] - a) / m, lo = 0, hi = m;
        if (v + m * (a + m * jerk / 2) <= top) {
            for (int s = 0; s < 64 && hi - lo > 1; s++) {
                double mid = whole((lo + hi) / 2);
                if (v + mid * (a + mid * jerk / 2) <= top)
                    hi = mid;
                else
                    lo = mid;
            }
            sj_put(&q, hi, t->sign * jerk);
            break;
        }
        sj_put(&q, m, t->sign * jerk);
        v += m * (a + m * jerk / 2);
    }
    *t = sj_resume(t, &q);
    sj_append(p, &q);
}

/* From above the limit and no longer speeding up. */
static void settle(task *t, sj_plan *p)
{
    double low = t->v1, high = t->vmax;
    task u;
    sj_plan q = *p, found = *p;
    if (leaves_way(t, high, &u, &q)) {
        *p = q;
        *t = u;
        return;
    }
    task best;
    if (!leaves_way(t, low, &best, &found)) {
        brake_to_velocity(t, p);
        return;
    }
    for (int i = 0; i < SETTLING_STEPS; i++) {
        double v = low + (high - low) / 2;
        q = *p;
        if (leaves_way(t, v, &u, &q)) {
            low = v;
            found = q;
            best = u;
        } else
            high = v;
    }
    *p = found;
    *t = best;
}

/* A start outside its limits comes back as fast as jerk allows; its velocity does not pass below
   the limit where the way allows that. Returns whether its acceleration can end on a node then. */
int sj_recover(task *t, sj_plan *p)
{
    int lands = sj_recover_acceleration(t, p);
    if (!(fabs(t->v0) > t->vmax * (1 + SLACK)) || t->v0 * t->a0 > 0)
        return lands;
    if (t->v0 > 0)
        settle(t, p);
    else {
        *t = mirrored(t);
        settle(t, p);
        *t = mirrored(t);
    }
    return sj_lands(t);
}
