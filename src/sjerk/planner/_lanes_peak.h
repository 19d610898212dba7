/* Ramp, cruise, ramp of several rows at once, in continuous time: see _lanes.c. What of sj_plan_move() comes
   before the root, begin_attempt() of _direct.c, family_peak() of _seven.c.

   Never here: whole cycles. */
#pragma once
#include <float.h>          /* DBL_MAX */
#include "base/_math.h"     /* cube roots */
#include "planner/_lanes.h" /* the lanes */

/* sj_plan_move() and begin_attempt() up to the first family: limits, direction, what is left to others. */
INLINE void begin(lanes *m)
{
    EACH_LANE(i)
    {
        double h = m->h[i], v0 = m->v0[i], a0 = m->a0[i], v1 = m->v1[i], vmax = m->vmax[i];
        double ua = m->au[i], uj = m->ju[i], da = m->ad[i], dj = m->jd[i];
        double small = least(uj, dj), most_a = least(ua, da);
        /* sj_recover_acceleration() where there is nothing to recover: the acceleration can end on a node */
        double room = 1.99 * small * (vmax - size(v0) - 2 * small), away = pick(h < 0, -a0, a0);
        double speed = pick(h < 0, -v0, v0), jerk = pick(away > 0, uj, dj), a = size(a0);
        double share = a / jerk, n = whole_of(share), left = a - n * jerk;
        double at_zero = pick(away > 0, speed, -speed) + n * (a - n * jerk / 2);
        left = pick(left <= 1e-13 * a, 0, left);
        int lands = (at_zero + left / 2 <= vmax * (1 + SLACK / 2)) &
                    (size(v0) <= vmax * (1 + SLACK)) & (share < roundable);
        /* sj_valid(), and no recovery; comparisons of what is no number are false */
        int ok = (size(h) <= DBL_MAX) & (h != 0) & (size(v0) <= DBL_MAX) & (vmax > 0) &
                 (vmax <= DBL_MAX) & (ua > 0) & (ua <= DBL_MAX) & (uj > 0) & (uj <= DBL_MAX) &
                 (da > 0) & (da <= DBL_MAX) & (dj > 0) & (dj <= DBL_MAX) &
                 (size(v1) <= vmax * (1 + SLACK)) & (a <= most_a) & ((a * a <= room) | lands);
        double d = pick(h < 0, -1, 1);
        double first = d * a0;
        /* with h > 0 only an acceleration against it turns the push */
        int turned = first < 0;
        double e = pick(turned, -d, d);
        m->first[i] = pick(turned, -first, first);
        m->a0[i] = m->first[i];
        m->h[i] = e * h;
        m->v0[i] = e * v0;
        m->v1[i] = e * v1;
        m->sign[i] = e;
        m->au[i] = pick(turned, da, ua);
        m->ju[i] = pick(turned, dj, uj);
        m->ad[i] = pick(turned, ua, da);
        m->jd[i] = pick(turned, uj, dj);
        m->up[i] = m->au[i] / m->ju[i];
        m->down[i] = m->ad[i] / m->jd[i];
        m->ok[i] = pick(ok, 1.0, 0.0);
    }
}

/* sj_family_of() for a0 >= 0, and sj_family_distance() of its lowest peak. */
INLINE void first_family(lanes *m)
{
    EACH_LANE(i)
    {
        double a0 = m->a0[i], b = a0 / m->ju[i], w = a0 * b / 2;
        double vs = m->v0[i] - w, vz = m->v0[i] + w, p0 = -b * (vs + a0 * b / 6);
        double low = most(vz, m->v1[i]);
        double t1 = time_of_ramp(most(0, low - vs), m->au[i], m->ju[i], m->up[i]);
        double t2 = time_of_ramp(most(0, low - m->v1[i]), m->ad[i], m->jd[i], m->down[i]);
        m->vs[i] = vs;
        m->vz[i] = vz;
        m->t0[i] = -b;
        m->p0[i] = p0;
        m->low[i] = low;
        m->at_low[i] = p0 + (low + vs) / 2 * t1 + (low + m->v1[i]) / 2 * t2;
        m->room[i] = 1e-14 * (size(m->h[i]) + size(m->at_low[i]));
        m->direct[i] = -b + t1 + t2;
        m->active[i] = pick(m->h[i] < m->at_low[i] - m->room[i], m->ok[i], 0.0);
    }
}

