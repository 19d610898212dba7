/* Ramp, cruise, ramp of several rows at once, for plan_many: nearly every row is planned so.

   A plan waits for its divisions and square roots one after the other, so that SJ_LANES rows take little
   longer than one. Here are the operations of sj_plan_move() on the way of such a plan, in the same order,
   hence the same bits: _plan.c, begin_attempt() of _direct.c, sj_by_cruise() of _seven.c. Where they branch,
   both ways are computed and one is taken. A quotient of which only one way is taken is divided once, with
   its numbers chosen before.

   A lane that leaves this way (a start outside its limits, an eased braking, a convex combination, counts
   that a double cannot round, ...) says so by `ok`, and its row is planned by itself.

   Never here: a method of its own. */
#include "base/_simd.h"          /* several rows at once */
#include "planner/_lanes_peak.h" /* in continuous time */

/* sj_even_counts(). A count that cannot be rounded is left to others. */
INLINE int even_counts(double x, double z, double amax, double jerk, double *rise, double *hold)
{
    double share = z / jerk, fewest = most(1, lower(share));
    double r = fewest + 1, level0 = least(amax, fewest * jerk), level1 = least(amax, r * jerk);
    double c0 = x / level0 + fewest, c1 = x / level1 + r;
    double m0 = most(2 * fewest, upper(c0)), m1 = most(2 * r, upper(c1));
    int more = m1 < m0;
    *rise = pick(more, r, fewest);
    *hold = pick(more, m1 - 2 * r, m0 - 2 * fewest);
    return (share < roundable) & (c0 < roundable) & (c1 < roundable);
}

/* sj_ramp_counts() with a0 != 0. */
typedef struct {
    lane f, g, more, j1, best, n1, n2, n3, ok;
} tried_counts;

/* One pair of lengths, taken if it is better than those before. */
INLINE void try_counts(const lanes *m, tried_counts *t, double k1, double k3)
{
    EACH_LANE(i)
    {
        double a0 = m->a0[i], x = m->peak[i] - m->v0[i], r1 = t->g[i] + k1, r3 = t->f[i] + k3;
        double level = least(m->au[i], least(r3 * m->ju[i], a0 + r1 * t->j1[i]));
        double c = (x - 0.5 * r1 * a0) / level + 0.5 * (r1 + r3);
        double sum = most(r1 + r3, upper(c));
        sum = pick(level > 0, sum, INFINITY);
        sum = k3 < 0 ? pick(t->more[i] > 0, sum, INFINITY) : sum;
        int better = sum < t->best[i];
        t->n1[i] = pick(better, r1, t->n1[i]);
        t->n3[i] = pick(better, r3, t->n3[i]);
        t->n2[i] = pick(better, sum - r1 - r3, t->n2[i]);
        t->best[i] = pick(better, sum, t->best[i]);
        t->ok[i] = pick(pick(level > 0, c, 0.0) >= roundable, 0.0, t->ok[i]);
    }
}

INLINE void ramp_counts(lanes *m)
{
    tried_counts t;
    EACH_LANE(i)
    {
        double ju = m->ju[i], a0 = m->a0[i], j1 = pick(a0 < 0, least(ju, m->jd[i]), ju);
        double f = m->z1[i] / ju, g = (m->z1[i] - a0) / j1;
        double f0 = most(1, lower(f)), g0 = most(1, lower(g));
        t.more[i] = pick(g < 1, pick(f0 > 1, 1.0, 0.0), 0.0);
        t.ok[i] = pick(size(f) < roundable, pick(size(g) < roundable, 1.0, 0.0), 0.0);
        t.j1[i] = j1;
        t.f[i] = f0;
        t.g[i] = g0;
        t.n1[i] = t.n3[i] = 1;
        t.n2[i] = 0;
        t.best[i] = INFINITY;
    }
    for (int k = 0; k < 2; k++) {
        if (some(t.more))
            try_counts(m, &t, k, -1);
        try_counts(m, &t, k, 0);
        try_counts(m, &t, k, 1);
    }
    EACH_LANE(i)
    {
        int bent = m->a0[i] != 0;
        m->n1[i] = pick(bent, t.n1[i], m->n1[i]);
        m->n2[i] = pick(bent, t.n2[i], m->n2[i]);
        m->n3[i] = pick(bent, t.n3[i], m->n3[i]);
        m->ok[i] = pick(bent, t.ok[i] * m->ok[i], m->ok[i]);
    }
}

