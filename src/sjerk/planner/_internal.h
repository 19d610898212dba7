/* What the planner's files share: the task in its frame, whole cycles, plans under construction,
   node paths. Private to this room; its contract is _planner.h. */
#pragma once
#include <math.h> /* sqrt, cbrt, fma, fabs */
#include <stddef.h>
#include <stdint.h> /* int64_t cycles */
#include "planner/_planner.h"

/* relative room for rounding in counts and levels; a tenth of what is promised */
static const double SLACK = 1e-10;
enum {
    NEWTON_STEPS = SJ_ROOT_STEPS,
    DURATION_STEPS = SJ_DURATION_STEPS,
    SYNC_ROUNDS = SJ_SYNC_ROUNDS,
    NODES = 40
};
/* what the last step of a root moves it by, relative; where what is left is its third power */
static const double SAME = 1e-13, CLOSE = 1e-5;
static const double LONGEST = SJ_CYCLES_MAX;

/* A planning task with its limits turned so that "up" is the direction in which the move
   is pushed. */
typedef struct {
    double h, v0, a0, v1;
    double vmax;
    double au, ju; /* acceleration upward and the jerk while it points upward */
    double ad, jd; /* the same downward */
    double sign;   /* +1 or -1: how "up" lies in axis coordinates */
    double first;  /* acceleration at the start of the whole plan */
    double slip;   /* the target may lie further by up to this: it moves on, 0 where it does not */
} task;

static inline task mirrored(const task *t)
{
    return (task){-t->h, -t->v0, -t->a0, -t->v1,   t->vmax,   t->ad,
                  t->jd, t->au,  t->ju,  -t->sign, -t->first, -t->slip};
}

static inline double up(double x) /* whole cycles for x, rounding noise forgiven */
{
    x -= SLACK * (1.0 + fabs(x));
    if (!(fabs(x) < 4e18))
        return x;
    double n = (double)(int64_t)x;
    return n < x ? n + 1.0 : n;
}
static inline double down(double x)
{
    x += SLACK * (1.0 + fabs(x));
    if (!(fabs(x) < 4e18))
        return x;
    double n = (double)(int64_t)x;
    return n > x ? n - 1.0 : n;
}
/* floor() for numbers of cycles, without a call */
static inline double whole(double x)
{
    double n = (double)(int64_t)x;
    return n > x ? n - 1.0 : n;
}
static inline double least(double a, double b) { return a < b ? a : b; }
static inline double most(double a, double b) { return a > b ? a : b; }

/* What is legal whatever the sign of the acceleration. */
static inline double smaller_acceleration(const task *t) { return least(t->au, t->ad); }
static inline double smaller_jerk(const task *t) { return least(t->ju, t->jd); }

/* Above its velocity limit, and carried no further. */
static inline int is_above(const task *t)
{
    return fabs(t->v0) > t->vmax * (1 + SLACK) && !(t->v0 * t->a0 > 0);
}

/* Acceleration at whole cycles k, straight between: each piece is a phase. */
typedef struct {
    int count;
    double k[NODES], a[NODES];
} path;

/* Time of a change of velocity x >= 0 between states without acceleration:
       x / A + A / J where A is reached (x J >= A^2), else 2 sqrt(x / J). */
static inline double ramp_time(double x, double amax, double jerk)
{
    return x * jerk >= amax * amax ? x / amax + amax / jerk : 2 * sqrt(x / jerk);
}

/* Velocity a piece of the motion reaches at most, in magnitude: n cycles from (v, a) to acceleration
   b; at the end or where the acceleration crosses zero. */
static inline double piece_peak(double v, double n, double a, double b)
{
    double end = fabs(v + n * (a + b) / 2);
    return a * b < 0 ? most(end, fabs(v + n * a * a / (2 * (a - b)))) : end;
}
/* From the ground up: each file calls those above it here, and never one below. */

/* _task.c */
int sj_valid(double h, double v0, double a0, double v1, const sj_limits *l);
task sj_task_of(double h, double v0, double a0, double v1, const sj_limits *l);

