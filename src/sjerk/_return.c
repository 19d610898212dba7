/* The way back inside: a start outside its limits, or carried out of them by its acceleration,
   brakes as fast as jerk allows until the first node from which every limit can be kept. And the
   acceleration brought to zero, which the return has to foresee.

   Only phases are laid down here, with full jerk; a cycle that crosses zero has the smaller of two
   jerks.

   Never here: a distance to be met, a target. */
#include "_plan.h"

/* Jerk of a cycle that takes the acceleration from `left` across zero. */
static double crossing_jerk(const task *t, double left)
{
    return least(least(t->ju, t->jd), left + (t->a0 > 0 ? t->ad : t->au));
}

/* Highest velocity (for a0 > 0, in its direction) on the way to zero acceleration in whole cycles:
   n of full jerk leave `left`, and the last one either ends at zero or crosses it with the smaller
   jerk. */
static double carried(const task *t, double *n, double *left, int *cross)
{
    double a = fabs(t->a0), j = t->a0 > 0 ? t->ju : t->jd, d = t->a0 > 0 ? 1 : -1;
    *n = whole(a / j);
    *left = a - *n * j;
    if (*left <= 1e-13 * a) *left = 0;
    double small = crossing_jerk(t, *left);
    double v = t->v0 + d * *n * (a - *n * j / 2), landed = v + d * *left / 2;
    *cross = fabs(landed) > t->vmax * (1 + SLACK / 2) && v * d > 0 && *left < small;
    return *cross ? v + d * *left * *left / (2 * small) : landed;
}

/* Acceleration to zero, or across it in the last cycle where ending at zero would break the
   velocity limit. */
void sj_shed(task *t, sj_plan *p)
{
    double n, left, d = t->a0 > 0 ? t->sign : -t->sign, j = t->a0 > 0 ? t->ju : t->jd;
    int cross;
    sj_plan q;
    sj_begin(&q);
    carried(t, &n, &left, &cross);
    sj_put(&q, n, -d * j);
    if (left > 0) sj_put(&q, 1, -d * (cross ? crossing_jerk(t, left) : left));
    *t = sj_resume(t, &q);
    if (!cross) t->a0 = 0;
    for (int i = 0; i < q.count; i++) sj_put(p, (double)q.phase[i].cycles, q.phase[i].jerk);
}

/* A start above the velocity limit, or carried over it: brakes as fast as jerk allows until it is
   inside. */
static void come_down(task *t, sj_plan *p)
{
    double n, left, top = t->vmax * (1 + SLACK / 2);
    int cross;
    double reached = carried(t, &n, &left, &cross);
    /* it falls through: the other side's concern */
    if (t->a0 < 0 && reached < -t->vmax * (1 + SLACK)) return;
    if (!((t->a0 > 0 ? reached : t->v0) > t->vmax * (1 + SLACK))) return;
    sj_plan q;
    sj_begin(&q);
    task u = *t;
    if (t->ju != t->jd && t->a0 > 0) {
        sj_put(&q, n, -t->sign * t->ju);
        double small = crossing_jerk(t, left);
        if (left > 0) sj_put(&q, 1, -t->sign * (left < small ? small : left));
        u = sj_resume(t, &q);
        if (!(left > 0 && left < small)) u.a0 = 0;
    }
    path x;
    int above = t->ju == t->jd || (u.a0 <= 0 && u.v0 - u.a0 * u.a0 / (2 * t->jd) >= -t->vmax);
    above = above && sj_ramp(u.v0, u.a0, -t->vmax - u.v0, -1, t->au, t->ad, t->jd, &x);
    /* in whole cycles even the way to zero may fall through: then upward with the other jerk, not
       here */
    for (int i = 0; above && t->ju != t->jd && i < x.count; i++) above = x.a[i] <= 0;
    if (above) {
        double v = u.v0;
        for (int i = 1; i < x.count; i++) {
            double a = x.a[i - 1], m = x.k[i] - x.k[i - 1], jerk = (x.a[i] - a) / m, lo = 0, hi = m;
            if (v + m * (a + m * jerk / 2) <= top && x.a[i] <= 0) {
                for (int s = 0; s < 64 && hi - lo > 1; s++) {
                    double mid = whole((lo + hi) / 2);
                    if (v + mid * (a + mid * jerk / 2) <= top && a + mid * jerk <= 0)
                        hi = mid; else lo = mid;
                }
                sj_put(&q, hi, t->sign * jerk);
                break;
            }
            sj_put(&q, m, t->sign * jerk);
            v += m * (a + m * jerk / 2);
        }
    }
    for (int i = 0; i < q.count; i++) sj_put(p, (double)q.phase[i].cycles, q.phase[i].jerk);
    *t = sj_resume(t, &q);
}

/* A start outside its limits comes back as fast as jerk allows. */
void sj_come_back(task *t, sj_plan *p)
{
    if (fabs(t->a0) <= least(t->au, t->ad)
        && t->a0 * t->a0 <= 1.99 * least(t->ju, t->jd) * (t->vmax - fabs(t->v0) - 2 * least(t->ju,
            t->jd))) return;
    double amax = t->a0 > 0 ? t->au : t->ad, j = t->a0 > 0 ? t->ju : t->jd, d = t->a0 > 0 ? 1 : -1;
    if (fabs(t->a0) > amax * (1 + SLACK)) {
        sj_plan q;
        sj_begin(&q);
        sj_put(&q, down((fabs(t->a0) - amax) / j), -d * t->sign * j);
        task u = sj_resume(t, &q);
        double left = fabs(u.a0) - amax;
        if (left > SLACK * amax) {
            /* the last cycle ends at the limit, unless that little of jerk spared costs the
               velocity limit */
            double n, rest;
            int cross;
            task w = u;
            w.v0 += d * (amax + left / 2);
            w.a0 = d * amax;
            double a = fabs(u.a0), small = crossing_jerk(&u, a),
                firm = a >= j ? j : a > small ? a : small;
            double c = carried(&w, &n, &rest, &cross);
            sj_put(&q, 1, -d * t->sign * (fabs(c) > t->vmax * (1 + SLACK)
                && c * d > 0 ? firm : left));
            u = sj_resume(t, &q);
        }
        *t = u;
        for (int i = 0; i < q.count; i++) sj_put(p, (double)q.phase[i].cycles, q.phase[i].jerk);
    }
    come_down(t, p);
    *t = mirrored(t);
    come_down(t, p);
    *t = mirrored(t);
}
