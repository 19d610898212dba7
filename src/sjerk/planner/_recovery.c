/* Recovery of the acceleration: a start beyond its acceleration limit, or carried out of its velocity
   limit by its acceleration, is brought back as fast as jerk allows, with the least excess that whole
   cycles allow. And the acceleration brought to zero, which decides what "carried out" means.

   Zero acceleration on a node costs velocity: from a > 0 what is left after the cycles of full jerk
   still adds left / 2. A cycle that crosses zero with jerk j adds left^2 / 2j only, and leaves an
   acceleration the other way, j - left, which has to be brought to zero in its turn. With the
   velocity limit w the crossing to take is the gentlest that keeps it, j = left^2 / 2(w - v): any
   other leaves both less room and more acceleration on the other side. So whether a start can keep
   w is decided by following these crossings (can_cross), and the least w it can keep is the excess
   that nobody avoids (hardest_crossing); docs/explanation/planner.md has the proof.

   Only phases are laid down here; a cycle that crosses zero has the smaller of two jerks.

   Never here: a velocity above its limit (_settling.c), a distance to be met, a target. */
#include "planner/_internal.h"

/* Crossings of zero one after another. More than one are needed only where a cycle of acceleration is
   more than the velocity limit twice over; and each takes such a start nearly six times farther from
   those that swing for ever, so more than these are needed by one in 10^9. */
enum { CROSSINGS = 12 };

/* Where full jerk leads: after n cycles `left` of the acceleration, less than one cycle's jerk, at
   velocity v; both with the sign of a0 taken out.
       left = |a0| - n J,   v = v0 + n |a0| - n^2 J / 2 */
typedef struct {
    double n, left, v;
} brink;

static brink brink_of(const task *t)
{
    double a = fabs(t->a0), j = t->a0 > 0 ? t->ju : t->jd, v = t->a0 > 0 ? t->v0 : -t->v0;
    double n = whole(a / j), left = a - n * j;
    if (left <= 1e-13 * a)
        left = 0;
    return (brink){n, left, v + n * (a - n * j / 2)};
}

/* Most jerk of a cycle that crosses zero, with `beyond` the acceleration limit on the other side. */
static double most_crossing_jerk(const task *t, double left, double beyond)
{
    return least(smaller_jerk(t), left + beyond);
}

/* Whether the velocity can be kept within w from the brink, by one crossing after another. */
static int can_cross(const task *t, brink b, double w)
{
    double beyond = t->a0 > 0 ? t->ad : t->au, other = t->a0 > 0 ? t->au : t->ad;
    double v = b.v, a = b.left;
    for (int i = 0; i < CROSSINGS; i++) {
        if (v + a / 2 <= w)
            return 1;
        double room = w - v, j = a * a / (2 * room);
        if (!(room > 0 && j <= most_crossing_jerk(t, a, beyond) * (1 + 1e-14)))
            return 0;
        double swap = beyond;
        beyond = other;
        other = swap;
        v = j / 2 - a - v;
        a = j - a;
    }
    return 0;
}

/* The least velocity limit that one crossing at most can keep, and its jerk: where none keeps the
   start's own. A harder crossing peaks lower and falls deeper on the other side. Both are equal at
       v + left^2 / 2j = j - 3 left / 2 - v,   j = b + sqrt(b^2 + left^2 / 2),   b = v + 3 left / 4.
   0: zero on the node is the least. */
static double hardest_crossing(const task *t, brink b)
{
    double a = b.left, most_j = most_crossing_jerk(t, a, t->a0 > 0 ? t->ad : t->au);
    if (!(a < most_j))
        return 0;
    double half = b.v + 0.75 * a;
    return least(most_j, half + sqrt(half * half + a * a / 2));
}

/* Whether the acceleration can end on a node without costing the velocity limit. */
int sj_lands(const task *t)
{
    brink b = brink_of(t);
    return b.v + b.left / 2 <= t->vmax * (1 + SLACK / 2);
}

