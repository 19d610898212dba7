/* Paths of n cycles to (v1, 0) under two jerks, one for each side of zero acceleration.

   A cycle may use the larger jerk only while the acceleration has one sign. So these paths meet zero on
   a node, and two of a pair have the same sign in every cycle: what lies between them keeps both
   jerks.

   Never here: a distance to be met. */
#include "planner/_internal.h"

/* One side of zero: from a0 >= 0 as high as possible, then down to zero at the real number s of
   cycles, and zero at the next node. Its nodes are laid from cycle `at` forward (step 1) or
   backward (step -1). */
static void side_path(path *x, double at, double step, double sign, double a0, double top, double j,
                      double s)
{
    double kink[3], k[8], apex = 0.5 * (s - a0 / j), end = whole(s) < s ? whole(s) + 1 : whole(s);
    int m = 0, c = 0;
    if (a0 + j * apex > top) {
        kink[m++] = (top - a0) / j;
        kink[m++] = s - top / j;
    } else
        kink[m++] = apex;
    kink[m++] = s;
    k[c++] = 0;
    for (int i = 0; i < m; i++)
        for (int e = 0; e < 2; e++) {
            double f = whole(kink[i]) + e;
            if (f > k[c - 1] && f <= end)
                k[c++] = f;
        }
    for (int i = 0; i < c; i++) {
        double q = k[step > 0 ? i : c - 1 - i];
        double a = most(0, least(least(a0 + j * q, top), j * (s - q)));
        sj_node(x, at + step * q, sign * (q <= 0 ? a0 : a));
    }
}

/* The duration of a side, in [lo, hi], that changes the velocity by dv. */
static double side_duration(double a0, double top, double j, double dv, double lo, double hi)
{
    double s = ramp_time(most(0, dv + a0 * a0 / (2 * j)), top, j) - a0 / j;
    double slope, tiny = 2e-16 * (fabs(dv) + j + a0 * (hi + 1));
    s = most(lo, least(hi, s));
    for (int i = 0; i < NEWTON_STEPS; i++) {
        double f = sj_rise_change(a0, top, j, s, &slope) - dv;
        if (fabs(f) <= tiny)
            break;
        if (f > 0)
            hi = s;
        else
            lo = s;
        double next = slope > 0 ? s - f / slope : 0.5 * (lo + hi);
        next = most(lo, least(hi, next));
        if (fabs(next - s) <= 4e-16 * (fabs(s) + 1)) {
            if (hi - lo <= 4e-16 * (fabs(s) + 1) || slope > 0)
                break;
            next = 0.5 * (lo + hi);
        }
        s = next;
    }
    return s;
}

/* Without a0 < 0: upward acceleration in the first cycles only, downward in the rest only, zero on
   the node between. So each side has its own jerk, and combinations of such paths keep it. y is the
   one that gets furthest; x, which has no more velocity than it needs, falls behind. 0: too few
   cycles; -1: zero on a node costs the velocity limit. */
