/* Profile velocity, mode 3: 60FFh is the velocity to go to; a new value is planned from where the old
 * plan is. At a closed limit switch, or an end of 607Dh, the axis stops and stands; away is free.
 * Never here: how the way is planned and gone.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

void sj_profile_velocity(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const double goal =
        (double)with_polarity(drive, (int64_t)rx->target_velocity + rx->velocity_offset,
                              SJ_POLARITY_VELOCITY) *
        drive->config.period_s * increments_per_unit(drive);
    const double held = bounded(goal, drive->scale.speed_limit);
    const uint32_t ends = sj_limit_ends(drive);
    int fresh = 0;

    command->velocity_offset_rad_s = 0.0;
    drive->limited |= held != goal;
    if (sj_limit_blocks(ends, drive->demand.velocity) || sj_limit_blocks(ends, held)) {
        drive->limited = 1;
        sj_profile_give_up(drive);
        sj_motion_begin_stop(drive, command, sj_motion_limit_ramp(drive));
        return;
    }
    fresh = drive->goal.kind != SJ_VELOCITY_GOAL || held != drive->goal.velocity ||
            (!sj_profile_planned(drive) && drive->demand.velocity != held);
    drive->goal.velocity = held;
    drive->goal.kind = SJ_VELOCITY_GOAL;
    if (drive->goal.plan_phase >= 0) {
        sj_profile_execute(drive, command);
    } else {
        sj_motion_ramp(drive, command, drive->demand.velocity, drive->demand.velocity);
    }
    if (fresh) {
        sj_profile_request(drive);
    }
}

/* Bit 10: within 606Dh of the target for 606Eh; bit 12: not above 606Fh for longer than 6070h. */
uint16_t sj_profile_velocity_bits(sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const double units = units_per_increment(drive);
    const double actual = drive->servo.measured_rad_s * drive->constants.increments_per_rad * units;
    const double off = actual - drive->goal.velocity / config->period_s * units;
    const double window = config->velocity_window;
    const double threshold = config->velocity_threshold;
    const double period_ms = config->period_s * 1e3;

    if (drive->goal.kind == SJ_VELOCITY_GOAL && off <= window && off >= -window) {
        drive->counts.velocity += drive->counts.velocity < UINT32_MAX;
    } else {
        drive->counts.velocity = 0;
    }
    if (actual > threshold || actual < -threshold) {
        drive->counts.moving += drive->counts.moving < UINT32_MAX;
    } else {
        drive->counts.moving = 0;
    }
    return (uint16_t)((drive->counts.velocity > 0 &&
                               drive->counts.velocity * period_ms >= config->velocity_time_ms
                           ? SJ_SW_TARGET_REACHED
                           : 0) |
                      (drive->counts.moving == 0 ||
                               drive->counts.moving * period_ms <= config->threshold_time_ms
                           ? SJ_SW_FOLLOWS
                           : 0));
}