/* sj_by_cruise(): the optimum. */
INLINE void time_ramps(lanes *m)
{
    EACH_LANE(i)
    {
        double v = m->peak[i], v1 = m->v1[i], vmax = m->vmax[i];
        double au = m->au[i], ju = m->ju[i], ad = m->ad[i], jd = m->jd[i];
        int cruise = m->at_top[i] <= m->h[i];
        double t4 = pick(cruise, (m->h[i] - m->at_top[i]) / vmax, 0);
        double x1 = most(0, v - m->vs[i]), x2 = most(0, v - v1);
        double z1 = sqrt(x1 * ju), z2 = sqrt(x2 * jd);
        int flat1 = z1 > au, flat2 = z2 > ad;
        double t1 = pick(flat1, x1, 2 * z1) / pick(flat1, au, ju);
        double t2 = pick(flat2, x2, 2 * z2) / pick(flat2, ad, jd);
        m->z1[i] = pick(flat1, au, z1);
        m->z2[i] = pick(flat2, ad, z2);
        t1 = pick(flat1, t1 + m->up[i], t1);
        t2 = pick(flat2, t2 + m->down[i], t2);
        double optimum = m->t0[i] + t1 + t4 + t2;
        m->optimum[i] = optimum;
        m->ok[i] = pick(optimum < roundable, m->ok[i], 0.0);
    }
}

/* sj_by_cruise(): the counts of both ramps. */
INLINE void count_ramps(lanes *m, int still)
{
    EACH_LANE(i)
    {
        int ok =
            even_counts(m->peak[i] - m->v1[i], m->z2[i], m->ad[i], m->jd[i], &m->n5[i], &m->n6[i]);
        m->ok[i] = pick(ok, m->ok[i], 0.0);
    }
    EACH_LANE(i)
    {
        double n1, n2, bent = pick(m->a0[i] != 0, 1.0, 0.0);
        int ok = even_counts(m->peak[i] - m->v0[i], m->z1[i], m->au[i], m->ju[i], &n1, &n2);
        m->n1[i] = n1;
        m->n2[i] = n2;
        m->n3[i] = n1;
        m->ok[i] = pick(ok, m->ok[i], bent * m->ok[i]);
    }
    if (!still)
        ramp_counts(m);
}

/* sj_by_cruise(): the cycles of cruise. */
INLINE void count_cruise(lanes *m)
{
    EACH_LANE(i)
    {
        double v = m->peak[i], a0 = m->a0[i], v0 = m->v0[i], v1 = m->v1[i];
        double n1 = m->n1[i], n2 = m->n2[i], n3 = m->n3[i];
        double m1 = n1 + n2 + n3, m2 = 2 * m->n5[i] + m->n6[i];
        double c = 0.5 * (n1 + n3) + n2, a = (v - v0 - 0.5 * n1 * a0) / c;
        double d1 = v0 * m1 + a0 * n1 * (0.5 * (n2 + n3) + n1 / 3) +
                    a * (n1 * (0.5 * (n2 + n3) + n1 / 6) + n2 * (n3 + 0.5 * n2) + n3 * n3 / 3);
        double rest = (m->h[i] - d1 - 0.5 * (v + v1) * m2) / v;
        int cruises = v > 0;
        m->n4[i] = pick(cruises, most(0, upper(rest)), 0);
        m->ok[i] = pick(cruises & (size(rest) >= roundable), 0.0, m->ok[i]);
    }
}

INLINE double per_level(double n1, double n2, double n3) { return 1 / (0.5 * (n1 + n3) + n2); }

/* sj_seven_fit() of these counts: 1 or 0, and the velocity and level; c = per_level(n1, n2, n3). */
typedef struct {
    int fits;
    double v, a;
} fitted;

