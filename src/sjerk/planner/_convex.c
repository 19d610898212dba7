/* Plans of exactly n cycles: the convex combination of two that are known.

   Take all sequences of accelerations of n cycles, from the given start, that keep the limits.
   Two properties of this set decide everything.

   It is convex. Each limit holds an acceleration, a difference of two accelerations or a sum of them
   (a velocity) in an interval, at every cycle. If x and y are in all these intervals, so is
       z = (1 - lambda) x + lambda y,   0 <= lambda <= 1.
   And where a sequence ends, position and velocity, is linear in it. If x and y both end at (v1, 0),
   z does too, and its position is (1 - lambda) p(x) + lambda p(y).

   So a target between p(x) and p(y) is met with one division,
       lambda = (h - p(x)) / (p(y) - p(x)),
   and nothing has to be checked. Both sequences have n cycles: a target that moves is no special
   case. For x and y the two extremes are taken, the one that gets least far and the one that gets
   furthest (_extreme.c). Then the converse holds as well: if h is not between them, no plan of n
   cycles exists (up to the velocity limit, which the extremes meet to within a cycle), and a longer
   one has to be tried.

   With two jerks the set is not convex: the larger jerk is legal only while the acceleration has one
   sign. The sequences with the same sign in every cycle are a convex set again. So there a chain of
   four is used, each two neighbours with the same signs (_sides.c). Where none serves, all cycles
   keep the smaller jerk, which is legal everywhere.

   A target that moves on may slip: within a cycle it is further on its line, h + slip at most. Then a
   duration serves where any of that line lies between the extremes, and the nearest of it is met.

   Never here: anything but a given duration; the search for one is sj_convex_from alone. */
#include "planner/_internal.h"

static double path_at(const path *x, int *i, double k)
{
    while (*i < x->count - 2 && x->k[*i + 1] < k)
        ++*i;
    double n = x->k[*i + 1] - x->k[*i];
    return x->a[*i] + (x->a[*i + 1] - x->a[*i]) * ((k - x->k[*i]) / n);
}

/* Rounding of a distance; in the last few cycles, which leave no freedom, also what a long plan
   left over. */
static double distance_room(const task *t, double n, double p)
{
    return 2.5e-13 * (fabs(p) + fabs(t->h)) + (n <= 4 ? 3e-11 * (fabs(t->v0) + fabs(t->v1)) : 0);
}

/* z = x + lambda (y - x) at every cycle, which lands on h: x falls short of it, y gets beyond.
       lambda = (h - px) / (py - px)
   The nodes of z are those of x and of y. */
static void combine(const task *t, double h, double n, const path *x, double px, const path *y,
                    double py, path *z)
{
    int ix = 0, iy = 0, gx = 0, gy = 0;
    double lambda = py > px ? most(0, least(1, (h - px) / (py - px))) : 0;
    z->count = 0;
    while (ix < x->count || iy < y->count) {
        double k = ix < x->count ? x->k[ix] : n;
        if (iy < y->count)
            k = least(k, y->k[iy]);
        double ax = path_at(x, &gx, k), ay = path_at(y, &gy, k);
        if (z->count < NODES)
            sj_node(z, k, k <= 0 ? t->a0 : k >= n ? x->a[x->count - 1] : ax + lambda * (ay - ax));
        while (ix < x->count && x->k[ix] <= k)
            ix++;
        while (iy < y->count && y->k[iy] <= k)
            iy++;
    }
}

/* What the roots of the extremes left of velocity and distance is taken up by two levels, where that
   is far below what the limits are kept to: the one with the widest neighbourhood on each side of
   the middle. */
static void polish(const task *t, double h, path *z)
{
    int at[2] = {0, 0}, middle = z->count / 2;
    double width[2] = {0, 0}, reach[2], slope[2];
    for (int i = 1; i + 1 < z->count; i++) {
        double w = (z->k[i + 1] - z->k[i - 1]) / 2;
        int s = i >= middle;
        if (z->a[i] != 0 && w > width[s]) {
            width[s] = w;
            at[s] = i;
        }
    }
    if (!at[0] || !at[1])
        return;
    double end = z->k[z->count - 1];
    for (int s = 0; s < 2; s++) {
        const double *k = &z->k[at[s]];
        reach[s] = end - (k[-1] + k[0] + k[1]) / 3;
        slope[s] = 1 / least(k[0] - k[-1], k[1] - k[0]);
    }
    double dv = t->v1 - t->v0 - sj_path_change(z), dp = h - sj_path_distance(z, t->v0);
    double later = (dp - reach[0] * dv) / (reach[1] - reach[0]);
    double change[2] = {(dv - later) / width[0], later / width[1]};
    const double room = 4 * SLACK;
    for (int s = 0; s < 2; s++) {
        double level = room * (z->a[at[s]] > 0 ? t->au : t->ad);
        if (!(fabs(change[s]) <= least(level, room * smaller_jerk(t) / slope[s])))
            return;
    }
    for (int s = 0; s < 2; s++)
        z->a[at[s]] += change[s];
}

static int convex_put(const task *t, double h, path *z, sj_plan *p)
{
    if (p->count + z->count > SJ_PHASES)
        return 0;
    polish(t, h, z);
    sj_path_put(p, z, t);
    p->kind = SJ_PLAN_CONVEX;
    p->slipped = t->sign * (h - t->h);
    return 1;
}

/* Two paths of n cycles that the caller knows: x falls short of h, y gets beyond. */
int sj_convex_of(const task *t, double n, const path *x, const path *y, sj_plan *p)
{
    double px = sj_path_distance(x, t->v0), py = sj_path_distance(y, t->v0);
    double room = distance_room(t, n, t->h);
    path z;
    if (px > t->h + room || py < t->h - room)
        return 0;
    combine(t, t->h, n, x, px, y, py, &z);
    return convex_put(t, t->h, &z, p);
}

