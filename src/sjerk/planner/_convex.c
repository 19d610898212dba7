/* Plans of exactly n cycles by convexity.

   For one jerk limit, a given start and length, the legal acceleration sequences are a convex set
   and the end is linear in them. Of those that end at (v1, 0) one gets furthest up and one
   furthest down; if the target lies between, their mix lands on it and keeps every limit, and if
   it does not, no plan of this length exists (up to the velocity limit, which the extremes meet
   to within a cycle). The furthest is
       a_k = max(min(a0 + J k, A, J (s - k)), -D, -J (n - k)),
   s a real number found from the change of velocity; a cruise at the velocity limit parts the
   falling line in two.

   With two jerks the legal sequences are convex only where the sign of the acceleration is settled
   cycle by cycle. So there paths are mixed that meet zero on a node and have the same signs. Where
   none serves, all cycles keep the smaller jerk, which is legal everywhere.

   Never here: anything but a given length; the search for one is mix_from alone. */
#include "_plan.h"

/* ---- extremes of a fixed length, and their mix ---- */

/* Acceleration at node k of the path that gets furthest in n cycles: as high as possible, then as
   low as possible; with a cruise between s (from the start) and r (cycles before the end). */
static double extreme_at(const task *t, double jerk, double n, double s, double r, double k)
{
    double mid = k < s ? jerk * (s - k) : n - k < r ? -jerk * (r - (n - k)) : 0;
    double x = least(least(t->a0 + jerk * k, t->au), mid);
    return most(most(x, -t->ad), -jerk * (n - k));
}
static void extreme_path(const task *t, double j, double n, double s, double r, path *x)
{
    double kink[6], k[14], apex = 0.5 * (s - t->a0 / j);
    int c = 0, m = 0;
    if (t->a0 + j * apex > t->au) { kink[m++] = (t->au - t->a0) / j; kink[m++] = s - t->au / j; }
    else kink[m++] = apex;
    if (s + r < n) { kink[m++] = s; kink[m++] = n - r; }
    if (j * r > 2 * t->ad) { kink[m++] = n - r + t->ad / j; kink[m++] = n - t->ad / j; }
    else kink[m++] = n - 0.5 * r;
    k[c++] = 0;
    for (int i = 0; i < m; i++) {
        double f = whole(kink[i]);
        if (f > 0 && f < n) k[c++] = f;
        if (f + 1 > 0 && f + 1 < n) k[c++] = f + 1;
    }
    k[c++] = n;
    for (int i = 1; i < c; i++) {
        double q = k[i];
        int l = i;
        for (; l > 0 && k[l - 1] > q; l--) k[l] = k[l - 1];
        k[l] = q;
    }
    x->count = 0;
    for (int i = 0; i < c; i++) {
        if (x->count && k[i] <= x->k[x->count - 1]) continue;
        double a = k[i] <= 0 ? t->a0 : k[i] >= n ? 0 : extreme_at(t, j, n, s, r, k[i]);
        /* drop the node before this one when it lies on a straight line */
        if (x->count >= 2) {
            int e = x->count - 1;
            double d1 = x->k[e] - x->k[e - 1], d2 = k[i] - x->k[e];
            if (fabs((x->a[e] - x->a[e - 1]) * d2 - (a - x->a[e]) * d1) <= 1e-13 * j * d1 * d2)
                x->count--;
        }
        x->k[x->count] = k[i]; x->a[x->count] = a; x->count++;
    }
}

/* Velocity change of the furthest path, the falling line crossing zero at s; slope is its change
   with s. */