INLINE fitted fit(const lanes *m, int32_t i, double c, double n1, double n2, double n3, double n4,
                  double n5, double n6, int still)
{
    double v0 = m->v0[i], a0 = m->a0[i], v1 = m->v1[i], vmax = m->vmax[i];
    double au = m->au[i], ju = m->ju[i], ad = m->ad[i], jd = m->jd[i];
    double r2 = n5 + n6, m1 = n1 + n2 + n3, m2 = r2 + n5;
    double q = 0.5 * m1, rest = m->h[i];
    int uneven = (a0 != 0.0) | (n1 != n3);
    double q1 =
        (n1 * (0.5 * (n2 + n3) + n1 * (1.0 / 6)) + n2 * (n3 + 0.5 * n2) + n3 * n3 * (1.0 / 3)) * c;
    q = pick(uneven, q1, q);
    rest = pick(uneven, rest - a0 * n1 * (0.5 * (n2 + n3 - q1) + n1 * (1.0 / 3)), rest);
    double v = (rest - v0 * (m1 - q) - v1 * (0.5 * m2)) / (q + n4 + 0.5 * m2);
    double a = (v - v0 - 0.5 * n1 * a0) * c, w = v - v1;
    const double one = 1 + 4 * SLACK;
    double lim = pick(w >= 0, least(ad, n5 * jd), least(au, n5 * ju));
    double amax = pick(a >= 0, au, ad), jerk = pick(a >= 0, ju, jd);
    int ok = (size(v) <= vmax * one) & (size(w) <= lim * r2 * one) &
             (size(a) <= one * least(amax, n3 * jerk));
    double j0 = pick(a0 > 0, ju, pick(a0 < 0, jd, jerk));
    int along = size(a - a0) <= one * n1 * j0;
    if (!still) {
        double turn = v0 + 0.5 * a0 * a0 * n1 / (a0 - a);
        int across = (size(a - a0) <= one * n1 * least(ju, jd)) & (size(turn) <= vmax * one);
        int same = a * a0 >= 0;
        along = (same & along) | ((same ^ 1) & across);
    }
    return (fitted){ok & along, v, a};
}

/* sj_by_cruise(): the first fit, with up to two more cycles of cruise. */
INLINE void first_fit(lanes *m, int still)
{
    lane missed;
    EACH_LANE(i)
    {
        double c = per_level(m->n1[i], m->n2[i], m->n3[i]);
        fitted f = fit(m, i, c, m->n1[i], m->n2[i], m->n3[i], m->n4[i], m->n5[i], m->n6[i], still);
        m->c[i] = c;
        m->v[i] = f.v;
        m->a[i] = f.a;
        missed[i] = pick(f.fits, 0.0, m->ok[i]);
    }
    for (int more = 0; more < 2 && some(missed); more++)
        EACH_LANE(i)
        {
            int tried = missed[i] > 0;
            double n4 = m->n4[i] + pick(tried, 1.0, 0.0);
            fitted f =
                fit(m, i, m->c[i], m->n1[i], m->n2[i], m->n3[i], n4, m->n5[i], m->n6[i], still);
            m->v[i] = pick(tried, f.v, m->v[i]);
            m->a[i] = pick(tried, f.a, m->a[i]);
            m->n4[i] = n4;
            missed[i] = pick(f.fits, 0.0, missed[i]);
        }
    EACH_LANE(i)
    m->ok[i] = pick(missed[i] > 0, 0.0, m->ok[i]);
}

/* One way of taking a cycle away: what each count loses. */
typedef struct {
    double n1, n2, n3, n4, n5, n6;
} loss;

/* For the lanes that look for a way and have not found it, where this count is above so many: sets `left` to
   nothing in those that it serves. */
INLINE void take_away(lanes *m, lane left, const double *of, double more_than, loss by, int still)
{
    lane wants;
    EACH_LANE(i)
    wants[i] = pick(of[i] > more_than, left[i], 0.0);
    if (!some(wants))
        return;
    EACH_LANE(i)
    {
        double n1 = m->n1[i] - by.n1, n2 = m->n2[i] - by.n2, n3 = m->n3[i] - by.n3;
        double n4 = m->n4[i] - by.n4, n5 = m->n5[i] - by.n5, n6 = m->n6[i] - by.n6;
        double c = by.n1 + by.n2 + by.n3 > 0 ? per_level(n1, n2, n3) : m->c[i];
        fitted f = fit(m, i, c, n1, n2, n3, n4, n5, n6, still);
        int yes = f.fits & (wants[i] > 0);
        m->n1[i] = pick(yes, n1, m->n1[i]);
        m->n2[i] = pick(yes, n2, m->n2[i]);
        m->n3[i] = pick(yes, n3, m->n3[i]);
        m->n4[i] = pick(yes, n4, m->n4[i]);
        m->n5[i] = pick(yes, n5, m->n5[i]);
        m->n6[i] = pick(yes, n6, m->n6[i]);
        m->v[i] = pick(yes, f.v, m->v[i]);
        m->a[i] = pick(yes, f.a, m->a[i]);
        m->more[i] = pick(yes, 1.0, m->more[i]);
        left[i] = pick(yes, 0.0, left[i]);
    }
}