/* Whether a path that gets at least so far passes a target, which may slip; and one that gets at most so far. */
static int passes(const task *t, double low, double room)
{
    return low > t->h + most(0, t->slip) + room;
}
static int misses(const task *t, double far, double room)
{
    return far < t->h + least(0, t->slip) - room;
}
/* The target that is met between them: the one asked, or the nearest on the line on which it moves. */
static double target_met(const task *t, double low, double far)
{
    return t->slip != 0 ? most(low, least(far, t->h)) : t->h;
}

/* Exactly n cycles: the convex combination of the two extremes (one jerk limit: the smaller). */
static int combine_extremes(const task *t, double j, double n, double *nearest, summit *m,
                            sj_plan *p)
{
    path x, y, z;
    double px = 0, py = 0;
    /* where the last duration fell short of being low enough, look at the low one first */
    int low_first = *nearest > -INFINITY;
    for (int i = 0; i < 2; i++) {
        if ((i == 0) == low_first) {
            task o = mirrored(t);
            if (!sj_furthest(&o, j, n, &m[1], &x))
                return 0;
            for (int k = 0; k < x.count; k++)
                x.a[k] = -x.a[k];
            px = sj_path_distance(&x, t->v0);
            if (passes(t, px, distance_room(t, n, px))) {
                *nearest = px;
                return 0;
            }
        } else {
            if (!sj_furthest(t, j, n, &m[0], &y))
                return 0;
            py = sj_path_distance(&y, t->v0);
            if (misses(t, py, distance_room(t, n, py))) {
                *nearest = py;
                return 0;
            }
        }
    }
    double h = target_met(t, px, py);
    combine(t, h, n, &x, px, &y, py, &z);
    return convex_put(t, h, &z, p);
}

/* Exactly n cycles under two jerks. The paths to combine lie in a chain, each two neighbours with the
   same signs: furthest up, up without coming back, down without coming back, furthest down. */
static int combine_sides(const task *t, double n, double *nearest, summit *m, sj_plan *p)
{
    path up_far, up_near, down_far, down_near, z;
    double far = INFINITY, near = 0, low = -INFINITY, below = 0, h;
    double room = distance_room(t, n, t->h);
    /* where the last duration fell short of being low enough, look at the low ones first */
    int low_first = *nearest > -INFINITY;
    for (int i = 0; i < 2; i++)
        if ((i == 0) == low_first) {
            task o = mirrored(t);
            int ok = sj_side_paths(&o, n, &down_near, &down_far);
            if (ok == 0)
                return 0;
            if (ok < 0)
                return combine_extremes(t, smaller_jerk(t), n, nearest, m, p);
            for (int k = 0; k < down_far.count; k++)
                down_far.a[k] = -down_far.a[k];
            for (int k = 0; k < down_near.count; k++)
                down_near.a[k] = -down_near.a[k];
            low = sj_path_distance(&down_far, t->v0);
            below = sj_path_distance(&down_near, t->v0);
            if (passes(t, low, room)) {
                *nearest = low;
                return 0;
            }
            h = target_met(t, low, far);
            if (below >= h) {
                combine(t, h, n, &down_far, low, &down_near, below, &z);
                return convex_put(t, h, &z, p);
            }
        } else {
            int ok = sj_side_paths(t, n, &up_near, &up_far);
            if (ok == 0)
                return 0;
            if (ok < 0)
                return combine_extremes(t, smaller_jerk(t), n, nearest, m, p);
            far = sj_path_distance(&up_far, t->v0);
            near = sj_path_distance(&up_near, t->v0);
            if (misses(t, far, room)) {
                *nearest = far;
                return 0;
            }
            h = target_met(t, low, far);
            if (near <= h) {
                combine(t, h, n, &up_near, near, &up_far, far, &z);
                return convex_put(t, h, &z, p);
            }
        }
    h = target_met(t, low, far);
    combine(t, h, n, &down_near, below, &up_near, near, &z);
    return convex_put(t, h, &z, p);
}

int sj_convex(const task *t, double n, double *nearest, summit *m, sj_plan *p)
{
    if (!(n >= 1 && n < 67108864.0))
        return 0;
    return t->ju == t->jd ? combine_extremes(t, t->ju, n, nearest, m, p)
                          : combine_sides(t, n, nearest, m, p);
}

/* The first duration from n on that serves, below `longest`; gives up where waiting longer only leads
   away. A duration that is too short shows how many cycles at the velocity limit are missing at
   least: (h - nearest) / vmax. */
int sj_convex_from(const task *t, double *n, double longest, summit *m, sj_plan *p)
{
    double last = INFINITY, at = 0;
    for (int i = 0; i < DURATION_STEPS && *n < longest; i++) {
        double nearest = last < INFINITY ? last : -INFINITY, before = nearest, step = 1;
        if (sj_convex(t, *n, &nearest, m, p))
            return 1;
        if (nearest > last)
            return 0;
        if (nearest != before) {
            if (nearest < t->h)
                step = up((t->h - nearest) / t->vmax);
            else {
                /* blocked from above, but coming down ever faster: a part of the cycles at once */
                if (last < INFINITY && t->ju != t->jd) {
                    step = down(0.6 * (nearest - t->h) / (last - nearest) * (*n - at));
                    step = least(step, least(4, whole(*n / 16)));
                }
                last = nearest;
                at = *n;
            }
        }
        *n += most(1, step);
    }
    return 0;
}