/* begin_attempt() where h is nearer than the lowest peak: the task is turned again. */
INLINE void second_family(lanes *m)
{
    EACH_LANE(i)
    {
        int turned = m->active[i] > 0;
        double h = -m->h[i], v0 = -m->v0[i], a0 = -m->a0[i], v1 = -m->v1[i];
        double au = m->ad[i], ju = m->jd[i], ad = m->au[i], jd = m->ju[i], up = m->down[i],
               dn = m->up[i];
        int against = a0 < 0;
        double b = pick(against, -a0, a0) / pick(against, jd, ju), half = a0 * b / 2;
        double vs = pick(against, v0 + half, v0 - half), vz = v0 + half;
        double p0 = pick(against, b * (v0 + a0 * b / 3), -b * (vs + a0 * b / 6));
        double low = most(vz, v1);
        double t1 = time_of_ramp(most(0, low - vs), au, ju, up);
        double t2 = time_of_ramp(most(0, low - v1), ad, jd, dn);
        double at_low = p0 + (low + vs) / 2 * t1 + (low + v1) / 2 * t2;
        double short_of = m->at_low[i] - m->h[i];
        /* an eased braking; a head with two jerks */
        int eased = ((h >= at_low - m->room[i]) | (vz <= v1)) ^ 1;
        int leaves = eased | ((ju != jd) & against);
        m->direct[i] = pick(turned, m->direct[i], 0.0);
        m->short_of[i] = pick(turned, short_of, 0.0);
        m->ok[i] = pick(turned & leaves, 0.0, m->ok[i]);
        m->h[i] = pick(turned, h, m->h[i]);
        m->v0[i] = pick(turned, v0, m->v0[i]);
        m->a0[i] = pick(turned, a0, m->a0[i]);
        m->first[i] = pick(turned, -m->first[i], m->first[i]);
        m->v1[i] = pick(turned, v1, m->v1[i]);
        m->sign[i] = pick(turned, -m->sign[i], m->sign[i]);
        m->au[i] = pick(turned, au, m->au[i]);
        m->ju[i] = pick(turned, ju, m->ju[i]);
        m->ad[i] = pick(turned, ad, m->ad[i]);
        m->jd[i] = pick(turned, jd, m->jd[i]);
        m->up[i] = pick(turned, up, m->up[i]);
        m->down[i] = pick(turned, dn, m->down[i]);
        m->vs[i] = pick(turned, vs, m->vs[i]);
        m->vz[i] = pick(turned, vz, m->vz[i]);
        m->t0[i] = pick(turned, pick(against, b, -b), m->t0[i]);
        m->p0[i] = pick(turned, p0, m->p0[i]);
        m->low[i] = pick(turned, low, m->low[i]);
        m->at_low[i] = pick(turned, at_low, m->at_low[i]);
    }
}

/* sj_family_distance() of the velocity limit, and where family_peak() begins. */
INLINE void begin_peak(lanes *m)
{
    EACH_LANE(i)
    {
        double vmax = m->vmax[i], vs = m->vs[i], v1 = m->v1[i];
        double t1 = time_of_ramp(most(0, vmax - vs), m->au[i], m->ju[i], m->up[i]);
        double t2 = time_of_ramp(most(0, vmax - v1), m->ad[i], m->jd[i], m->down[i]);
        double at_top = m->p0[i] + (vmax + vs) / 2 * t1 + (vmax + v1) / 2 * t2;
        double x = m->h[i] - m->at_low[i];
        m->at_top[i] = at_top;
        m->x[i] = x;
        int cruise = at_top <= m->h[i], lowest = x <= 0;
        m->peak[i] = pick(cruise, vmax, m->low[i]);
        m->active[i] = pick(cruise | lowest, 0.0, m->ok[i]);
    }
}

