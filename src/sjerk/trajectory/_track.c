/* A path in play: the window of its segments, checked as they come, and positions along it.
 *
 * The path is what `_follow.c` makes: phases of constant jerk between way-points, with the sample of
 * the bilinear integrator on each way-point. Between whole cycles s the positions go on as
 * q(s) = P(s - 1/2) + 5/24 A(s - 1/2), which is the sample where s is whole (_segment.h).
 * docs/explanation/path_in_play.md. Never here: when a place is passed, memory of its own, drives.
 */
#include <float.h> /* DBL_EPSILON */
#include <math.h>  /* fabs, isfinite, sqrt */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of rows */
#include "trajectory/_track.h"
#include "base/_segment.h" /* what a sample is */

enum { FROM, TO, P0, V0, A0, JERK, COLUMNS = JERK + 4 };

/* Relative room for the rounding of a host that plans in doubles. */
static const double ROOM = 1e-9, NOISE = 64.0 * DBL_EPSILON;

static const double *column_of(const sj_track *track, int64_t segment, int32_t column)
{
    int64_t slot = segment % track->capacity;
    return track->row + (slot * COLUMNS + column) * track->axes;
}

static const sj_track_segment *segment_of(const sj_track *track, int64_t segment)
{
    return &track->segment[segment % track->capacity];
}

/* From rest at the first way-point, position (axes,). */
void sj_track_begin(sj_track *track, int32_t axes, const double *position,
                    const sj_track_limits *limits)
{
    int32_t capacity = SJ_TRACK_NUMBERS / (COLUMNS * axes);
    track->axes = axes;
    track->capacity = capacity < SJ_TRACK_SEGMENTS ? capacity : SJ_TRACK_SEGMENTS;
    track->first = track->count = track->end = track->number = 0;
    track->whole = 0;
    track->axis = -1;
    for (int32_t k = 0; k < axes; k++) {
        track->limits[k] = limits[k];
        track->way_point[k] = position[k];
        track->velocity[k] = track->acceleration[k] = track->last_jerk[k] = 0.0;
    }
}

/* ---- segments as they come ------------------------------------------------------------------- */

static int32_t check_cycles(const sj_track *track, const int64_t *cycles, int64_t *sum)
{
    *sum = 0;
    for (int p = 0; p < 4; p++) {
        if (cycles[p] < 0 || cycles[p] > SJ_CYCLES_MAX - *sum)
            return SJ_TRACK_LENGTH;
        *sum += cycles[p];
    }
    return *sum < 1 || *sum > SJ_CYCLES_MAX - track->end ? SJ_TRACK_LENGTH : SJ_TRACK_OK;
}

/* Whether positions between the ends of a phase stay inside. */
static int32_t turns_inside(const sj_track_limits *most, double from, segment_state at, double n,
                            double J, double slack)
{
    double v = at.V + 5.0 / 24.0 * J, root = at.A * at.A - 2.0 * J * v, turn[2], q;
    if (!(root >= 0.0))
        return 1;
    q = -(at.A + copysign(sqrt(root), at.A)); /* v + A t + J t^2/2 = 0, both ways of writing it */
    turn[0] = J != 0.0 ? q / J : -1.0;
    turn[1] = q != 0.0 ? 2.0 * v / q : -1.0;
    for (int k = 0; k < 2; k++) {
        double x;
        if (!(turn[k] > 0.0 && turn[k] < n))
            continue;
        x = from + segment_between(at, turn[k], J);
        if (x < most->position_min - slack || x > most->position_max + slack)
            return 0;
    }
    return 1;
}

