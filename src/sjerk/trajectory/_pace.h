/* When on a path: the pace of a path in play. */
#pragma once
#include <stdint.h>
#include "_kernel.h"
#include "trajectory/_track.h"

/* Axis-samples that one cycle checks at most, and what a plan counts as. */
enum { SJ_PACE_CHECKS = 1024, SJ_PACE_PLAN = 128, SJ_PACE_SEEN = 4 };

enum sj_pace_status {
    SJ_PACE_RUNS = 0,
    SJ_PACE_RESTS = 1,   /* on the path, as it was told */
    SJ_PACE_STARVES = 2, /* rests, or comes to rest, for want of segments */
    SJ_PACE_DONE = 3,    /* on the last way-point */
    SJ_PACE_LOST = 4     /* no place to go: what was known is over, in motion */
};

/* Path cycles passed, a motion of its own: speed 1 is the path as it was planned. */
typedef struct {
    sj_interpolator s; /* beyond `origin` */
    int64_t origin;
} sj_pace;

/* A pace on its track, cycle by cycle. */
typedef struct {
    sj_pace pace;
    sj_cursor cursor;
    double past[4][64]; /* positions of the last four cycles, the newest first */
} sj_run;

enum sj_search_kind {
    SJ_SEARCH_NONE = 0,
    SJ_SEARCH_CHANGE = 1, /* to another speed, as soon as possible */
    SJ_SEARCH_STOP = 2,   /* at the end of what is known, as late as possible */
    SJ_SEARCH_AWAY = 3,   /* above speed 1 for a while, and back */
    SJ_SEARCH_STAY = 4,   /* there for longer */
    SJ_SEARCH_SOONER = 5  /* a change that is under way, harder */
};

/* The candidate that is being checked against the limits, over its whole way. */
typedef struct {
    int32_t kind;        /* enum sj_search_kind */
    int32_t rung, share; /* how hard, how much of what is wanted */
    int32_t stage;       /* 0: none is under way */
    int32_t left;        /* cycles of this stage */
    int32_t spent;       /* 1: nothing found, and nothing has changed since */
    double to;
    int64_t known;            /* end of the track it was made for */
    int64_t delay;            /* cycles until it begins */
    int64_t cycle;            /* of the run */
    int64_t begin, second_at; /* cycles in which its plans begin; second: -1 none */
    int64_t again;            /* cycle from which to look again */
    int64_t reach;            /* path cycles that it counts on, but for a stop */
    sj_run run;
    sj_pace first, second;
} sj_search;

typedef struct {
    sj_track track;
    sj_run run;
    double velocity[64], acceleration[64], jerk[64]; /* of run.past[0] */
    double wish;                                     /* speed, 0 .. 2 */
    double hardest_a, hardest_j;                     /* of changes of speed */
    double below;                                    /* the highest constant speed below 1 */
    double away;                                     /* the wish that led above 1 */
    int64_t cycle;
    int64_t plain;             /* cycles that were the path's own samples, in a row */
    sj_pace next, after;       /* checked: taken over in their cycles, one after the other */
    int64_t next_at, after_at; /* after: -1 there is none */
    int64_t next_known;
    int32_t next_kind; /* enum sj_search_kind; NONE: there is none */
    int32_t begun, starves;
    int32_t rung, next_rung; /* of the present motion, of the next */
    int32_t rests;           /* cycles at rest in a row, or TAIL: differences are 0 */
    int64_t checked;         /* path cycles that checked motions count on */
    sj_search search;
} sj_player;

/* Needs a begun track. */
void sj_player_begin(sj_player *player);
/* The positions of the next cycle, in run.past[0]; enum sj_pace_status. */
int32_t sj_player_step(sj_player *player);
/* Whole path cycles passed, and the rest. */
int64_t sj_player_place(const sj_player *player, double *rest);

/* For C only. */

/* In motion already, at speed 1 at the track's begin; the wish must stay 1 until four positions are
 * known, SJ_PACE_SEEN cycles. */
void sj_player_enter(sj_player *player);
double sj_player_speed(const sj_player *player);
/* Drop the segments from this way-point on, but for so many cycles of the first one; -1: the place is
 * passed or not known, or a checked motion counts on what would go. Nothing has changed then. */
int32_t sj_player_cut(sj_player *player, int64_t number, int64_t cycles);
/* The state of an axis from which an interpolator goes on within the limits of its jerk. */
void sj_player_hand_over(const sj_player *player, int32_t axis, sj_state *sample, double *jerk);