static int one_crossing(const task *t, double from, double n, path *x, path *y)
{
    double a0 = t->a0, ju = t->ju, jd = t->jd, dv = t->v1 - t->v0, e, g;
    double first = up(a0 / ju), s0 = least(a0 / ju, first), s, r, zero;
    if (first > n)
        return 0;
    double carried = sj_rise_change(a0, t->au, ju, s0, &e), room = 1e-13 * (t->vmax + fabs(dv));
    if (t->v0 + carried > t->vmax * (1 + SLACK))
        return -1;
    double below =
        sj_rise_change(a0, t->au, ju, first, &e) - sj_rise_change(0, t->ad, jd, n - first, &g);
    if (below > dv) {
        r = n - first;
        zero = first;
        double need = dv + sj_rise_change(0, t->ad, jd, r, &g);
        if (need < carried - room)
            return 0;
        s = side_duration(a0, t->au, ju, most(need, carried), s0, first);
    } else {
        double lo = first, hi = n + 1, m = whole(0.5 * (first + n));
        if (sj_rise_change(a0, t->au, ju, n, &e) < dv - room)
            return 0;
        for (int i = 0; i < NEWTON_STEPS && hi - lo > 1; i++) {
            if (!(m > lo && m < hi))
                m = whole(0.5 * (lo + hi));
            if (m <= lo || m > n) {
                if (hi > n) {
                    m = n;
                } else
                    break;
            }
            double rise = sj_rise_change(a0, t->au, ju, m, &e);
            double f = rise - sj_rise_change(0, t->ad, jd, n - m, &g) - dv;
            if (f > 0)
                hi = m;
            else
                lo = m;
            if (lo >= n)
                break;
            m = e + g > 0 ? whole(m - f / (e + g) + (f > 0 ? 0 : 0.999)) : whole(0.5 * (lo + hi));
        }
        s = zero = lo;
        r = n - lo;
        double ahead = sj_rise_change(a0, t->au, ju, s, &e);
        if (lo < n) {
            double short_drop = sj_rise_change(0, t->ad, jd, r - 1, &g);
            if (ahead - short_drop >= dv)
                r = side_duration(0, t->ad, jd, ahead - dv, r - 1, r);
            else {
                r -= 1;
                zero += 1;
                s = side_duration(a0, t->au, ju, dv + short_drop, s, zero);
            }
        } else if (fabs(ahead - dv) > room)
            return 0;
    }
    if (t->v0 + sj_rise_change(a0, t->au, ju, s, &e) > t->vmax) {
        double top = most(t->vmax, t->v0 + carried);
        s = side_duration(a0, t->au, ju, top - t->v0, s0, s);
        r = side_duration(0, t->ad, jd, top - t->v1, 0, r);
    }
    side_path(y, from, 1, 1, a0, t->au, ju, s);
    side_path(y, from + n, -1, -1, 0, t->ad, jd, r);
    sj_node(y, from + n, 0);
    if (dv >= carried) {
        double l = side_duration(a0, t->au, ju, dv, s0, s);
        side_path(x, from, 1, 1, a0, t->au, ju, l);
    } else {
        side_path(x, from, 1, 1, a0, t->au, ju, s0);
        side_path(x, from + n, -1, -1, 0, t->ad, jd,
                  side_duration(0, t->ad, jd, carried - dv, 0, r));
    }
    sj_node(x, from + n, 0);
    return 1;
}

/* Two paths of n cycles to (v1, 0) whose combinations keep both jerks, as one_crossing. */
int sj_side_paths(const task *t, double n, path *x, path *y)
{
    x->count = y->count = 0;
    if (t->a0 >= 0) {
        int ok = one_crossing(t, 0, n, x, y);
        if (ok != 1)
            return ok;
    } else {
        double back = up(-t->a0 / t->jd), last = back - 1, left = t->a0 + t->jd * last;
        double v = t->v0 + last * (t->a0 + t->jd * last / 2) + left / 2;
        task u = *t;
        u.v0 = v;
        u.a0 = 0;
        int ok = 0;
        if (v < -t->vmax * (1 + SLACK))
            ok = -1;
        else if (n >= back) {
            sj_node(y, 0, t->a0);
            sj_node(x, 0, t->a0);
            sj_node(y, last, left);
            sj_node(x, last, left);
            ok = one_crossing(&u, back, n - back, x, y);
        }
        if (ok != 1) {
            /* never up at all: one jerk is enough */
            summit m = {0, 0, 0};
            double at_once = -t->a0 / t->jd, dv = t->v0 - t->v1;
            double carry = sj_rise_change(-t->a0, t->ad, t->jd, at_once, &v);
            x->count = y->count = 0;
            if (dv < carry || ok < 0)
                return ok;
            if (!sj_furthest(t, t->jd, n, &m, y))
                return 0;
            for (int i = 0; i < y->count; i++)
                if (y->a[i] > 0)
                    return 0;
            double l = side_duration(-t->a0, t->ad, t->jd, dv, at_once, n);
            side_path(x, 0, 1, -1, -t->a0, t->ad, t->jd, l);
            sj_node(x, n, 0);
        }
    }
    double reach = sj_velocity_scale(t, most(t->ju, t->jd), n), dv = t->v1 - t->v0;
    return x->k[x->count - 1] <= n && fabs(sj_path_change(x) - dv) <= 1e-13 * reach &&
                   fabs(sj_path_change(y) - dv) <= 1e-13 * reach
               ? 1
               : -1;
}