/* One axis of a segment: goes on where the one before ends, within its limits. */
static int32_t check_axis(const sj_track *track, int32_t k, const sj_track_axis *in,
                          const int64_t *cycles, int64_t sum, int32_t last)
{
    const sj_track_limits *most = &track->limits[k];
    double from = track->way_point[k], n = (double)sum, J = in->last_jerk, idle = 1.0;
    double near_A = ROOM * most->jerk + NOISE * (most->acceleration + n * most->jerk);
    double near_V = ROOM * most->jerk + NOISE * (most->velocity + n * most->acceleration);
    double near_P =
        ROOM * most->jerk + NOISE * (fabs(from) + fabs(in->position) + n * most->velocity);
    double amax = most->acceleration * (1.0 + ROOM), vmax = most->velocity * (1.0 + ROOM);
    int32_t ranged = isfinite(most->position_min) || isfinite(most->position_max);
    segment_state at = {segment_first(in->velocity, in->acceleration, in->last_jerk), in->velocity,
                        in->acceleration};

    if (!(isfinite(in->position) && isfinite(in->velocity) && isfinite(in->acceleration) &&
          isfinite(in->last_jerk)))
        return SJ_TRACK_NUMBER;
    if (fabs(in->velocity - track->velocity[k]) > near_V ||
        fabs(in->acceleration - track->acceleration[k]) > near_A ||
        fabs(in->last_jerk - track->last_jerk[k]) > near_A)
        return SJ_TRACK_BROKEN;
    for (int p = 0; p < 4; p++) {
        double m = (double)cycles[p];
        segment_state end;
        if (cycles[p] == 0)
            continue;
        J = in->jerk[p];
        if (!isfinite(J))
            return SJ_TRACK_NUMBER;
        end = segment_after(at, m, J);
        if (!(fabs(J) <= most->jerk * (1.0 + ROOM) && fabs(end.A) <= amax && fabs(end.V) <= vmax))
            return SJ_TRACK_LIMIT;
        if (at.A * end.A < 0.0 && !(fabs(at.V - at.A * at.A / (2.0 * J)) <= vmax))
            return SJ_TRACK_LIMIT; /* a zero of A is a peak of V */
        if (ranged && !turns_inside(most, from, at, m, J, near_P))
            return SJ_TRACK_POSITION;
        idle = J;
        at = end;
    }
    if (!(fabs(from + (at.P - 0.5 * at.V + at.A / 3.0 - 0.125 * J) - in->position) <= near_P))
        return SJ_TRACK_BROKEN;
    if (in->position < most->position_min || in->position > most->position_max)
        return SJ_TRACK_POSITION;
    if (last && (idle != 0.0 || fabs(at.V) > near_V || fabs(at.A) > near_A))
        return SJ_TRACK_LENGTH;
    return SJ_TRACK_OK;
}

static void keep_axis(sj_track *track, int32_t k, const sj_track_axis *in, const int64_t *cycles)
{
    double *row =
        track->row + ((track->first + track->count) % track->capacity) * COLUMNS * track->axes;
    segment_state at = {segment_first(in->velocity, in->acceleration, in->last_jerk), in->velocity,
                        in->acceleration};
    row[FROM * track->axes + k] = track->way_point[k];
    row[TO * track->axes + k] = in->position;
    row[P0 * track->axes + k] = at.P;
    row[V0 * track->axes + k] = at.V;
    row[A0 * track->axes + k] = at.A;
    for (int p = 0; p < 4; p++) {
        double J = cycles[p] > 0 ? in->jerk[p] : 0.0;
        row[(JERK + p) * track->axes + k] = J;
        at = segment_after(at, (double)cycles[p], J);
        if (cycles[p] > 0)
            track->last_jerk[k] = J;
    }
    track->way_point[k] = in->position;
    track->velocity[k] = at.V;
    track->acceleration[k] = at.A;
}

int32_t sj_track_put(sj_track *track, int64_t number, const int64_t *cycles, int32_t last,
                     const sj_track_axis *axis)
{
    sj_track_segment *segment = &track->segment[(track->first + track->count) % track->capacity];
    if (track->count == track->capacity)
        return SJ_TRACK_FULL;
    for (int32_t k = 0; k < track->axes; k++)
        keep_axis(track, k, &axis[k], cycles);
    segment->begin = track->end;
    segment->number = number;
    memcpy(segment->cycles, cycles, sizeof segment->cycles);
    track->number = number;
    for (int p = 0; p < 4; p++)
        track->end += cycles[p];
    track->whole = last != 0;
    track->count++;
    return SJ_TRACK_OK;
}

