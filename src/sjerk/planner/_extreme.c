/* The path of n cycles from a given start to (v1, 0) that gets furthest, under one jerk limit:
       a_k = max(min(a0 + J k, A, J (s - k)), -D, -J (n - k)),
   s a real number found from the change of velocity; a cruise at the velocity limit parts the
   falling line in two. Its mirror image gets least far.

   Never here: two jerks (_sides.c), a distance to be met. */
#include "planner/_internal.h"

/* Acceleration at node k of the path that gets furthest in n cycles: as high as possible, then as
   low as possible; with a cruise between s (from the start) and r (cycles before the end). */
static double extreme_at(const task *t, double jerk, double n, double s, double r, double k)
{
    double mid = k < s ? jerk * (s - k) : n - k < r ? -jerk * (r - (n - k)) : 0;
    double x = least(least(t->a0 + jerk * k, t->au), mid);
    return most(most(x, -t->ad), -jerk * (n - k));
}

/* The nodes of that path: cycles beside its kinks, where the lines of extreme_at meet. */
static void extreme_path(const task *t, double j, double n, double s, double r, path *x)
{
    double kink[6], k[14], apex = 0.5 * (s - t->a0 / j);
    int c = 0, m = 0;
    if (t->a0 + j * apex > t->au) {
        kink[m++] = (t->au - t->a0) / j;
        kink[m++] = s - t->au / j;
    } else
        kink[m++] = apex;
    if (s + r < n) {
        kink[m++] = s;
        kink[m++] = n - r;
    }
    if (j * r > 2 * t->ad) {
        kink[m++] = n - r + t->ad / j;
        kink[m++] = n - t->ad / j;
    } else
        kink[m++] = n - 0.5 * r;
    k[c++] = 0;
    for (int i = 0; i < m; i++) {
        double f = whole(kink[i]);
        if (f > 0 && f < n)
            k[c++] = f;
        if (f + 1 > 0 && f + 1 < n)
            k[c++] = f + 1;
    }
    k[c++] = n;
    for (int i = 1; i < c; i++) {
        double q = k[i];
        int l = i;
        for (; l > 0 && k[l - 1] > q; l--)
            k[l] = k[l - 1];
        k[l] = q;
    }
    x->count = 0;
    for (int i = 0; i < c; i++) {
        if (x->count && k[i] <= x->k[x->count - 1])
            continue;
        double a = k[i] <= 0 ? t->a0 : k[i] >= n ? 0 : extreme_at(t, j, n, s, r, k[i]);
        /* drop the node before this one when it lies on a straight line */
        if (x->count >= 2) {
            int e = x->count - 1;
            double d1 = x->k[e] - x->k[e - 1], d2 = k[i] - x->k[e];
            if (fabs((x->a[e] - x->a[e - 1]) * d2 - (a - x->a[e]) * d1) <= 1e-13 * j * d1 * d2)
                x->count--;
        }
        x->k[x->count] = k[i];
        x->a[x->count] = a;
        x->count++;
    }
}

/* Velocity change of the furthest path, the falling line crossing zero at s; slope is its change
   with s. The sum of the nodes,
       a0 / 2 + sum of a_k over 1 <= k < n,
   is one of five arithmetic series: a0 + J k up to k1, A to k2, J (s - k) to k3, -D to k4,
   -J (n - k). */
static double extreme_change(const task *t, double j, double n, double s, double *slope)
{
    double a0 = t->a0, apex = 0.5 * (s - a0 / j), xa = apex, xb = apex, foot = 0.5 * (n + s),
           ya = foot, yb = foot;
    if (a0 + j * apex > t->au) {
        xa = (t->au - a0) / j;
        xb = s - t->au / j;
    }
    if (j * (s - foot) < -t->ad) {
        ya = s + t->ad / j;
        yb = n - t->ad / j;
    }
    double k1 = whole(xa), k2 = whole(xb), k3 = whole(ya), k4 = whole(yb);
    *slope = j * (k3 - k2);
    return a0 / 2 + k1 * (a0 + j * (k1 + 1) / 2) + t->au * (k2 - k1) +
           (k3 - k2) * (j * (s - 0.5 * (k2 + 1 + k3))) - t->ad * (k4 - k3) -
           j * (n - k4 - 1) * (n - k4) / 2;
}

/* The same up to the zero crossing only, nodes beyond it at zero: the first three of the series. */
double sj_rise_change(double a0, double top, double j, double s, double *slope)
{
    double apex = 0.5 * (s - a0 / j), xa = apex, xb = apex;
    if (a0 + j * apex > top) {
        xa = (top - a0) / j;
        xb = s - top / j;
    }
    double k1 = whole(xa), k2 = whole(xb), k3 = whole(s);
    *slope = j * (k3 - k2);
    return a0 / 2 + k1 * (a0 + j * (k1 + 1) / 2) + top * (k2 - k1) +
           (k3 - k2) * (j * (s - 0.5 * (k2 + 1 + k3)));
}

