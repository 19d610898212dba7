/* What the planner's files share: the task in its frame, whole cycles, plans under construction,
   node paths. Not part of the contract of the rooms (_kernel.h); never read by cffi. */
#pragma once
#include <math.h>       /* sqrt, cbrt, fma, fabs */
#include <stddef.h>
#include <stdint.h>     /* int64_t cycles */
#include "planner/_planner.h"

/* relative room for rounding in counts and levels; a tenth of what is promised */
static const double SLACK = 1e-10;
enum {
    NEWTON_STEPS = SJ_ROOT_STEPS, LENGTH_STEPS = SJ_LENGTH_STEPS, SYNC_ROUNDS = SJ_SYNC_ROUNDS,
    NODES = 40
};
static const double LONGEST = SJ_CYCLES_MAX;

/* A planning task with its limits turned so that "up" is the direction in which the move
   is pushed. */
typedef struct {
    double h, v0, a0, v1;
    double vmax;
    double au, ju;      /* acceleration upward and the jerk while it points upward */
    double ad, jd;      /* the same downward */
    double sign;        /* +1 or -1: how "up" lies in axis coordinates */
    double first;       /* acceleration at the start of the whole plan */
} task;

static inline task mirrored(const task *t)
{
    return (task){-t->h, -t->v0, -t->a0, -t->v1, t->vmax, t->ad, t->jd, t->au, t->ju, -t->sign,
        -t->first};
}

static inline double up(double x)      /* whole cycles for x, rounding noise forgiven */
{
    x -= SLACK * (1.0 + fabs(x));
    if (!(fabs(x) < 4e18)) return x;
    double n = (double)(int64_t)x;
    return n < x ? n + 1.0 : n;
}
static inline double down(double x)
{
    x += SLACK * (1.0 + fabs(x));
    if (!(fabs(x) < 4e18)) return x;
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

/* Acceleration at whole cycles k, straight between: each piece is a phase. */
typedef struct { int count; double k[NODES], a[NODES]; } path;

/* Time of a change of velocity x >= 0 between states without acceleration. */
static inline double ramp_time(double x, double amax, double jerk)
{
    return x * jerk >= amax * amax ? x / amax + amax / jerk : 2 * sqrt(x / jerk);
}

/* _ramp.c */
void sj_begin(sj_plan *p);
void sj_put(sj_plan *p, double n, double jerk);
void sj_put_cruise(sj_plan *p, const task *t, double n);
void sj_append(sj_plan *p, const sj_plan *q);
int sj_leaves_velocity(const task *t, const sj_plan *p, int64_t used);
task sj_resume(const task *start, const sj_plan *p);
double sj_path_change(const path *x);
double sj_path_distance(const path *x, double v);
double sj_path_peak(const path *x, double v);
void sj_path_put(sj_plan *p, const path *x, const task *t);
void sj_node(path *x, double k, double a);
int sj_ramp(double v0, double a0, double dv, double vmax, double au, double ad, double j, path *x);

/* _return.c */
int sj_come_back(task *t, sj_plan *p);
void sj_settle(task *t, sj_plan *p);
int sj_cross(task *t, sj_plan *p);
void sj_shed(task *t, sj_plan *p);

/* _rescue.c */
int sj_go_to_velocity(task *t, double v, sj_plan *p);
int sj_by_stopping(const task *start, double length, sj_plan *p);
int sj_by_shedding(const task *start, sj_plan *p);

/* Ramp, cruise, ramp in continuous time: what does not depend on the peak velocity. */
typedef struct {
    /* virtual start without acceleration; velocity when the acceleration is brought to zero */
    double vs, vz;
    double t0, p0;      /* what the virtual start adds to time and distance */
    double low;         /* lowest peak velocity of the family */
} family;

/* The same in whole cycles: lengths of the phases, cruise velocity and first level. The second ramp
   takes n5, n6, n5. */
typedef struct { double n1, n2, n3, n4, n5, n6; double v, a; } seven;

static inline double seven_cycles(const seven *s)
{
    return s->n1 + s->n2 + s->n3 + s->n4 + 2 * s->n5 + s->n6;
}

/* _profile.c */
family sj_family_of(const task *t);
int sj_seven_fit(const task *t, seven *s);
void sj_seven_put(sj_plan *p, const task *t, const seven *s);
void sj_even_counts(double x, double z, double amax, double jerk, double *rise, double *hold);
void sj_ramp_counts(double a0, double x, double z, double amax, double jerk, double jerk1,
    double *n1, double *n2, double *n3);
task sj_pushed_up(const task *start);
int sj_move(const task *start, sj_plan *p, int again);
int sj_valid(double h, double v0, double a0, double v1, const sj_limits *l);
task sj_task_of(double h, double v0, double a0, double v1, const sj_limits *l);
void sj_note_scale(sj_plan *p, const sj_limits *l);

/* What a search for a length has learnt, for both directions: cycles up to the velocity limit, and
   down from it. */
typedef struct { int known; double s, r; } summit;

/* _mix.c */
int sj_mix(const task *t, double n, double *nearest, summit *m, sj_plan *p);
int sj_mix_from(const task *t, double *n, double longest, summit *m, sj_plan *p);