static double extreme_change(const task *t, double j, double n, double s, double *slope)
{
    double a0 = t->a0, apex = 0.5 * (s - a0 / j), xa = apex, xb = apex, foot = 0.5 * (n + s),
        ya = foot, yb = foot;
    if (a0 + j * apex > t->au) { xa = (t->au - a0) / j; xb = s - t->au / j; }
    if (j * (s - foot) < -t->ad) { ya = s + t->ad / j; yb = n - t->ad / j; }
    double k1 = whole(xa), k2 = whole(xb), k3 = whole(ya), k4 = whole(yb);
    *slope = j * (k3 - k2);
    return a0 / 2 + k1 * (a0 + j * (k1 + 1) / 2) + t->au * (k2 - k1)
        + (k3 - k2) * (j * (s - 0.5 * (k2 + 1 + k3)))
        - t->ad * (k4 - k3) - j * (n - k4 - 1) * (n - k4) / 2;
}
/* The same up to the zero crossing only, nodes beyond it at zero. */
static double rise_change(double a0, double top, double j, double s, double *slope)
{
    double apex = 0.5 * (s - a0 / j), xa = apex, xb = apex;
    if (a0 + j * apex > top) { xa = (top - a0) / j; xb = s - top / j; }
    double k1 = whole(xa), k2 = whole(xb), k3 = whole(s);
    *slope = j * (k3 - k2);
    return a0 / 2 + k1 * (a0 + j * (k1 + 1) / 2) + top * (k2 - k1)
        + (k3 - k2) * (j * (s - 0.5 * (k2 + 1 + k3)));
}
/* s at which rise_change is dv; NaN if there is none above lo. */
static double rise_length(double a0, double top, double j, double dv, double lo)
{
    double x = dv + a0 * fabs(a0) / (2 * j), slope, f = 0;
    double hi = INFINITY, s = most(lo, ramp_time(most(0, x), top, j) - a0 / j);
    if (!(s < LONGEST)) return NAN;
    double tiny = 1e-16 * (fabs(dv) + j + fabs(a0) * (s + 1));
    for (int i = 0; i < NEWTON_STEPS; i++) {
        f = rise_change(a0, top, j, s, &slope) - dv;
        if (fabs(f) <= 2 * tiny) return s;
        if (f > 0) hi = s; else lo = s;
        double next = slope > 0 ? s - f / slope : s + (f < 0 ? 0.5 : -0.5);
        if (fabs(next - s) <= 4e-16 * (fabs(s) + 1)) break;
        if (!(next >= lo && next <= hi)) {
            if (hi <= lo) return NAN;
            next = hi < INFINITY ? 0.5 * (lo + hi) : lo + 1;
        }
        s = next;
    }
    return fabs(f) <= 1e3 * tiny ? s : NAN;
}

/* The largest velocity that n cycles may see: what rounding is relative to. */
static double velocity_scale(const task *t, double j, double n)
{
    double a = fabs(t->a0);
    return least(2 * t->vmax, fabs(t->v0) + n * least(a + most(t->au, t->ad), a + j * n));
}

/* Cycles up to the velocity limit and down from it: the same for every length, so found once in a
   search. */
static void find_summit(const task *t, double j, double top, double first, summit *m)
{
    if (m->known) return;
    m->s = rise_length(t->a0, t->au, j, top - t->v0, first);
    m->r = rise_length(0, t->ad, j, top - t->v1, 0);
    m->known = 1;
}

/* The legal path of n cycles to (v1, 0) that gets furthest up, from an acceleration that can end on a
   node; 0 if there is none. */
static int furthest(const task *t, double j, double n, summit *m, path *x)
{
    double dv = t->v1 - t->v0, first = fabs(t->a0) / j, carry = t->v0 + t->a0 * first / 2;
    if (n < first * (1 - SLACK) || fabs(carry) > t->vmax * (1 + SLACK)) return 0;
    double reach = velocity_scale(t, j, n), tiny = 2e-16 * reach;
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
            if (fabs(f) <= 2 * tiny) break;
            if (f > 0) hi = s; else lo = s;
            next = slope > 0 ? s - f / slope : 0.5 * (lo + hi);
            if (fabs(next - s) <= 4e-16 * n) break;
            if (!(next >= lo && next <= hi)) next = 0.5 * (lo + hi);
            /* no root at all? asked late, since it is rare */
            if (i == 8 && (extreme_change(t, j, n, lo, &slope) > dv + 1e-13 * reach
                           || extreme_change(t, j, n, hi, &slope) < dv - 1e-13 * reach)) return 0;
            s = next;
        }
        if (!(fabs(f) <= 1e-13 * reach)) return 0;
        r = n - s;
        if (s > -t->a0 / j && s > 0) {
            double part = s - whole(s);
            double rise = rise_change(t->a0, t->au, j, s, &slope);
            double peak = t->v0 + rise - 0.5 * j * part * (1 - part);
            if (peak > t->vmax * (1 + SLACK)) return 0;
        }
    }
    extreme_path(t, j, n, s, r, x);
    /* a crossing cut short by an acceleration limit peaks higher */
    return fabs(sj_path_change(x) - dv) <= 1e-13 * reach
        && sj_path_peak(x, t->v0) <= t->vmax * (1 + 2 * SLACK);
}

