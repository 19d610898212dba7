/* Positions of a drive in increments of the encoder and in units of the user, both at once; and
 * what a config makes of them: ratio, range, jump limit.
 * Never here: motions, words, states.
 */
#include <stddef.h> /* required by the contract */
#include <stdint.h> /* the contract's integer types */
#include "_internal.h" /* what the rooms of the drive share */

/* ---- positions in increments and in pu ---- */

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

/* ---- configuration ---- */

static void prepare(sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    double speed = 0.0;
    double limit = 0.0;

    sj_servo_prepare(&drive->constants, config);
    (void)sj_drive_ratio(config, &drive->ratio_units, &drive->ratio_increments);
    drive->range = (int64_t)config->range_max - config->range_min + 1;
    /* pu/s of 6080h, or less by 607Fh */
    speed = config->max_speed_rpm / 60.0 * config->encoder_increments /
            config->encoder_revolutions * (double)drive->ratio_units /
            (double)drive->ratio_increments;
    speed = speed < config->max_profile_velocity ? speed : config->max_profile_velocity;
    limit = speed * config->period_s * config->jump_factor;
    drive->jump_limit = limit < 4294967296.0 ? (int64_t)limit : (int64_t)1 << 32;
}

int32_t sj_drive_init(sj_drive *drive, const sj_drive_config *config)
{
    const int32_t bad = sj_drive_config_check(config);

    if (bad != 0) {
        return bad;
    }
    *drive = (sj_drive){.config = *config, .state = SJ_STATE_NOT_READY, .plan_phase = -1};
    prepare(drive);
    sj_point_set(drive, &drive->actual, 0, 0);
    sj_point_set(drive, &drive->demand, 0, 0);
    sj_verdict_clear(&drive->verdict);
    return 0;
}

/* A new scale: positions are told anew from the encoder, a reference is lost. */
void sj_drive_rescale(sj_drive *drive)
{
    const int64_t increments = drive->actual.increments;

    sj_point_set(drive, &drive->actual, 0, 0);
    sj_point_move_increments(drive, &drive->actual, increments % ((int64_t)1 << 32));
    drive->actual.increments = increments;
    drive->demand = drive->actual;
    drive->demand_fraction = 0.0;
    drive->resync = 1;
    drive->homed = 0;
    sj_verdict_pause(&drive->verdict);
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

int32_t sj_drive_configure(sj_drive *drive, const sj_drive_config *config)
{
    const int32_t bad = sj_drive_config_check(config);
    const sj_drive_config old = drive->config;

    if (bad != 0) {
        return bad;
    }
    drive->config = *config;
    prepare(drive);
    if (old.encoder_increments != config->encoder_increments ||
        old.encoder_revolutions != config->encoder_revolutions ||
        old.gear_motor != config->gear_motor || old.gear_shaft != config->gear_shaft ||
        old.feed != config->feed || old.feed_shaft != config->feed_shaft ||
        old.range_min != config->range_min || old.range_max != config->range_max) {
        sj_drive_rescale(drive);
    }
    return 0;
}
