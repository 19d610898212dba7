/* The fewest cycles in which an end with any velocity and acceleration can be met, under one jerk limit.

   Of all paths of n cycles from (v0, a0) to (v1, a1) the one that gets furthest rises as long as it can and
   falls at the last moment,
       a_k = max(low_k, min(high_k, J (s - k))),
       high_k = min(a0 + J k, A, a1 + J (n - k)),   low_k = max(a0 - J k, -D, a1 - J (n - k)),
   s a real number found from the change of velocity, which grows with it; a cruise at the velocity limit
   parts the falling line in two. Its mirror image gets least far. n serves where h lies between them, and
   then their convex combination is the plan (_convex.c).

   As n grows by one, the furthest path gets further by the velocity at its zero of acceleration, which
   itself grows with n. So where it gets is a convex function of n: it may fall first (while the axis must
   move away from the target) and rises then. The cycles in which it does not reach h are one gap, or none;
   so are those in which the other one cannot stay behind h, and those in which the velocity cannot be
   changed as asked. Each gap is left by doubled steps and a bisection (leave_gap), in turns, until n
   lies in none.

   Never here: two jerks (all cycles keep the smaller one), starts and ends that must cross zero inside
   a cycle (_recovery.c). */
#include "planner/_internal.h"

enum { DOUBLINGS = 50, TURNS = 6 };

/* What a number of cycles is good for. */
enum { CHANGES = 1, REACHES = 2, STAYS_BEHIND = 4, SERVES = 7 };

typedef struct {
    const task *t;
    double j, a1;
    double rise[2],
        fall[2]; /* cycles up to the velocity limit and down from it; up, and mirrored */
} ends;

static double level(const task *t, const ends *e, double n, double s, double r, double k)
{
    double j = e->j, a0 = t->a0, a1 = e->a1;
    double mid = k < s ? j * (s - k) : n - k < r ? -j * (r - (n - k)) : 0;
    double high = least(least(a0 + j * k, t->au), a1 + j * (n - k));
    double low = most(most(a0 - j * k, -t->ad), a1 - j * (n - k));
    return most(low, least(high, mid));
}

/* The nodes of that path: the cycles next to the places where its lines meet. */
static void lay(const task *t, const ends *e, double n, double s, double r, path *x)
{
    double j = e->j, a0 = t->a0 / j, a1 = e->a1 / j, up_ = t->au / j, down_ = t->ad / j;
    double z = n - r;
    const double kink[] = {up_ - a0,
                           n - up_ + a1,
                           (n + a1 - a0) / 2,
                           a0 + down_,
                           n - a1 - down_,
                           (n + a0 - a1) / 2,
                           s - up_,
                           s + down_,
                           (s - a0) / 2,
                           (s + n - a1) / 2,
                           s,
                           z,
                           z + down_,
                           (z + n - a1) / 2};
    enum { KINKS = sizeof kink / sizeof kink[0] };
    double k[2 * KINKS + 2];
    int c = 0;
    k[c++] = 0;
    for (int i = 0; i < KINKS; i++)
        for (int after = 0; after < 2; after++) {
            double q = kink[i] > -1 && kink[i] < n ? whole(kink[i]) + after : 0;
            int at = c;
            if (!(q > 0 && q < n))
                continue;
            for (; k[at - 1] > q; at--)
                ;
            if (k[at - 1] == q)
                continue;
            for (int l = c++; l > at; l--)
                k[l] = k[l - 1];
            k[at] = q;
        }
    k[c++] = n;
    x->count = 0;
    for (int i = 0; i < c; i++) {
        double a = i == 0 ? t->a0 : i == c - 1 ? e->a1 : level(t, e, n, s, r, k[i]);
        /* the node before this one goes when it lies on a straight line */
        if (x->count >= 2) {
            int b = x->count - 1;
            double d1 = x->k[b] - x->k[b - 1], d2 = k[i] - x->k[b];
            if (fabs((x->a[b] - x->a[b - 1]) * d2 - (a - x->a[b]) * d1) <= 1e-13 * j * d1 * d2)
                x->count--;
        }
        x->k[x->count] = k[i];
        x->a[x->count++] = a;
    }
}