/* The same from any acceleration: where zero on a node would carry the velocity over its limit, the
   gentlest crossing comes first. */
static int extreme(const task *t, double j, double n, summit *m, path *x)
{
    double whole_cycles = t->a0 > 0 ? whole(t->a0 / j) : 0, left = t->a0 - whole_cycles * j;
    double v = t->v0 + whole_cycles * (t->a0 - whole_cycles * j / 2), room = t->vmax - v;
    if (!(t->a0 > 0 && left > 2 * room + 2 * SLACK * t->vmax)) return furthest(t, j, n, m, x);
    double across = left * left / (2 * most(0, room)), most_j = least(j, left + t->ad);
    double head = whole_cycles + 1;
    if (!(across * (1 - 1e-9) <= most_j && n > head)) return 0;
    across = least(across, most_j);
    task u = *t;
    u.v0 = v + left - across / 2;
    u.a0 = left - across;
    if (!furthest(&u, j, n - head, m, x)) return 0;
    int more = whole_cycles > 0 ? 2 : 1;
    for (int i = x->count - 1; i >= 0; i--) {
        x->k[i + more] = x->k[i] + head;
        x->a[i + more] = x->a[i];
    }
    x->k[0] = 0; x->a[0] = t->a0;
    if (more == 2) { x->k[1] = whole_cycles; x->a[1] = left; }
    x->count += more;
    return 1;
}

static double path_at(const path *x, int *i, double k)
{
    while (*i < x->count - 2 && x->k[*i + 1] < k) ++*i;
    double n = x->k[*i + 1] - x->k[*i];
    return x->a[*i] + (x->a[*i + 1] - x->a[*i]) * ((k - x->k[*i]) / n);
}

/* Rounding of a distance; in the last few cycles, which leave no freedom, also what a long plan
   left over. */
static double mix_room(const task *t, double n, double p)
{
    return 2.5e-13 * (fabs(p) + fabs(t->h)) + (n <= 4 ? 3e-11 * (fabs(t->v0) + fabs(t->v1)) : 0);
}

/* Lands on h by the mix of a path x that falls short and a path y that gets beyond. */
static void mixed(const task *t, double n, const path *x, double px, const path *y, double py,
    path *z)
{
    int ix = 0, iy = 0, gx = 0, gy = 0;
    double lambda = py > px ? most(0, least(1, (t->h - px) / (py - px))) : 0;
    z->count = 0;
    while (ix < x->count || iy < y->count) {
        double k = ix < x->count ? x->k[ix] : n;
        if (iy < y->count) k = least(k, y->k[iy]);
        double ax = path_at(x, &gx, k), ay = path_at(y, &gy, k);
        if (z->count < NODES)
            sj_node(z, k, k <= 0 ? t->a0 : k >= n ? 0 : ax + lambda * (ay - ax));
        while (ix < x->count && x->k[ix] <= k) ix++;
        while (iy < y->count && y->k[iy] <= k) iy++;
    }
}

/* What the roots of the extremes left of velocity and distance is taken up by two levels, where that
   is far below what the limits are kept to: the one with the widest neighbourhood on each side of
   the middle. */
static void polish(const task *t, path *z)
{
    int at[2] = {0, 0}, middle = z->count / 2;
    double width[2] = {0, 0}, reach[2], slope[2];
    for (int i = 1; i + 1 < z->count; i++) {
        double w = (z->k[i + 1] - z->k[i - 1]) / 2;
        int s = i >= middle;
        if (z->a[i] != 0 && w > width[s]) { width[s] = w; at[s] = i; }
    }
    if (!at[0] || !at[1]) return;
    double end = z->k[z->count - 1];
    for (int s = 0; s < 2; s++) {
        const double *k = &z->k[at[s]];
        reach[s] = end - (k[-1] + k[0] + k[1]) / 3;
        slope[s] = 1 / least(k[0] - k[-1], k[1] - k[0]);
    }
    double dv = t->v1 - t->v0 - sj_path_change(z), dp = t->h - sj_path_distance(z, t->v0);
    double later = (dp - reach[0] * dv) / (reach[1] - reach[0]);
    double change[2] = {(dv - later) / width[0], later / width[1]};
    const double room = 4 * SLACK;
    for (int s = 0; s < 2; s++) {
        double level = room * (z->a[at[s]] > 0 ? t->au : t->ad);
        if (!(fabs(change[s]) <= least(level, room * least(t->ju, t->jd) / slope[s]))) return;
    }
    for (int s = 0; s < 2; s++) z->a[at[s]] += change[s];
}

