/* Where on a path: a window of its segments. */
#pragma once
#include <stdint.h>
#include "trajectory/_following.h"

enum { SJ_TRACK_NUMBERS = 131072, SJ_TRACK_SEGMENTS = 2048 };

enum sj_track_status {
    SJ_TRACK_OK = 0,
    SJ_TRACK_FULL = 1,    /* wait: nothing was taken */
    SJ_TRACK_ORDER = 2,   /* not the segment that comes next */
    SJ_TRACK_LENGTH = 3,  /* phases out of range, or no rest at the end */
    SJ_TRACK_NUMBER = 4,  /* a number that is none */
    SJ_TRACK_BROKEN = 5,  /* does not go on where the segment before ends */
    SJ_TRACK_LIMIT = 6,   /* velocity, acceleration or jerk beyond the axis' own */
    SJ_TRACK_POSITION = 7 /* leaves the position limits */
};

/* A segment for one axis: the way-point at its end, the continuous state at its first knot, the jerk
 * of the cycle before that, and one per phase. Per cycle, as `Followed` has them. */
typedef struct {
    double position, velocity, acceleration, last_jerk;
    double jerk[4];
} sj_track_axis;

typedef struct {
    int64_t begin;  /* path cycle of its first knot */
    int64_t number; /* of the way-point at its end */
    int64_t cycles[4];
} sj_track_segment;

/* What an axis allows; the last two where its velocity becomes less. */
typedef struct {
    double velocity, acceleration, jerk, position_min, position_max;
    double deceleration, deceleration_jerk;
} sj_track_limits;

/* The window of a path: segments first .. first + count - 1, each in slot (index % capacity). */
typedef struct {
    int32_t axes, capacity;
    int64_t first, count;
    int64_t end;    /* path cycle where what is known ends */
    int64_t number; /* of the way-point there */
    int32_t whole;  /* 1: the path ends there */
    int32_t axis;   /* that the last refusal was about */
    sj_track_limits limits[64];
    double way_point[64], velocity[64], acceleration[64], last_jerk[64]; /* there */
    sj_track_segment segment[2048];
    double row[131072]; /* per segment nine columns of all axes */
} sj_track;

/* The phase that a place of the path lies in. */
typedef struct {
    int64_t segment, begin, end; /* path cycles of the phase */
    int32_t phase, reserved;
    double P[64], V[64], A[64]; /* continuous at its begin; P from the segment's first way-point */
} sj_cursor;

void sj_track_begin(sj_track *track, int32_t axes, const double *position,
                    const sj_track_limits *limits);
int32_t sj_track_add(sj_track *track, int64_t number, const int64_t *cycles, int32_t last,
                     const sj_track_axis *axis);

/* For C only. */

/* The same of a segment that needs no check; SJ_TRACK_OK or SJ_TRACK_FULL. */
int32_t sj_track_put(sj_track *track, int64_t number, const int64_t *cycles, int32_t last,
                     const sj_track_axis *axis);
/* Forget the segments whose way-point has this number or a later one. cycles > 0: so many of the first
 * of them stay, as the way to a way-point of that number. */
void sj_track_cut(sj_track *track, int64_t number, int64_t cycles);
/* Segments before this one are not needed any more. */
void sj_track_pass(sj_track *track, int64_t segment);
/* The phase of path cycle `cell`, the one from cell to cell + 1; 0, or -1: not known. */
int32_t sj_cursor_seek(const sj_track *track, int64_t cell, sj_cursor *cursor);
/* Positions so many cycles after the phase's begin; they are the samples where the path is run at
 * its speed. */
void sj_cursor_position(const sj_track *track, const sj_cursor *cursor, double cycles,
                        double *position);
/* The sample after the phase's c-th cycle, bit for bit that of sj_follow_sample. */
void sj_cursor_sample(const sj_track *track, const sj_cursor *cursor, int64_t c,
                      const sj_follow_samples *out);