/* family_peak(): where it begins. */
INLINE void guess_peak(lanes *m, int one_jerk)
{
    EACH_LANE(i)
    {
        double ju = m->ju[i], jd = m->jd[i], au = m->au[i], ad = m->ad[i], jerk = ju, level = au;
        if (!one_jerk) {
            double q = 2 / (1 / sqrt(ju) + 1 / sqrt(jd));
            jerk = pick(jd != ju, q * q, ju);
            level = pick(ad != au, 2 * au * ad / (au + ad), au);
        }
        m->jerk[i] = jerk;
        m->level[i] = level;
        m->t[i] = m->x[i] * m->x[i] * jerk / 4;
    }
    EACH_LANE(i)
    {
        cube_guess g = cube_begin(m->t[i]);
        m->m[i] = g.m;
        m->t[i] = g.t;
        m->unit[i] = g.unit;
    }
    EACH_LANE(i)
    {
        int second = m->v1[i] >= m->vs[i];
        double base = most(m->vs[i], m->v1[i]), jb = pick(second, m->jd[i], m->ju[i]);
        double lo = sqrt(most(0, (m->low[i] - base) * jb)),
               hi = sqrt(most(0, (m->vmax[i] - base) * jb));
        double jh = m->jerk[i], ah = m->level[i], x = m->x[i], q = ah / jh;
        double v = cube_refined(m->m[i], m->t[i]) * m->unit[i]; /* of what is not negative */
        double flat = 0.5 * (sqrt(ah * (ah * q * q + 4 * x)) - ah * q);
        v = pick(v * jh > ah * ah, flat, v);
        double z = sqrt(most(0, (v + m->low[i] - base) * jb));
        z = pick(z < hi, z, hi);
        z = pick(z < lo, lo, z);
        m->z[i] = z;
        m->base[i] = base;
        m->per_ju[i] = 1 / m->ju[i];
        m->per_jd[i] = 1 / m->jd[i];
        m->per_au[i] = 1 / m->au[i];
        m->per_ad[i] = 1 / m->ad[i];
        m->per_jb[i] = pick(second, m->per_jd[i], m->per_ju[i]);
        m->least_z[i] = lo;
        m->most_z[i] = hi;
        m->scale[i] = 1e-13 * (size(m->h[i]) + size(m->at_low[i]));
    }
}

/* family_peak(): one step of the root. */
INLINE void step_peak(lanes *m)
{
    EACH_LANE(i)
    {
        double vs = m->vs[i], v1 = m->v1[i], z = m->z[i], per_jb = m->per_jb[i], lo = m->least_z[i],
               hi = m->most_z[i];
        double ju = m->ju[i], jd = m->jd[i], au = m->au[i], ad = m->ad[i];
        double per_au = m->per_au[i], per_ad = m->per_ad[i];
        int second = v1 >= vs, runs = m->active[i] > 0;
        double square = z * z * per_jb, v = m->base[i] + square;
        double x1 = pick(second, v - vs, square), x2 = pick(second, square, v - v1);
        double r = sqrt(most(pick(second, x1, x2), 0) * pick(second, ju, jd)),
               per_both = 1 / (r * z);
        double r1 = pick(second, r, z), r2 = pick(second, z, r);
        int flat1 = x1 * ju >= au * au, flat2 = x2 * jd >= ad * ad;
        double t1 = pick(flat1, x1 * per_au + au * m->per_ju[i], 2 * r1 * m->per_ju[i]);
        double t2 = pick(flat2, x2 * per_ad + ad * m->per_jd[i], 2 * r2 * m->per_jd[i]);
        double d1 = pick(flat1, per_au, per_both * r2), d2 = pick(flat2, per_ad, per_both * r1);
        double c1 = pick(flat1, 0, -0.5 * ju * d1 * d1 * d1);
        double c2 = pick(flat2, 0, -0.5 * jd * d2 * d2 * d2);
        double s1 = v + vs, s2 = v + v1, e = m->p0[i] + 0.5 * (s1 * t1 + s2 * t2) - m->h[i];
        hi = pick(e > 0, z, hi);
        lo = pick(e > 0, lo, z);
        int met = size(e) <= m->scale[i];
        double by_v = 0.5 * (t1 + t2 + s1 * d1 + s2 * d2);
        double by_v2 = d1 + d2 + 0.5 * (s1 * c1 + s2 * c2);
        double dv = 2 * z * per_jb, slope = by_v * dv, bend = by_v2 * dv * dv + by_v * 2 * per_jb;
        double next = z - e * slope / (slope * slope - 0.5 * e * bend);
        int inside = (next > lo) & (next < hi);
        next = pick(inside, next, 0.5 * (lo + hi));
        int last = size(next - z) <= pick(inside, CLOSE, SAME) * z;
        m->least_z[i] = lo;
        m->most_z[i] = hi;
        m->z[i] = pick(runs & !met, next, z);
        m->active[i] = pick(runs & !met & !last, 1.0, 0.0);
    }
}