/* Full jerk, and a last cycle that crosses zero with jerk j, or ends there where j is none. */
static void put_crossing(task *t, double j, sj_plan *p)
{
    double d = t->a0 > 0 ? t->sign : -t->sign, full = t->a0 > 0 ? t->ju : t->jd;
    brink b = brink_of(t);
    sj_plan q;
    sj_begin(&q);
    sj_put(&q, b.n, -d * full);
    if (b.left > 0)
        sj_put(&q, 1, -d * most(j, b.left));
    *t = sj_resume(t, &q);
    if (!(j > b.left))
        t->a0 = 0;
    sj_append(p, &q);
}

/* Acceleration to zero, on a node. */
void sj_end_acceleration(task *t, sj_plan *p) { put_crossing(t, 0, p); }

/* Crosses zero, each time with the gentlest jerk, until the acceleration can end on a node. */
void sj_cross_gently(task *t, sj_plan *p)
{
    for (int i = 0; i < CROSSINGS && !sj_lands(t); i++) {
        brink b = brink_of(t);
        double j = most_crossing_jerk(t, b.left, t->a0 > 0 ? t->ad : t->au);
        double room = most(0, t->vmax - b.v), slack = t->vmax * SLACK / 2;
        if (fabs(t->vmax - b.v) < slack) /* at the limit, as sj_keeps() has it: it is not above */
            room = slack;
        /* no room: the most jerk that serves */
        put_crossing(t, room > 0 ? least(j, b.left * b.left / (2 * room)) : j, p);
    }
}

/* One crossing with the most jerk that serves; whether the acceleration can end on a node then. */
int sj_cross_hard(task *t, sj_plan *p)
{
    put_crossing(t, hardest_crossing(t, brink_of(t)), p);
    return sj_lands(t);
}

/* Whether whole cycles can keep the velocity limit until the acceleration is zero. */
int sj_keeps(const task *t) { return can_cross(t, brink_of(t), t->vmax * (1 + SLACK / 2)); }

int32_t sj_plan_keeps(double v, double a, const sj_limits *l)
{
    double up = a < 0.0 ? -1.0 : 1.0;
    task t = {0.0,     up * v,          up * a,
              0.0,     l->velocity,     l->acceleration,
              l->jerk, l->deceleration, l->deceleration_jerk,
              1.0,     up * a,          0.0};
    return sj_keeps(&t);
}

/* Above its acceleration limit: full jerk down to it. The last cycle ends at the limit, unless that
   little of jerk spared costs the velocity limit. */
static void ease_to_acceleration(task *t, sj_plan *p)
{
    double amax = t->a0 > 0 ? t->au : t->ad, j = t->a0 > 0 ? t->ju : t->jd;
    double d = t->a0 > 0 ? t->sign : -t->sign, above = fabs(t->a0) - amax;
    if (!(above > SLACK * amax))
        return;
    sj_plan q;
    sj_begin(&q);
    sj_put(&q, down(above / j), -d * j);
    task u = sj_resume(t, &q);
    double left = fabs(u.a0) - amax;
    if (left > SLACK * amax)
        sj_put(&q, 1, -d * left);
    u = sj_resume(t, &q);
    if (!sj_keeps(&u)) {
        sj_begin(&q);
        sj_put(&q, least(up(above / j), brink_of(t).n), -d * j);
        u = sj_resume(t, &q);
    }
    *t = u;
    sj_append(p, &q);
}

/* The acceleration of a start is brought inside its limit as fast as jerk allows, and to where it
   carries the velocity no further. Returns whether it can end on a node then: if not, only a cycle
   that crosses zero keeps the velocity limit. */
int sj_recover_acceleration(task *t, sj_plan *p)
{
    double small = smaller_jerk(t);
    if (fabs(t->a0) <= smaller_acceleration(t) &&
        t->a0 * t->a0 <= 1.99 * small * (t->vmax - fabs(t->v0) - 2 * small))
        return 1;
    ease_to_acceleration(t, p);
    double amax = (t->a0 > 0 ? t->au : t->ad) * (1 + SLACK);
    if (!sj_keeps(t)) {
        if (!sj_cross_hard(t, p) && !sj_keeps(t))
            sj_end_acceleration(t, p);
    } else if (fabs(t->a0) > amax || fabs(t->v0) > t->vmax * (1 + SLACK)) {
        sj_cross_gently(t, p);
        if (fabs(t->a0) > amax)
            sj_end_acceleration(t, p);
    }
    return sj_lands(t);
}