int32_t sj_track_add(sj_track *track, int64_t number, const int64_t *cycles, int32_t last,
                     const sj_track_axis *axis)
{
    int64_t sum;
    int32_t status = check_cycles(track, cycles, &sum);

    track->axis = -1;
    if (track->whole || number != track->number + 1)
        return SJ_TRACK_ORDER;
    if (status != SJ_TRACK_OK)
        return status;
    if (track->count == track->capacity)
        return SJ_TRACK_FULL;
    for (int32_t k = 0; k < track->axes; k++) {
        status = check_axis(track, k, &axis[k], cycles, sum, last);
        if (status != SJ_TRACK_OK) {
            track->axis = k;
            return status;
        }
    }
    return sj_track_put(track, number, cycles, last, axis);
}

/* The last segment ends after so many cycles: the sample there becomes its way-point. */
static void shorten(sj_track *track, int64_t cycles)
{
    int64_t last = track->first + track->count - 1, slot = last % track->capacity, left = cycles;
    sj_track_segment *segment = &track->segment[slot];
    double *row = track->row + slot * COLUMNS * track->axes;

    for (int p = 0; p < 4; p++) {
        segment->cycles[p] = segment->cycles[p] < left ? segment->cycles[p] : left;
        left -= segment->cycles[p];
    }
    for (int32_t k = 0; k < track->axes; k++) {
        segment_state at = {row[P0 * track->axes + k], row[V0 * track->axes + k],
                            row[A0 * track->axes + k]};
        double J = 0.0;
        for (int p = 0; p < 4; p++)
            if (segment->cycles[p] > 0) {
                J = row[(JERK + p) * track->axes + k];
                at = segment_after(at, (double)segment->cycles[p], J);
            }
        track->way_point[k] =
            row[FROM * track->axes + k] + (at.P - 0.5 * at.V + at.A / 3.0 - 0.125 * J);
        row[TO * track->axes + k] = track->way_point[k];
        track->velocity[k] = at.V;
        track->acceleration[k] = at.A;
        track->last_jerk[k] = J;
    }
    track->end = segment->begin + cycles;
    track->whole = 0;
}

/* The last segment goes. */
static void remove_last(sj_track *track)
{
    int64_t last = track->first + track->count - 1;
    const sj_track_segment *segment = segment_of(track, last);
    size_t bytes = (size_t)track->axes * sizeof(double);
    memcpy(track->way_point, column_of(track, last, FROM), bytes);
    memcpy(track->velocity, column_of(track, last, V0), bytes);
    memcpy(track->acceleration, column_of(track, last, A0), bytes);
    for (int32_t k = 0; k < track->axes; k++) /* P0 = V/2 - A/3 + L/8 */
        track->last_jerk[k] = 8.0 * (column_of(track, last, P0)[k] - 0.5 * track->velocity[k] +
                                     track->acceleration[k] / 3.0);
    track->end = segment->begin;
    track->number = segment->number - 1;
    track->whole = 0;
    track->count--;
    if (track->count == 0)
        return;
    segment = segment_of(track, last - 1); /* exactly, where it is still there */
    for (int p = 0; p < 4; p++)
        if (segment->cycles[p] > 0)
            memcpy(track->last_jerk, column_of(track, last - 1, JERK + p), bytes);
}

void sj_track_cut(sj_track *track, int64_t number, int64_t cycles)
{
    int64_t kept = cycles > 0 ? number : number - 1;
    while (track->count > 0 && track->number > kept)
        remove_last(track);
    if (cycles > 0 && track->count > 0 && track->number == number)
        shorten(track, cycles);
}

void sj_track_pass(sj_track *track, int64_t segment)
{
    if (segment > track->first + track->count)
        segment = track->first + track->count;
    if (segment > track->first) {
        track->count -= segment - track->first;
        track->first = segment;
    }
}

/* ---- along the path -------------------------------------------------------------------------- */