static int mix_put(const task *t, path *z, sj_plan *p)
{
    if (p->count + z->count > SJ_PHASES) return 0;
    polish(t, z);
    sj_path_put(p, z, t);
    p->kind = SJ_PLAN_MIX;
    return 1;
}

/* Exactly n cycles: the convex mix of the two extremes (one jerk limit: the smaller). */
static int mix_with(const task *t, double j, double n, double *nearest, summit *m, sj_plan *p)
{
    path x, y, z;
    double px = 0, py = 0;
    /* where the last length fell short of being low enough, look at the low one first */
    int low_first = *nearest > -INFINITY;
    for (int i = 0; i < 2; i++) {
        if ((i == 0) == low_first) {
            task o = mirrored(t);
            if (!extreme(&o, j, n, &m[1], &x)) return 0;
            for (int k = 0; k < x.count; k++) x.a[k] = -x.a[k];
            px = sj_path_distance(&x, t->v0);
            if (px > t->h + mix_room(t, n, px)) { *nearest = px; return 0; }
        } else {
            if (!extreme(t, j, n, &m[0], &y)) return 0;
            py = sj_path_distance(&y, t->v0);
            if (py < t->h - mix_room(t, n, py)) { *nearest = py; return 0; }
        }
    }
    mixed(t, n, &x, px, &y, py, &z);
    return mix_put(t, &z, p);
}

/* ---- two jerks ---- */

/* One side of zero: from a0 >= 0 as high as possible, then down to zero at the real number s of
   cycles, and zero at the next node. Its nodes are laid from cycle `at` forward (step 1) or
   backward (step -1). */
static void side(path *x, double at, double step, double way, double a0, double top, double j,
    double s)
{
    double kink[3], k[8], apex = 0.5 * (s - a0 / j), end = whole(s) < s ? whole(s) + 1 : whole(s);
    int m = 0, c = 0;
    if (a0 + j * apex > top) { kink[m++] = (top - a0) / j; kink[m++] = s - top / j; }
    else kink[m++] = apex;
    kink[m++] = s;
    k[c++] = 0;
    for (int i = 0; i < m; i++)
        for (int e = 0; e < 2; e++) {
            double f = whole(kink[i]) + e;
            if (f > k[c - 1] && f <= end) k[c++] = f;
        }
    for (int i = 0; i < c; i++) {
        double q = k[step > 0 ? i : c - 1 - i];
        double a = most(0, least(least(a0 + j * q, top), j * (s - q)));
        sj_node(x, at + step * q, way * (q <= 0 ? a0 : a));
    }
}

/* The length of a side, in [lo, hi], that changes the velocity by dv. */
static double side_length(double a0, double top, double j, double dv, double lo, double hi)
{
    double s = ramp_time(most(0, dv + a0 * a0 / (2 * j)), top, j) - a0 / j;
    double slope, tiny = 2e-16 * (fabs(dv) + j + a0 * (hi + 1));
    s = most(lo, least(hi, s));
    for (int i = 0; i < NEWTON_STEPS; i++) {
        double f = rise_change(a0, top, j, s, &slope) - dv;
        if (fabs(f) <= tiny) break;
        if (f > 0) hi = s; else lo = s;
        double next = slope > 0 ? s - f / slope : 0.5 * (lo + hi);
        next = most(lo, least(hi, next));
        if (fabs(next - s) <= 4e-16 * (fabs(s) + 1)) {
            if (hi - lo <= 4e-16 * (fabs(s) + 1) || slope > 0) break;
            next = 0.5 * (lo + hi);
        }
        s = next;
    }
    return s;
}