/* Whether n cycles can change the velocity by dv: as little as they can, and as much. */
static int brackets(const task *t, const ends *e, double n, double dv)
{
    path x;
    double room = 1e-12 * (sj_velocity_scale(t, e->j, n) + n * fabs(e->a1));
    lay(t, e, n, -2 * n, 3 * n, &x);
    if (sj_path_change(&x) > dv + room)
        return 0;
    lay(t, e, n, 3 * n, -2 * n, &x);
    return sj_path_change(&x) >= dv - room;
}

/* The furthest path of n cycles; 0 where the velocity cannot be changed so. */
static int furthest(const task *t, const ends *e, int side, double n, path *x)
{
    double j = e->j, dv = t->v1 - t->v0, s = e->rise[side], r = e->fall[side];
    double tiny = 4e-16 * (sj_velocity_scale(t, j, n) + n * fabs(e->a1));
    if (n < fabs(e->a1 - t->a0) / j * (1 - SLACK))
        return 0;
    if (s + r <= n)
        lay(t, e, n, s, r, x);
    else {
        /* the falling line goes through zero without a rest */
        double lo = -n - (fabs(t->a0) + fabs(e->a1) + t->ad) / j, hi = 2 * n - lo, f = 0;
        s = least(hi, most(lo, s - 0.5 * (s + r - n)));
        if (!(s > lo && s < hi))
            s = 0.5 * (lo + hi);
        for (int i = 0; i < NEWTON_STEPS; i++) {
            lay(t, e, n, s, n - s, x);
            f = sj_path_change(x) - dv;
            if (fabs(f) <= tiny)
                break;
            if (f > 0)
                hi = s;
            else
                lo = s;
            /* each node on the falling line moves by J */
            double on = 0, next;
            for (int k = 1; k < x->count; k++)
                if (fabs(x->a[k] - x->a[k - 1] + j * (x->k[k] - x->k[k - 1])) <= 1e-9 * j)
                    on += x->k[k] - x->k[k - 1];
            next = on > 0 ? s - f / (j * on) : 0.5 * (lo + hi);
            if (!(next > lo && next < hi) || i > NEWTON_STEPS / 2)
                next = 0.5 * (lo + hi);
            if (next == s || hi - lo <= 4e-16 * n)
                break;
            /* no root at all? asked late, since it is rare */
            if (i == 4 && !brackets(t, e, n, dv))
                return 0;
            s = next;
        }
        if (!(fabs(f) <= 1e-12 * (sj_velocity_scale(t, j, n) + n * fabs(e->a1))))
            return 0;
    }
    return fabs(sj_path_change(x) - dv) <= 1e-12 * (sj_velocity_scale(t, j, n) + n * fabs(e->a1));
}

/* Both extremes of n cycles, y up and x its mirror image: what n is good for, and how far each is beyond h
   where it is. */
typedef struct {
    path x, y;
    int good;
    double beyond, behind;
} extremes;

static void look(const ends *e, double n, extremes *z)
{
    const task *t = e->t;
    task o = mirrored(t);
    ends m = *e;
    m.a1 = -e->a1;
    z->good = 0;
    if (!furthest(t, e, 0, n, &z->y) || !furthest(&o, &m, 1, n, &z->x))
        return;
    for (int i = 0; i < z->x.count; i++)
        z->x.a[i] = -z->x.a[i];
    double most_v = t->vmax * (1 + 2 * SLACK), room = 2.5e-13 * fabs(t->h);
    if (sj_path_peak(&z->x, t->v0) > most_v || sj_path_peak(&z->y, t->v0) > most_v)
        return;
    z->beyond = sj_path_distance(&z->y, t->v0) - t->h + room;
    z->behind = t->h - sj_path_distance(&z->x, t->v0) + room;
    z->good = CHANGES | (z->beyond >= 0 ? REACHES : 0) | (z->behind >= 0 ? STAYS_BEHIND : 0);
}

