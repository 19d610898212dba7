/* Rows that are planned at once, a lane each, and what is done in all lanes alike. Private to _lanes.c and
   _lanes_peak.h.

   Never here: a branch between lanes. */
#pragma once
#include "planner/_internal.h" /* the task, and what all files of the planner share */

typedef double lane[SJ_LANES];

typedef struct {
    lane h, v0, a0, v1, vmax, au, ju, ad, jd, sign, first; /* the task, pushed up */
    lane up, down;                                         /* au / ju and ad / jd */
    lane vs, vz, t0, p0, low;                              /* the family of peaks */
    lane at_low, room, direct, short_of, at_top;
    lane peak, z1, z2, optimum, j1; /* of the continuous plan */
    lane n1, n2, n3, n4, n5, n6;    /* of the plan in whole cycles */
    lane v, a, c;                   /* cruise velocity and first level; its per_level() */
    lane more;                      /* a cycle could be taken away: perhaps another one */
    lane least_cycles;
    lane ok; /* 1, or 0 for a lane that has left this way */
    /* the root: of the peak */
    lane z, base, per_ju, per_jd, per_au, per_ad, per_jb, least_z, most_z, scale, jerk, level, x, m,
        t, unit, active;
} lanes;

/* Inlined into each clone of SIMD, or the loops have no wide vectors. */
#if defined(__GNUC__)
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif
#define EACH_LANE(i) for (int32_t i = 0; i < SJ_LANES; i++)

INLINE double pick(int which, double yes, double no) { return which ? yes : no; }
INLINE double size(double x) { return x < 0.0 ? -x : x; }

/* Beyond this a sum with `shift` below does not round to whole numbers. */
static const double roundable = 0x1p50;

/* down() and up() of _internal.h within `roundable`. */
INLINE double lower(double x)
{
    const double shift = 0x1.8p52; /* where neighbours are 1 apart */
    x += SLACK * (1.0 + size(x));
    double near = (x + shift) - shift;
    return near - pick(near > x, 1.0, 0.0);
}
INLINE double upper(double x)
{
    const double shift = 0x1.8p52;
    x -= SLACK * (1.0 + size(x));
    double near = (x + shift) - shift;
    return near + pick(near < x, 1.0, 0.0);
}

/* whole() of _internal.h of what is not negative. */
INLINE double whole_of(double x)
{
    const double shift = 0x1.8p52;
    double near = (x + shift) - shift;
    return near - pick(near > x, 1.0, 0.0);
}

/* Any lane? */
INLINE int some(const double *flags)
{
    double sum = 0.0;
    EACH_LANE(i)
    sum += flags[i];
    return sum > 0.0;
}

/* ramp_time() of _internal.h; ratio = amax / jerk. */
INLINE double time_of_ramp(double x, double amax, double jerk, double ratio)
{
    int flat = x * jerk >= amax * amax;
    double share = x / pick(flat, amax, jerk);
    return pick(flat, share + ratio, 2 * sqrt(share));
}