/* s at which sj_rise_change is dv; NaN if there is none above lo. */
static double rise_duration(double a0, double top, double j, double dv, double lo)
{
    double x = dv + a0 * fabs(a0) / (2 * j), slope, f = 0;
    double hi = INFINITY, s = most(lo, ramp_time(most(0, x), top, j) - a0 / j);
    if (!(s < LONGEST))
        return NAN;
    double tiny = 1e-16 * (fabs(dv) + j + fabs(a0) * (s + 1));
    for (int i = 0; i < NEWTON_STEPS; i++) {
        f = sj_rise_change(a0, top, j, s, &slope) - dv;
        if (fabs(f) <= 2 * tiny)
            return s;
        if (f > 0)
            hi = s;
        else
            lo = s;
        double next = slope > 0 ? s - f / slope : s + (f < 0 ? 0.5 : -0.5);
        if (fabs(next - s) <= 4e-16 * (fabs(s) + 1))
            break;
        if (!(next >= lo && next <= hi)) {
            if (hi <= lo)
                return NAN;
            next = hi < INFINITY ? 0.5 * (lo + hi) : lo + 1;
        }
        s = next;
    }
    return fabs(f) <= 1e3 * tiny ? s : NAN;
}

/* Cycles from (v, a0) until the velocity has changed by dv, without acceleration then; NaN if there are
   none. */
double sj_rise_cycles(double a0, double top, double j, double dv)
{
    return rise_duration(a0, top, j, dv, fabs(a0) / j);
}

/* The largest velocity that n cycles may see: what rounding is relative to. */
double sj_velocity_scale(const task *t, double j, double n)
{
    double a = fabs(t->a0);
    return least(2 * t->vmax, fabs(t->v0) + n * least(a + most(t->au, t->ad), a + j * n));
}

/* Cycles up to the velocity limit and down from it: the same for every duration, so found once in a
   search. */
static void find_summit(const task *t, double j, double top, double first, summit *m)
{
    if (m->known)
        return;
    m->s = rise_duration(t->a0, t->au, j, top - t->v0, first);
    m->r = rise_duration(0, t->ad, j, top - t->v1, 0);
    m->known = 1;
}

/* The legal path of n cycles to (v1, 0) that gets furthest up, from an acceleration that can end on a
   node; 0 if there is none. */
static int furthest(const task *t, double j, double n, summit *m, path *x)
{
    double dv = t->v1 - t->v0, first = fabs(t->a0) / j, carry = t->v0 + t->a0 * first / 2;
    if (n < first * (1 - SLACK) || fabs(carry) > t->vmax * (1 + SLACK))
        return 0;
    double reach = sj_velocity_scale(t, j, n), tiny = 2e-16 * reach;
    /* up to the velocity limit, cruise, and down at the last moment */
    double top = most(t->vmax, carry);
    find_summit(t, j, top, first, m);
    double s = m->s, r = m->r;
    if (!(s + r <= n)) {
        /* too short for that: the falling line goes through zero without a rest */
        double lo = least(t->a0 / j, n), hi = n, slope, f = 0, next = s - 0.5 * (s + r - n);
        s = next > lo && next < hi ? next : 0.5 * (lo + hi);
        for (int i = 0; i < NEWTON_STEPS; i++) {
            f = extreme_change(t, j, n, s, &slope) - dv;
            if (fabs(f) <= 2 * tiny)
                break;
            if (f > 0)
                hi = s;
            else
                lo = s;
            next = slope > 0 ? s - f / slope : 0.5 * (lo + hi);
            if (fabs(next - s) <= 4e-16 * n)
                break;
            if (!(next >= lo && next <= hi))
                next = 0.5 * (lo + hi);
            /* no root at all? asked late, since it is rare */
            if (i == 8 && (extreme_change(t, j, n, lo, &slope) > dv + 1e-13 * reach ||
                           extreme_change(t, j, n, hi, &slope) < dv - 1e-13 * reach))
                return 0;
            s = next;
        }
        if (!(fabs(f) <= 1e-13 * reach))
            return 0;
        r = n - s;
        if (s > -t->a0 / j && s > 0) {
            double part = s - whole(s);
            double rise = sj_rise_change(t->a0, t->au, j, s, &slope);
            double peak = t->v0 + rise - 0.5 * j * part * (1 - part);
            if (peak > t->vmax * (1 + SLACK))
                return 0;
        }
    }
    extreme_path(t, j, n, s, r, x);
    /* a crossing cut short by an acceleration limit peaks higher */
    return fabs(sj_path_change(x) - dv) <= 1e-13 * reach &&
           sj_path_peak(x, t->v0) <= t->vmax * (1 + 2 * SLACK);
}

/* The same from any acceleration: where zero on a node would carry the velocity over its limit, the
   gentlest crossing comes first. */
int sj_furthest(const task *t, double j, double n, summit *m, path *x)
{
    double whole_cycles = t->a0 > 0 ? whole(t->a0 / j) : 0, left = t->a0 - whole_cycles * j;
    double v = t->v0 + whole_cycles * (t->a0 - whole_cycles * j / 2), room = t->vmax - v;
    if (!(t->a0 > 0 && left > 2 * room + 2 * SLACK * t->vmax))
        return furthest(t, j, n, m, x);
    double across = left * left / (2 * most(0, room)), most_j = least(j, left + t->ad);
    double head = whole_cycles + 1;
    if (!(across * (1 - 1e-9) <= most_j && n > head))
        return 0;
    across = least(across, most_j);
    task u = *t;
    u.v0 = v + left - across / 2;
    u.a0 = left - across;
    if (!furthest(&u, j, n - head, m, x))
        return 0;
    int more = whole_cycles > 0 ? 2 : 1;
    for (int i = x->count - 1; i >= 0; i--) {
        x->k[i + more] = x->k[i] + head;
        x->a[i + more] = x->a[i];
    }
    x->k[0] = 0;
    x->a[0] = t->a0;
    if (more == 2) {
        x->k[1] = whole_cycles;
        x->a[1] = left;
    }
    x->count += more;
    return 1;
}