/* Without a0 < 0: upward acceleration in the first cycles only, downward in the rest only, zero on
   the node between. So each side has its own jerk, and the mixes of such paths keep it. y is the
   one that gets furthest; x, which has no more velocity than it needs, falls behind. 0: too few
   cycles; -1: zero on a node costs the velocity limit. */
static int one_crossing(const task *t, double from, double n, path *x, path *y)
{
    double a0 = t->a0, ju = t->ju, jd = t->jd, dv = t->v1 - t->v0, e, g;
    double first = up(a0 / ju), s0 = least(a0 / ju, first), s, r, zero;
    if (first > n) return 0;
    double carried = rise_change(a0, t->au, ju, s0, &e), room = 1e-13 * (t->vmax + fabs(dv));
    if (t->v0 + carried > t->vmax * (1 + SLACK)) return -1;
    double below = rise_change(a0, t->au, ju, first, &e) - rise_change(0, t->ad, jd, n - first, &g);
    if (below > dv) {
        r = n - first; zero = first;
        double need = dv + rise_change(0, t->ad, jd, r, &g);
        if (need < carried - room) return 0;
        s = side_length(a0, t->au, ju, most(need, carried), s0, first);
    } else {
        double lo = first, hi = n + 1, m = whole(0.5 * (first + n));
        if (rise_change(a0, t->au, ju, n, &e) < dv - room) return 0;
        for (int i = 0; i < NEWTON_STEPS && hi - lo > 1; i++) {
            if (!(m > lo && m < hi)) m = whole(0.5 * (lo + hi));
            if (m <= lo || m > n) { if (hi > n) { m = n; } else break; }
            double rise = rise_change(a0, t->au, ju, m, &e);
            double f = rise - rise_change(0, t->ad, jd, n - m, &g) - dv;
            if (f > 0) hi = m; else lo = m;
            if (lo >= n) break;
            m = e + g > 0 ? whole(m - f / (e + g) + (f > 0 ? 0 : 0.999)) : whole(0.5 * (lo + hi));
        }
        s = zero = lo; r = n - lo;
        double ahead = rise_change(a0, t->au, ju, s, &e);
        if (lo < n) {
            double short_drop = rise_change(0, t->ad, jd, r - 1, &g);
            if (ahead - short_drop >= dv) r = side_length(0, t->ad, jd, ahead - dv, r - 1, r);
            else {
                r -= 1; zero += 1;
                s = side_length(a0, t->au, ju, dv + short_drop, s, zero);
            }
        } else if (fabs(ahead - dv) > room) return 0;
    }
    if (t->v0 + rise_change(a0, t->au, ju, s, &e) > t->vmax) {
        double top = most(t->vmax, t->v0 + carried);
        s = side_length(a0, t->au, ju, top - t->v0, s0, s);
        r = side_length(0, t->ad, jd, top - t->v1, 0, r);
    }
    side(y, from, 1, 1, a0, t->au, ju, s);
    side(y, from + n, -1, -1, 0, t->ad, jd, r);
    sj_node(y, from + n, 0);
    if (dv >= carried) {
        double l = side_length(a0, t->au, ju, dv, s0, s);
        side(x, from, 1, 1, a0, t->au, ju, l);
    } else {
        side(x, from, 1, 1, a0, t->au, ju, s0);
        side(x, from + n, -1, -1, 0, t->ad, jd, side_length(0, t->ad, jd, carried - dv, 0, r));
    }
    sj_node(x, from + n, 0);
    return 1;
}

