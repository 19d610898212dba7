/* Positions of a drive in increments of the encoder and in units of the user, both at once.
 *
 * Invariant of a point, apart from wraps of both:
 *     increments * ratio_units + ratio_increments / 2 = units * ratio_increments + remainder
 * so nothing drifts, whatever the gear.
 * Never here: motions, words, states.
 */
#include <stdint.h> /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

/* Into the range of 607Bh; the full range is the plain wrap of INT32. */
int64_t sj_point_wrap(const sj_drive *drive, int64_t units)
{
    if (drive->range == (int64_t)1 << 32) {
        return (int32_t)(uint32_t)(uint64_t)units;
    }
    const int64_t above = (units - drive->config.range_min) % drive->range;
    return drive->config.range_min + (above < 0 ? above + drive->range : above);
}

/* The short way from one position to another, around the wrap if that is shorter. */
int64_t sj_point_difference(const sj_drive *drive, int64_t to, int64_t from)
{
    int64_t way = (to - from) % drive->range;

    if (way < 0) {
        way += drive->range;
    }
    return 2 * way >= drive->range ? way - drive->range : way;
}

static int64_t floor_div(int64_t value, int64_t divisor)
{
    const int64_t quotient = value / divisor;
    return quotient - (value % divisor < 0);
}

/* Invariant of a point: increments * ratio_units + ratio_increments / 2
 *                       = units * ratio_increments + remainder, apart from wraps of both. */
void sj_point_move_increments(const sj_drive *drive, sj_drive_point *point, int64_t way)
{
    const int64_t share = way * drive->ratio_units + point->remainder;
    const int64_t units = floor_div(share, drive->ratio_increments);

    point->increments = add_wrapping(point->increments, way);
    point->remainder = share - units * drive->ratio_increments;
    point->units = sj_point_wrap(drive, point->units + units);
}

/* The units are met exactly, the increments to the nearest; returns the way in increments. */
int64_t sj_point_move_units(const sj_drive *drive, sj_drive_point *point, int64_t way)
{
    const int64_t wanted =
        way * drive->ratio_increments - (point->remainder - drive->ratio_increments / 2);
    const int64_t increments =
        floor_div(wanted + drive->ratio_units / 2, drive->ratio_units);

    point->remainder += increments * drive->ratio_units - way * drive->ratio_increments;
    point->increments = add_wrapping(point->increments, increments);
    point->units = sj_point_wrap(drive, point->units + way);
    return increments;
}

void sj_point_set(const sj_drive *drive, sj_drive_point *point, int64_t increments, int64_t units)
{
    point->increments = increments;
    point->units = sj_point_wrap(drive, units);
    point->remainder = drive->ratio_increments / 2;
}

void sj_point_set_home(sj_drive *drive, int64_t increments)
{
    const int64_t home = turned(drive, drive->config.home_offset, SJ_POLARITY_POSITION);
    sj_drive_point *const points[] = {&drive->actual, &drive->demand};

    for (int i = 0; i < 2; i++) {
        const int64_t now = points[i]->increments;
        const int64_t way = subtract_wrapping(now, increments) % ((int64_t)1 << 32);
        sj_point_set(drive, points[i], increments, home);
        sj_point_move_increments(drive, points[i], way);
        points[i]->increments = now;
    }
}
