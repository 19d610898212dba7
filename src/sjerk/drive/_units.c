/* Positions of a drive in increments of the encoder and in units of the user, both at once.
 *
 * Invariant of a point, apart from wraps of both:
 *     increments * scale.units + scale.increments / 2 = units * scale.increments + remainder
 * so nothing drifts, whatever the gear. The words of the master know the units within the range of
 * 607Bh; `travel` counts the same units without a wrap, so that a way has a direction and a length.
 * Never here: motions, words, states.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

/* Into the range of 607Bh; the full range is the plain wrap of INT32. */
int64_t sj_point_wrap(const sj_drive *drive, int64_t units)
{
    if (drive->scale.range == (int64_t)1 << 32) {
        return (int32_t)(uint32_t)(uint64_t)units;
    }
    const int64_t above = (units - drive->scale.range_min) % drive->scale.range;
    return drive->scale.range_min + (above < 0 ? above + drive->scale.range : above);
}

/* The short distance from one position to another, around the wrap if that is shorter. */
int64_t sj_point_difference(const sj_drive *drive, int64_t to, int64_t from)
{
    int64_t distance = (to - from) % drive->scale.range;

    if (distance < 0) {
        distance += drive->scale.range;
    }
    return 2 * distance >= drive->scale.range ? distance - drive->scale.range : distance;
}

static int64_t floor_div(int64_t value, int64_t divisor)
{
    const int64_t quotient = value / divisor;
    return quotient - (value % divisor < 0);
}

void sj_point_move_increments(const sj_drive *drive, sj_drive_point *point, int64_t distance)
{
    const int64_t share = distance * drive->scale.units + point->remainder;
    const int64_t units = floor_div(share, drive->scale.increments);

    point->increments = add_wrapping(point->increments, distance);
    point->remainder = share - units * drive->scale.increments;
    point->units = sj_point_wrap(drive, point->units + units);
    point->travel = add_wrapping(point->travel, units);
}

/* The units are met exactly, the increments to the nearest; returns the distance in increments. */
int64_t sj_point_move_units(const sj_drive *drive, sj_drive_point *point, int64_t distance)
{
    const int64_t wanted =
        distance * drive->scale.increments - (point->remainder - drive->scale.increments / 2);
    const int64_t increments = floor_div(wanted + drive->scale.units / 2, drive->scale.units);

    point->remainder += increments * drive->scale.units - distance * drive->scale.increments;
    point->increments = add_wrapping(point->increments, increments);
    point->units = sj_point_wrap(drive, point->units + distance);
    point->travel = add_wrapping(point->travel, distance);
    return increments;
}

void sj_point_set(const sj_drive *drive, sj_drive_point *point, int64_t increments, int64_t units)
{
    point->increments = increments;
    point->units = sj_point_wrap(drive, units);
    point->travel = units;
    point->remainder = drive->scale.increments / 2;
}

void sj_point_set_home(sj_drive *drive, int64_t increments)
{
    const int64_t home = with_polarity(drive, drive->config.home_offset, SJ_POLARITY_POSITION);
    sj_drive_point *const points[] = {&drive->actual, &drive->demand.point};

    for (int i = 0; i < 2; i++) {
        const int64_t now = points[i]->increments;
        const int64_t distance = subtract_wrapping(now, increments) % ((int64_t)1 << 32);
        sj_point_set(drive, points[i], increments, home);
        sj_point_move_increments(drive, points[i], distance);
        points[i]->increments = now;
    }
}

/* Units as a word: polarity applied, within 607Bh. */
int64_t sj_point_word(const sj_drive *drive, int64_t units)
{
    return sj_point_wrap(drive, with_polarity(drive, units, SJ_POLARITY_POSITION));
}

int64_t sj_point_demand(const sj_drive *drive)
{
    return sj_point_word(drive, drive->demand.point.units);
}