/* _growing.c: the plan, and node paths */
void sj_begin(sj_plan *p);
void sj_put(sj_plan *p, double n, double jerk);
void sj_put_cruise(sj_plan *p, const task *t, double n);
void sj_append(sj_plan *p, const sj_plan *q);
void sj_note_scale(sj_plan *p, const sj_limits *l);
int sj_leaves_velocity(const task *t, const sj_plan *p, int64_t used);
task sj_resume(const task *start, const sj_plan *p);
double sj_path_change(const path *x);
double sj_path_distance(const path *x, double v);
double sj_path_peak(const path *x, double v);
void sj_path_put(sj_plan *p, const path *x, const task *t);
void sj_node(path *x, double k, double a);

/* _ramp.c */
int sj_ramp(double v0, double a0, double dv, double vmax, double au, double ad, double j, path *x);

int sj_ramp_in(const task *t, double dv, double j, double m, path *x);

/* _recovery.c */
int sj_lands(const task *t);
int sj_keeps(const task *t);
int sj_recover_acceleration(task *t, sj_plan *p);
void sj_cross_gently(task *t, sj_plan *p);
int sj_cross_hard(task *t, sj_plan *p);
void sj_end_acceleration(task *t, sj_plan *p);

/* _velocity.c */
int sj_go_to_velocity(task *t, double v, sj_plan *p);
int sj_velocity_in(const task *start, double m, sj_plan *p);

/* Ramp, cruise, ramp in continuous time: what does not depend on the peak velocity. */
typedef struct {
    /* virtual start without acceleration; velocity when the acceleration is brought to zero */
    double vs, vz;
    double t0, p0; /* what the virtual start adds to time and distance */
    double low;    /* lowest peak velocity of the family */
} family;

/* The same in whole cycles: lengths of the phases, cruise velocity and first level. The second ramp
   takes n5, n6, n5. */
typedef struct {
    double n1, n2, n3, n4, n5, n6;
    double v, a;
} seven;

static inline double seven_cycles(const seven *s)
{
    return s->n1 + s->n2 + s->n3 + s->n4 + 2 * s->n5 + s->n6;
}

/* _seven.c */
family sj_family_of(const task *t);
double sj_family_distance(const task *t, const family *f, double v);
int sj_by_cruise(const task *t, const family *f, double at_low, int far, seven *s, double *optimum);
int sj_seven_fit(const task *t, seven *s);
void sj_seven_shorten(const task *t, seven *s, double least_cycles, int round);
void sj_seven_put(sj_plan *p, const task *t, const seven *s);
void sj_even_counts(double x, double z, double amax, double jerk, double *rise, double *hold);
void sj_ramp_counts(double a0, double x, double z, double amax, double jerk, double jerk1,
                    double *n1, double *n2, double *n3);

/* What a search for a duration has learnt, for both directions: cycles up to the velocity limit, and
   down from it. */
typedef struct {
    int known;
    double s, r;
} summit;

/* _extreme.c */
double sj_velocity_scale(const task *t, double j, double n);
double sj_rise_change(double a0, double top, double j, double s, double *slope);
double sj_rise_cycles(double a0, double top, double j, double dv);
int sj_furthest(const task *t, double j, double n, summit *m, path *x);

/* _sides.c */
int sj_side_paths(const task *t, double n, path *x, path *y);

/* _convex.c */
int sj_convex(const task *t, double n, double *nearest, summit *m, sj_plan *p);
int sj_convex_of(const task *t, double n, const path *x, const path *y, sj_plan *p);
int sj_convex_from(const task *t, double *n, double longest, summit *m, sj_plan *p);

/* _fewest.c */
int sj_fewest(const task *t, double a1, double n, double longest, sj_plan *p);

/* _settling.c */
int sj_add_ramp(const task *t, double from, double v, path *x);
int sj_recover(task *t, sj_plan *p);
int sj_settle(task *t, sj_plan *p);
int sj_move_from_above(const task *start, double cycles, sj_plan *p);

/* _direct.c */
task sj_pushed_up(const task *start);
int sj_move_direct(const task *start, sj_plan *p);

/* One of the rows that _lanes.c plans at once: whether it is planned, and how. */
typedef struct {
    int ok;
    task t;
    seven s;
} lane_plan;

enum { SJ_LANES = 8 };

/* _lanes.c */
void sj_lanes_plan(int32_t n, const sj_request *r, const sj_limits *limits, int64_t step,
                   lane_plan *out);

/* _fallback.c */
int sj_by_stopping(const task *start, double duration, sj_plan *p);
int sj_fallback(const task *start, sj_plan *p);

/* _duration.c */
int64_t sj_stop_duration(int32_t n, const sj_request *r, const sj_limits *l, int64_t cycles);