static void enter(const sj_track *track, int64_t segment, sj_cursor *cursor)
{
    size_t bytes = (size_t)track->axes * sizeof(double);
    const sj_track_segment *at = segment_of(track, segment);
    cursor->segment = segment;
    cursor->phase = 0;
    cursor->begin = at->begin;
    cursor->end = at->begin + at->cycles[0];
    memcpy(cursor->P, column_of(track, segment, P0), bytes);
    memcpy(cursor->V, column_of(track, segment, V0), bytes);
    memcpy(cursor->A, column_of(track, segment, A0), bytes);
}

static void next_phase(const sj_track *track, sj_cursor *cursor)
{
    const double *J = column_of(track, cursor->segment, JERK + cursor->phase);
    double n = (double)(cursor->end - cursor->begin);
    if (n > 0.0)
        for (int32_t k = 0; k < track->axes; k++) {
            segment_state end =
                segment_after((segment_state){cursor->P[k], cursor->V[k], cursor->A[k]}, n, J[k]);
            cursor->P[k] = end.P;
            cursor->V[k] = end.V;
            cursor->A[k] = end.A;
        }
    cursor->phase++;
    cursor->begin = cursor->end;
    cursor->end += segment_of(track, cursor->segment)->cycles[cursor->phase];
}

/* The segment of a cycle, by halving. */
static int64_t find(const sj_track *track, int64_t cell)
{
    int64_t low = track->first, high = track->first + track->count; /* begin(low) <= cell */
    while (high - low > 1) {
        int64_t middle = low + (high - low) / 2;
        if (segment_of(track, middle)->begin <= cell)
            low = middle;
        else
            high = middle;
    }
    return low;
}

int32_t sj_cursor_seek(const sj_track *track, int64_t cell, sj_cursor *cursor)
{
    int64_t last = track->first + track->count - 1;
    if (cell >= track->end || track->count == 0 || cell < segment_of(track, track->first)->begin)
        return -1;
    if (cell >= cursor->begin && cell < cursor->end)
        return 0;
    if (cell < cursor->end || cursor->segment >= last || cursor->segment < track->first ||
        cell >= segment_of(track, cursor->segment + 1)->begin) {
        int64_t next = cursor->segment + 1;
        int32_t near = cell >= cursor->end && next >= track->first && next <= last &&
                       (next == last || cell < segment_of(track, next + 1)->begin) &&
                       cell >= segment_of(track, next)->begin;
        int64_t segment = near ? next : find(track, cell);
        if (near || segment != cursor->segment || cell < cursor->begin)
            enter(track, segment, cursor);
    }
    while (cell >= cursor->end)
        next_phase(track, cursor);
    return 0;
}

void sj_cursor_position(const sj_track *track, const sj_cursor *cursor, double cycles,
                        double *position)
{
    const double *from = column_of(track, cursor->segment, FROM);
    const double *J = column_of(track, cursor->segment, JERK + cursor->phase);
    for (int32_t k = 0; k < track->axes; k++)
        position[k] =
            from[k] + segment_between((segment_state){cursor->P[k], cursor->V[k], cursor->A[k]},
                                      cycles, J[k]);
}

void sj_cursor_sample(const sj_track *track, const sj_cursor *cursor, int64_t c,
                      const sj_follow_samples *out)
{
    const double *from = column_of(track, cursor->segment, FROM);
    const double *to = column_of(track, cursor->segment, TO);
    const double *J = column_of(track, cursor->segment, JERK + cursor->phase);
    const sj_track_segment *segment = segment_of(track, cursor->segment);
    int64_t sum = segment->cycles[0] + segment->cycles[1] + segment->cycles[2] + segment->cycles[3];
    int32_t arrives = cursor->begin + c == segment->begin + sum;
    for (int32_t k = 0; k < track->axes; k++) {
        segment_state now = segment_sample(
            (segment_state){cursor->P[k], cursor->V[k], cursor->A[k]}, (double)c, J[k]);
        out->position[k] = arrives ? to[k] : from[k] + now.P;
        out->velocity[k] = now.V;
        out->acceleration[k] = now.A;
        out->jerk[k] = J[k];
    }
}