/* seven_shorten(), its first round. */
INLINE void shorten(lanes *m, int still)
{
    lane left;
    EACH_LANE(i)
    {
        double cycles = m->n1[i] + m->n2[i] + m->n3[i] + m->n4[i] + 2 * m->n5[i] + m->n6[i];
        m->least_cycles[i] = upper(m->optimum[i]);
        m->more[i] = 0.0;
        left[i] = pick(cycles - m->least_cycles[i] >= 1, m->ok[i], 0.0);
    }
    if (!some(left))
        return;
    take_away(m, left, m->n4, 0, (loss){.n4 = 1}, still);
    take_away(m, left, m->n2, 0, (loss){.n2 = 1}, still);
    take_away(m, left, m->n6, 0, (loss){.n6 = 1}, still);
    take_away(m, left, m->n1, 1, (loss){.n1 = 1}, still);
    take_away(m, left, m->n3, 1, (loss){.n3 = 1}, still);
    take_away(m, left, m->n5, 1, (loss){.n5 = 1, .n6 = -1}, still);
}

/* Where sj_move_direct() looks for a convex combination first. */
INLINE void leave_convex(lanes *m)
{
    EACH_LANE(i)
    {
        double most_short = -m->a0[i] / m->jd[i] * most(m->v0[i], -m->v1[i]);
        int leaves = (m->a0[i] < 0) & (m->v1[i] < 0) & (m->direct[i] > 0) &
                     (m->optimum[i] > m->direct[i] + 2) & (m->short_of[i] <= most_short);
        m->ok[i] = pick(leaves, 0.0, m->ok[i]);
    }
}

INLINE void plan_lanes(lanes *m, int still, int one_jerk)
{
    begin(m);
    first_family(m);
    if (some(m->active))
        second_family(m);
    else
        EACH_LANE(i)
    m->direct[i] = m->short_of[i] = 0.0;
    begin_peak(m);
    if (some(m->active)) {
        lane root;
        EACH_LANE(i)
        root[i] = m->active[i];
        guess_peak(m, one_jerk);
        for (int step = 0; step < NEWTON_STEPS && some(m->active); step++)
            step_peak(m);
        EACH_LANE(i)
        m->peak[i] = pick(root[i] > 0, m->base[i] + m->z[i] * m->z[i] * m->per_jb[i], m->peak[i]);
    }
    time_ramps(m);
    count_ramps(m, still);
    count_cruise(m);
    first_fit(m, still);
    shorten(m, still);
    if (!still)
        leave_convex(m);
}

SIMD static void run_still(lanes *m) { plan_lanes(m, 1, 1); }
SIMD static void run_moving(lanes *m) { plan_lanes(m, 0, 1); }
SIMD static void run_any(lanes *m) { plan_lanes(m, 0, 0); }

/* Plans these rows; rows[i] of them: whether it could, its task, and its seven phases. */
void sj_lanes_plan(int32_t n, const sj_request *r, const sj_limits *limits, int64_t step,
                   lane_plan *out)
{
    lanes m;
    int still = 1, one = 1;
    for (int32_t i = 0; i < SJ_LANES; i++) {
        int32_t k = i < n ? i : 0;
        const sj_limits *l = limits + k * step;
        m.h[i] = r[k].distance;
        m.v0[i] = r[k].v0;
        m.a0[i] = r[k].a0;
        m.v1[i] = r[k].v1;
        m.vmax[i] = l->velocity;
        m.au[i] = l->acceleration;
        m.ju[i] = l->jerk;
        m.ad[i] = l->deceleration;
        m.jd[i] = l->deceleration_jerk;
        still &= r[k].a0 == 0;
        one &= (l->acceleration == l->deceleration) & (l->jerk == l->deceleration_jerk);
    }
    if (!one)
        run_any(&m);
    else if (still)
        run_still(&m);
    else
        run_moving(&m);
    for (int32_t i = 0; i < n; i++) {
        lane_plan *made = &out[i];
        made->t = (task){m.h[i],  m.v0[i], m.a0[i], m.v1[i],   m.vmax[i],  m.au[i],
                         m.ju[i], m.ad[i], m.jd[i], m.sign[i], m.first[i], 0};
        made->s = (seven){m.n1[i], m.n2[i], m.n3[i], m.n4[i], m.n5[i], m.n6[i], m.v[i], m.a[i]};
        if (m.more[i] > 0)
            sj_seven_shorten(&made->t, &made->s, m.least_cycles[i], 1);
        /* the plan is as short as sj_move_direct() asks for */
        made->ok = m.ok[i] > 0 &&
                   !(seven_cycles(&made->s) > most(1, m.least_cycles[i]) + (m.a0[i] == 0 ? 3 : 2));
    }
}
