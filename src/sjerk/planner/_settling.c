/* Settling: a start above its velocity limit, as left by limits that are lowered in motion.

   The velocity falls to the limit and arrives there without acceleration; then the motion goes on as
   any other. So it does not pass below the limit, and over a long way this is also the fastest: what
   a deeper fall loses is (the area of V_max - v) / V_max of time.

   Where the target is nearer than that ramp and the braking behind it, the ramp leads to a lower
   velocity, two bites of braking instead of one:
       ramp v0 -> v,   ramp v -> v1,   v between v1 and V_max.
   As v falls from V_max to v1 the distance of both falls, without a jump but for whole cycles, to that
   of one ramp v0 -> v1. So where that ramp fits at all there is such a v, by bisection, and the
   velocity never turns. Where it does not fit the motion must turn: then it brakes as fast as jerk
   allows, and the shortest plan follows.

   Whole cycles: the two bites of the next longer distance, and one bite with a cruise at v1 behind it
   that fills the same cycles, are combined (_convex.c). Both only brake, so every combination does.

   Never here: an acceleration that has to be recovered first (_recovery.c). */
#include "planner/_internal.h"

enum { SETTLING_STEPS = 20 };

/* ---- two bites ---- */

/* Adds the ramp to v to a path that ends at velocity from, without acceleration unless it is empty. */
int sj_add_ramp(const task *t, double from, double v, path *x)
{
    path r;
    double k = x->count > 0 ? x->k[x->count - 1] : 0, a = x->count > 0 ? 0 : t->a0;
    if (!sj_ramp(from, a, v - from, t->vmax, t->au, t->ad, v > from ? t->ju : t->jd, &r) ||
        x->count + r.count > NODES)
        return 0;
    for (int i = 0; i < r.count; i++)
        sj_node(x, k + r.k[i], r.a[i]);
    return 1;
}

/* Ramp to v, so many cycles of cruise, ramp to v1. With two jerks the acceleration must not change its
   sign in the first: zero on a node takes n (left + n J / 2) + left / 2 of the velocity. */
static int two_bites(const task *t, double v, double cruise, path *x)
{
    double n = whole(-t->a0 / t->jd), left = -t->a0 - n * t->jd;
    x->count = 0;
    if (t->ju != t->jd && t->v0 - v < n * (left + n * t->jd / 2) + left / 2)
        return 0;
    if (!sj_add_ramp(t, t->v0, v, x))
        return 0;
    sj_node(x, x->k[x->count - 1] + cruise, 0);
    return sj_add_ramp(t, v, t->v1, x);
}

static double path_cycles(const path *x) { return x->k[x->count - 1]; }

/* The two bites that get beyond h in the fewest cycles, by way of *v: of the limit, or of a lower
   velocity, between v1, whose one bite falls short of h, and the limit. */
static int beyond(const task *t, double *v, path *y)
{
    double low = t->v1, high = t->vmax;
    path x;
    *v = high;
    if (!two_bites(t, high, 0, y))
        return 0;
    double left = t->h - sj_path_distance(y, t->v0);
    if (left > 0)
        return left < high * LONGEST && two_bites(t, high, up(left / high), y);
    for (int i = 0; i < SETTLING_STEPS; i++) {
        double middle = low + (high - low) / 2;
        if (!two_bites(t, middle, 0, &x))
            return 0;
        if (sj_path_distance(&x, t->v0) < t->h) {
            low = middle;
            continue;
        }
        high = middle;
        if (path_cycles(&x) <= path_cycles(y)) {
            *v = high;
            *y = x;
        }
    }
    return 1;
}

/* The two bites of n cycles next to h, on both sides, by way of velocities up to `high`; x and y are
   such two. */
static void narrow(const task *t, double n, double high, path *x, path *y)
{
    double low = t->v1;
    path z;
    for (int i = 0; i < SETTLING_STEPS; i++) {
        double v = low + (high - low) / 2;
        if (!two_bites(t, v, 0, &z))
            return;
        double spare = n - path_cycles(&z);
        if (spare < 0 || !two_bites(t, v, spare, &z) || sj_path_distance(&z, t->v0) >= t->h) {
            high = v;
            if (spare >= 0)
                *y = z;
        } else {
            low = v;
            *x = z;
        }
    }
}

/* The whole move from above the limit, in `cycles`, or in the fewest: 0. Returns 0 where it must turn,
   or does not take so many. */
int sj_move_from_above(const task *start, double cycles, sj_plan *p)
{
    task t = start->v0 < 0 ? mirrored(start) : *start;
    path x, y;
    double v;
    if (!two_bites(&t, t.v1, 0, &x) || sj_path_distance(&x, t.v0) > t.h || !beyond(&t, &v, &y))
        return 0;
    double n = most(cycles, path_cycles(&y)), spare = n - path_cycles(&y);
    if ((cycles > 0 && n > cycles) || n < path_cycles(&x) || n >= LONGEST)
        return 0;
    sj_node(&x, n, 0);
    if (spare > 0) {
        if (!two_bites(&t, v, 0, &y) || !two_bites(&t, v, n - path_cycles(&y), &y))
            return 0;
        narrow(&t, n, v, &x, &y);
    }
    return sj_convex_of(&t, n, &x, &y, p);
}

/* ---- the ramp to the limit alone ---- */

/* Whether the ramp to v, and the one from there to v1, leave some of the way; *p is the first, *u what
   is left after it. */
static int leaves_way(const task *t, double v, task *u, sj_plan *p)
{
    path x;
    *u = *t;
    x.count = 0;
    if (!sj_go_to_velocity(u, v, p))
        return 0;
    return sj_add_ramp(u, v, t->v1, &x) && u->h >= sj_path_distance(&x, v);
}

/* Brakes as fast as jerk allows up to the first cycle inside. */
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
    task u, best;
    sj_plan q = *p, found = *p;
    if (leaves_way(t, high, &u, &q)) {
        *p = q;
        *t = u;
        return;
    }
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

/* Returns whether the acceleration can end on a node then. */
int sj_settle(task *t, sj_plan *p)
{
    int turned = t->v0 < 0;
    if (turned)
        *t = mirrored(t);
    settle(t, p);
    if (turned)
        *t = mirrored(t);
    return sj_lands(t);
}

/* A start outside its limits comes back as fast as jerk allows; its velocity does not pass below
   the limit where the way allows that. Returns whether its acceleration can end on a node then. */
int sj_recover(task *t, sj_plan *p)
{
    int lands = sj_recover_acceleration(t, p);
    return is_above(t) ? sj_settle(t, p) : lands;
}