/* Two paths of n cycles to (v1, 0) whose mixes keep both jerks, as one_crossing. */
static int pair(const task *t, double n, path *x, path *y)
{
    x->count = y->count = 0;
    if (t->a0 >= 0) {
        int ok = one_crossing(t, 0, n, x, y);
        if (ok != 1) return ok;
    } else {
        double back = up(-t->a0 / t->jd), last = back - 1, left = t->a0 + t->jd * last;
        double v = t->v0 + last * (t->a0 + t->jd * last / 2) + left / 2;
        task u = *t;
        u.v0 = v; u.a0 = 0;
        int ok = 0;
        if (v < -t->vmax * (1 + SLACK)) ok = -1;
        else if (n >= back) {
            sj_node(y, 0, t->a0); sj_node(x, 0, t->a0);
            sj_node(y, last, left); sj_node(x, last, left);
            ok = one_crossing(&u, back, n - back, x, y);
        }
        if (ok != 1) {
            /* never up at all: one jerk is enough */
            summit m = {0, 0, 0};
            double at_once = -t->a0 / t->jd, dv = t->v0 - t->v1;
            double carry = rise_change(-t->a0, t->ad, t->jd, at_once, &v);
            x->count = y->count = 0;
            if (dv < carry || ok < 0) return ok;
            if (!extreme(t, t->jd, n, &m, y)) return 0;
            for (int i = 0; i < y->count; i++)
                if (y->a[i] > 0) return 0;
            double l = side_length(-t->a0, t->ad, t->jd, dv, at_once, n);
            side(x, 0, 1, -1, -t->a0, t->ad, t->jd, l);
            sj_node(x, n, 0);
        }
    }
    double reach = velocity_scale(t, most(t->ju, t->jd), n), dv = t->v1 - t->v0;
    return x->k[x->count - 1] <= n && fabs(sj_path_change(x) - dv) <= 1e-13 * reach
        && fabs(sj_path_change(y) - dv) <= 1e-13 * reach ? 1 : -1;
}

/* A mix of exactly n cycles under two jerks. The paths to mix lie in a chain, each two neighbours
   with the same signs: furthest up, up without return, down without return, furthest down. */
static int mix_sides(const task *t, double n, double *nearest, summit *m, sj_plan *p)
{
    path up_far, up_near, down_far, down_near, z;
    double far, near = 0, low, below = 0, room = mix_room(t, n, t->h);
    /* where the last length fell short of being low enough, look at the low ones first */
    int low_first = *nearest > -INFINITY;
    for (int i = 0; i < 2; i++)
        if ((i == 0) == low_first) {
            task o = mirrored(t);
            int ok = pair(&o, n, &down_near, &down_far);
            if (ok == 0) return 0;
            if (ok < 0) return mix_with(t, least(t->ju, t->jd), n, nearest, m, p);
            for (int k = 0; k < down_far.count; k++) down_far.a[k] = -down_far.a[k];
            for (int k = 0; k < down_near.count; k++) down_near.a[k] = -down_near.a[k];
            low = sj_path_distance(&down_far, t->v0);
            below = sj_path_distance(&down_near, t->v0);
            if (low > t->h + room) { *nearest = low; return 0; }
            if (below >= t->h) {
                mixed(t, n, &down_far, low, &down_near, below, &z);
                return mix_put(t, &z, p);
            }
        } else {
            int ok = pair(t, n, &up_near, &up_far);
            if (ok == 0) return 0;
            if (ok < 0) return mix_with(t, least(t->ju, t->jd), n, nearest, m, p);
            far = sj_path_distance(&up_far, t->v0);
            near = sj_path_distance(&up_near, t->v0);
            if (far < t->h - room) { *nearest = far; return 0; }
            if (near <= t->h) {
                mixed(t, n, &up_near, near, &up_far, far, &z);
                return mix_put(t, &z, p);
            }
        }
    mixed(t, n, &down_near, below, &up_near, near, &z);
    return mix_put(t, &z, p);
}

int sj_mix(const task *t, double n, double *nearest, summit *m, sj_plan *p)
{
    if (!(n >= 1 && n < 67108864.0)) return 0;
    return t->ju == t->jd ? mix_with(t, t->ju, n, nearest, m, p) : mix_sides(t, n, nearest, m, p);
}

/* The first length from n on that can be mixed, below `longest`; gives up where waiting longer only
   leads away. Too short a length tells how many cycles at the velocity limit are missing at
   least. */
int sj_mix_from(const task *t, double *n, double longest, summit *m, sj_plan *p)
{
    double last = INFINITY, at = 0;
    for (int i = 0; i < LENGTH_STEPS && *n < longest; i++) {
        double nearest = last < INFINITY ? last : -INFINITY, before = nearest, step = 1;
        if (sj_mix(t, *n, &nearest, m, p)) return 1;
        if (nearest > last) return 0;
        if (nearest != before) {
            if (nearest < t->h) step = up((t->h - nearest) / t->vmax);
            else {
                /* blocked from above, but coming down ever faster: part of the way at once */
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
