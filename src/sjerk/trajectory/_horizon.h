/* The horizon of a stream: control points of a uniform cubic B-spline that pass goals and end at rest.
 *
 * Per joint and knot one control point c; time is counted in knots from the present one. Before the
 * unknown ones stand three that are given, behind them two that equal the last. Units of c are the
 * caller's, of about a limit on its third difference. */
#pragma once
#include <stdint.h>
#include "trajectory/_arrow.h"

typedef struct {
    int32_t joints, knots, goals;
    int32_t paced;            /* 1: the progress is chosen too, one for all joints */
    int32_t ends;             /* 1: the last of the unknown control points is `end` */
    int32_t fresh;            /* 1: `plan` is only a guess and need not keep the limits */
    int32_t strict;           /* 1: where `plan` goes against a direction, none goes along it */
    int32_t exact;            /* so many goals are met exactly, or no answer; with `fresh` */
    const double *before;     /* (joints, 3) */
    const double *plan;       /* (joints, knots): keeps everything */
    const double *end;        /* (joints,): where tails rest, or must with `ends` */
    const double *limits;     /* (joints, 4): first, second +, second -, third difference */
    const double *range;      /* (joints, 2) of control points */
    const double *rest;       /* (joints, 2) of the last one */
    const int32_t *direction; /* (joints, knots): sign asked of a first difference, or 0 */
    const double *moment, *weight; /* (goals,): when a goal is due, as the plan has it */
    const double *goal, *slope;    /* (goals, joints): where, and how it changes with progress */
    const double *speed;           /* (goals, joints): to be had there, per knot; or NULL */
    double speed_weight;
    const double *tolerance; /* (joints,): most distance from goals; or NULL */
    const double *tail;      /* (knots,): weight of each control point's distance to `end` */
    double smooth;           /* weight of squared third differences */
    double bend;             /* of second differences in a sample: 5/24 / cycles^2 of a knot */
    double lag;              /* weight of squared lag, in knots */
    double trust;            /* most change of a progress, in knots */
    double progress_before;  /* of the present knot */
    const double *progress;  /* (knots,): as the plan has it */
    const double *due;       /* (knots,): of a motion without lag */
} sj_horizon;

int64_t sj_horizon_doubles(int32_t joints, int32_t knots, int32_t goals);
int64_t sj_horizon_ints(int32_t joints, int32_t knots, int32_t goals);
/* control (joints, knots), progress (knots,): the plan found; `share` (joints,): how far from the given
 * one towards the optimum, 1: all of it. Without `paced` each joint by itself. */
void sj_horizon_plan(const sj_horizon *horizon, double *control, double *progress, double *share,
                     double *work, int32_t *ints, int32_t most, sj_arrow_result *result);
/* value (goals, joints) of a plan at the moments, as samples. */
void sj_horizon_values(const sj_horizon *horizon, const double *control, double *value);