/* How far a number of cycles is from being good for `what`: negative. */
static double margin(const extremes *z, int what)
{
    return !(z->good & CHANGES) ? NAN : what & REACHES ? z->beyond : z->behind;
}

/* The first n from *n on, up to `longest`, that is good for `what`; z is what is known of *n, which is not.
   0: there is none. A cycle adds at most V_max. Where a bisection by the margins leaves most of the gap, one
   by halves follows. */
static int leave_gap(const ends *e, int what, double longest, double *n, extremes *z)
{
    extremes y;
    double lo = *n, hi = lo, step = 1, below = margin(z, what), above = NAN;
    for (int i = 0;; i++, step *= 2) {
        if (hi >= longest || i == DOUBLINGS)
            return 0;
        double needs = what != CHANGES && below < 0 ? up(-below / e->t->vmax) : 1;
        hi = least(longest, lo + most(step, needs));
        look(e, hi, &y);
        above = margin(&y, what);
        if ((y.good & what) == what)
            break;
        lo = hi;
        below = above;
    }
    for (int halves = 0; hi - lo > 1;) {
        double wide = hi - lo, middle = whole((lo + hi) / 2);
        if (!halves && what != CHANGES && below < 0 && above >= 0)
            middle = whole(lo + wide * (-below / (above - below)));
        middle = least(hi - 1, most(lo + 1, middle));
        extremes w;
        look(e, middle, &w);
        if ((w.good & what) == what) {
            hi = middle;
            above = margin(&w, what);
            y = w;
        } else {
            lo = middle;
            below = margin(&w, what);
        }
        halves = hi - lo > 0.5 * wide;
    }
    *n = hi;
    *z = y;
    return 1;
}

/* Least time for a change of velocity from a0 to a1 by dv: up to the acceleration
       p = sqrt(J dv + (a0^2 + a1^2) / 2),   at most A,
   and down again; mirrored where going straight from a0 to a1 changes it by more. */
static double change_time(const task *t, double a1, double j)
{
    double a0 = t->a0, dv = t->v1 - t->v0, straight = (a0 + a1) * fabs(a1 - a0) / (2 * j);
    double d = dv >= straight ? 1 : -1, top = d > 0 ? t->au : t->ad;
    double p = sqrt(most(0, j * d * dv + (a0 * a0 + a1 * a1) / 2));
    if (p <= top)
        return (2 * p - d * (a0 + a1)) / j;
    double hold = (d * dv - (top * top - (a0 * a0 + a1 * a1) / 2) / j) / top;
    return (2 * top - d * (a0 + a1)) / j + hold;
}

/* From t to (v1, a1) at h in at least `n` and at most `longest` cycles. 0: not so. */
int sj_fewest(const task *t, double a1, double n, double longest, sj_plan *p)
{
    ends e = {t, smaller_jerk(t), a1, {0, 0}, {0, 0}};
    task o = mirrored(t);
    extremes z;
    for (int side = 0; side < 2; side++) {
        const task *u = side ? &o : t;
        double end = side ? -a1 : a1;
        e.rise[side] = sj_rise_cycles(u->a0, u->au, e.j, u->vmax - u->v0);
        e.fall[side] = sj_rise_cycles(-end, u->ad, e.j, u->vmax - u->v1);
        if (!(e.rise[side] >= 0 && e.fall[side] >= 0))
            return 0;
    }
    n = most(n, most(1, up(change_time(t, a1, e.j))));
    if (!(n <= longest))
        return 0;
    look(&e, n, &z);
    for (int i = 0; i < TURNS && z.good != SERVES; i++) {
        int lacks = !(z.good & CHANGES) ? CHANGES
                    : z.good & REACHES  ? CHANGES | STAYS_BEHIND
                                        : CHANGES | REACHES;
        if (!leave_gap(&e, lacks, longest, &n, &z))
            return 0;
    }
    return z.good == SERVES && sj_convex_of(t, n, &z.x, &z.y, p);
}
