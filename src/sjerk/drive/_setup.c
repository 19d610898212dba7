/* A drive from its config: what is computed once, and what a new config leaves of the motion.
 *
 * Never here: the range of a setting (_config.c), the motion of a period.
 */
#include <math.h>            /* ceil */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

static void prepare(sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    double speed = 0.0;
    double limit = 0.0;

    sj_servo_prepare(&drive->constants, config);
    (void)sj_drive_ratio(config, &drive->scale.units, &drive->scale.increments);
    drive->scale.range_min = config->range_min < config->range_max ? config->range_min : INT32_MIN;
    drive->scale.range = config->range_min < config->range_max
                             ? (int64_t)config->range_max - config->range_min + 1
                             : (int64_t)1 << 32;
    /* jump limit = speed x period x factor; the speed in pu/s by 6080h, or less by 607Fh */
    speed = config->max_speed_rpm / 60.0 * config->encoder_increments /
            config->encoder_revolutions * (double)drive->scale.units /
            (double)drive->scale.increments;
    speed = speed < config->max_profile_velocity ? speed : config->max_profile_velocity;
    drive->scale.speed_limit = speed * config->period_s * increments_per_unit(drive);
    limit = ceil(speed * config->period_s * config->jump_factor);
    drive->scale.jump_limit = limit < 4294967296.0 ? (int64_t)limit : (int64_t)1 << 32;
    sj_signal_prepare(drive->scale.input, config);
}

int32_t sj_drive_init(sj_drive *drive, const sj_drive_config *config)
{
    const int32_t bad = sj_drive_config_check(config);

    if (bad != 0) {
        return bad;
    }
    *drive = (sj_drive){.config = *config, .state = SJ_STATE_NOT_READY, .goal.plan_phase = -1};
    prepare(drive);
    sj_point_set(drive, &drive->actual, 0, 0);
    sj_point_set(drive, &drive->demand.point, 0, 0);
    sj_verdict_clear(&drive->verdict);
    return 0;
}

/* It has been moved there without power: the motor is really turned. */
void sj_drive_place(sj_drive *drive, int64_t word)
{
    sj_drive_point *const point = &drive->actual;

    sj_point_set(drive, point, 0, 0);
    sj_point_move_units(drive, point, with_polarity(drive, word, SJ_POLARITY_POSITION));
    drive->servo.encoder = point->increments;
    drive->demand.point = *point;
}

/* A new scale: positions anew from the encoder; a reference is lost. */
void sj_drive_rescale(sj_drive *drive)
{
    const int64_t increments = drive->actual.increments;

    sj_point_set(drive, &drive->actual, 0, 0);
    sj_point_move_increments(drive, &drive->actual, increments % ((int64_t)1 << 32));
    drive->actual.increments = increments;
    drive->demand.point = drive->actual;
    drive->demand.fraction = 0.0;
    drive->goal = (sj_drive_goal){.plan_phase = -1};
    drive->demand.acceleration = 0.0;
    drive->resync = 1;
    drive->homing.homed = 0;
    sj_verdict_pause(&drive->verdict);
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
