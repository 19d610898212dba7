/* The planner from any state to any target, in whole cycles. */
#pragma once
#include <stdint.h>
#include "base/_types.h"

/* The bound of the work of one plan: steps of any root, durations tried in any search; and rounds of a
 * synchronisation. No recursion, no allocation. */
enum { SJ_ROOT_STEPS = 40, SJ_DURATION_STEPS = 6, SJ_SYNC_ROUNDS = 10 };

enum sj_plan_status {
    SJ_PLAN_OK = 0,
    SJ_PLAN_INVALID = 1,  /* a number that is none, a limit <= 0, |v1| > velocity */
    SJ_PLAN_TOO_LONG = 2, /* more than SJ_CYCLES_MAX cycles */
    SJ_PLAN_BLOCKED = 3,  /* none of exactly this duration; the plan is the next longer */
    SJ_PLAN_NO_CRUISE = 4 /* the velocity limit is not reached for a cycle */
};

/* how it was found */
enum sj_plan_kind {
    SJ_PLAN_WAIT = 0,    /* nothing to do, or waiting only */
    SJ_PLAN_CRUISE = 1,  /* ramp, cruise, ramp: seven phases */
    SJ_PLAN_EASE = 2,    /* braking eased for a while; no zero of the acceleration */
    SJ_PLAN_CONVEX = 3,  /* convex combination of a plan too short and one too far */
    SJ_PLAN_STOP = 4,    /* stop first, then from rest: the last resort */
    SJ_PLAN_RAMP = 5,    /* change of velocity only */
    SJ_PLAN_RECOVERY = 8 /* added: the start was outside its limits */
};

typedef struct {
    double distance, v0, a0, v1; /* continuous, per cycle */
} sj_request;

/* From the continuous state (0, v0, a0) to (h, v1, 0), as soon as possible. */
int32_t sj_plan_move(double h, double v0, double a0, double v1, const sj_limits *limits,
                     sj_plan *plan);
/* As sj_plan_move, to a target that moves on at v1 and may be met up to a cycle later on its line: at
 * h + plan->slipped. */
int32_t sj_plan_meeting(double h, double v0, double a0, double v1, const sj_limits *limits,
                        sj_plan *plan);
/* As sj_plan_move, to (h, v1, a1). */
int32_t sj_plan_arrival(double h, double v0, double a0, double v1, double a1,
                        const sj_limits *limits, sj_plan *plan);
/* As sj_plan_move, but with a cruise at the velocity limit exactly. */
int32_t sj_plan_exact_cruise(double h, double v0, double a0, double v1, const sj_limits *limits,
                             sj_plan *plan);
/* From (v0, a0) to (v1, 0), as soon as possible, wherever that is. */
int32_t sj_plan_velocity(double v0, double a0, double v1, const sj_limits *limits, sj_plan *plan);
/* Whether whole cycles can keep the velocity limit from (v, a), its acceleration "up". */
int32_t sj_plan_keeps(double v, double a, const sj_limits *limits);
/* n axes to (distance, v1, a1), each as soon as it can, or in the same cycles, at least `cycles`. */
int32_t sj_plan_arrivals(int32_t n, const sj_request *requests, const double *a1,
                         const sj_limits *limits, int64_t cycles, int32_t *synchronization,
                         sj_plan *plans);
/* As sj_plan_move, in exactly this many cycles. */
int32_t sj_plan_duration(double h, double v0, double a0, double v1, const sj_limits *limits,
                         int64_t cycles, sj_plan *plan);

/* n axes, SJ_AXES at most, in the same and fewest cycles, at least `cycles`. */
int32_t sj_plan_together(int32_t n, const sj_request *requests, const sj_limits *limits,
                         int64_t cycles, sj_plan *plans);

/* Requests between samples, for several axes and for many (_axes.c). */
enum sj_synchronization {
    SJ_SYNC_NONE = 0,   /* each axis as soon as it can */
    SJ_SYNC_TIME = 1,   /* all axes arrive in the same cycle */
    SJ_SYNC_PHASE = 2,  /* the same phases: rest to rest on a straight line */
    SJ_SYNC_MOVING = 3, /* each axis by itself, to a target that moves on: sj_plan_meeting */
    SJ_SYNC_EXACT =
        4 /* added: cruise at the velocity limit exactly; not of axes together in time */
};

/* States and limits as memory of sj_state and sj_limits, since Python passes joined bytes: n starts and
 * n targets; n limits, and what one of each of their numbers is per cycle. */
int32_t sj_plan_samples(int32_t n, double cycle_time_s, const void *states, const void *limits,
                        const void *unit, int64_t least_cycles, int32_t *synchronization,
                        sj_plan *plans);
int32_t sj_plan_sample(double cycle_time_s, const void *from, const void *to, const void *limits,
                       sj_plan *plan);
/* The same asked by one piece of memory and answered by value, for the least work in Python: count -1 where there
 * is no plan, and sj_plan_sample() says why. */
typedef struct {
    sj_state from, to;
    sj_limits limits;
    double cycle_time_s;
} sj_between;
sj_plan sj_plan_between(const void *between);
/* Changes of velocity; of the requests the distance is nothing. *synchronization: as sj_plan_axes. */
int32_t sj_plan_velocities(int32_t n, const sj_request *requests, const sj_limits *limits,
                           int32_t *synchronization, sj_plan *plans);
/* Changes of velocity of n axes from samples: v1 per second, limits per cycle; ends[i]: where the
 * settled sample of axis i is. */
int32_t sj_plan_sample_velocities(int32_t n, double cycle_time_s, const void *from,
                                  const double *v1, const void *limits, int32_t *synchronization,
                                  sj_plan *plans, double *ends);
/* One of many plans: its phases lie behind those of the plan before it, so that memory is touched
 * once only. */
typedef struct {
    int64_t cycles;
    int64_t first; /* index of its first phase */
    int32_t count; /* phases used */
    int32_t kind;  /* enum sj_plan_kind */
} sj_row;

int32_t sj_plan_rows(int64_t n, double cycle_time_s, const double *from, int64_t from_columns,
                     const double *to, int64_t to_columns, const sj_limits *limits,
                     int64_t limits_step, sj_row *rows, sj_phase *phases, int64_t first,
                     int64_t *failed);

/* For C only. */

int32_t sj_plan_axes(int32_t n, const sj_request *request, const sj_limits *limits,
                     int64_t least_cycles, int32_t *synchronization, sj_plan *plans);

/* Whether the axes of a motion share nothing but its beginning. */
static inline int32_t sj_sync_is_alone(int32_t synchronization)
{
    return synchronization == SJ_SYNC_NONE || synchronization == SJ_SYNC_MOVING;
}
