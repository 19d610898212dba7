/* Cyclic synchronous position, velocity and torque (modes 8, 9, 10), and interpolated position (mode 7):
 * the target of each period.
 *
 * A SYNC that is missed is bridged with the last command (2100h:3), and bit 12 stays; then the axis
 * stops along a ramp. At a closed limit switch it stops too, in modes 9 and 10 also at the ends of
 * 607Dh; mode 8 holds its target inside. Away is free. A stop that has begun ends at its own end.
 * Never here: ramps, the profile modes, the motor's equations.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

/* More SYNCs were missed in a row than are bridged. */
static int bridge_ends(const sj_drive *drive)
{
    return (uint32_t)drive->counts.missed_in_row > drive->config.sync_extrapolation;
}

/* On at the last velocity, never back to the last target, and then a stop. */
static void bridge(sj_drive *drive, sj_servo_command *command)
{
    const double velocity = drive->demand.velocity;

    sj_verdict_pause(&drive->verdict);
    if (bridge_ends(drive)) {
        sj_motion_begin_stop(drive, command, 2);
    } else {
        sj_motion_ramp(drive, command, velocity, velocity);
    }
}

/* The target becomes the demand at the period's end. Returns a fault or SJ_FAULT_NONE. */
static int32_t follow(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command,
                      int64_t target)
{
    const sj_drive_config *config = &drive->config;
    const double speed = 1.0 / per_period(drive);
    const double before = drive->demand.velocity;
    const int64_t word = sj_point_demand(drive);
    const uint32_t switches = sj_limit_switches(drive);
    int64_t distance = 0;
    int64_t step = 0;
    int64_t advance = 0;

    if (rx->sync_missed) {
        bridge(drive, command);
        return SJ_FAULT_NONE;
    }
    distance = sj_point_difference(drive, sj_point_wrap(drive, target), word);
    step = sj_limit_distance(drive, word, distance);
    drive->follows = step == distance;
    drive->limited |= !drive->follows;
    step = with_polarity(drive, step, SJ_POLARITY_POSITION);
    if (sj_limit_blocks(switches, (double)step) || sj_limit_blocks(switches, before)) {
        sj_motion_begin_stop(drive, command, sj_motion_limit_ramp(drive));
        return SJ_FAULT_NONE;
    }
    if (drive->follows) {
        sj_verdict_judge(drive, step);
        drive->warning |= drive->verdict.last_finding >= 0;
    } else {
        sj_verdict_pause(&drive->verdict);
    }
    if (step > drive->scale.jump_limit || step < -drive->scale.jump_limit) {
        if (config->jump_option == SJ_JUMP_FAULT) {
            return SJ_FAULT_REFERENCE_LIMIT;
        }
        if (config->jump_option == SJ_JUMP_CLAMP) {
            step = step > 0 ? drive->scale.jump_limit : -drive->scale.jump_limit;
            drive->limited = 1;
            drive->follows = 0;
        }
    }
    command->control = SJ_SERVO_POSITION;
    command->demand = drive->demand.point.increments;
    command->fraction = drive->demand.fraction;
    advance = sj_point_move_units(drive, &drive->demand.point, step);
    command->advance = (double)advance - drive->demand.fraction;
    drive->demand.fraction = 0.0;
    drive->demand.velocity = sj_motion_possible(drive, command->advance);
    command->velocity_start_rad_s = drive->demand.velocity * speed;
    command->velocity_end_rad_s = command->velocity_start_rad_s;
    sj_motion_feed_torque(drive, command, drive->demand.velocity - before);
    return SJ_FAULT_NONE;
}

/* The first period after a pause: the master sees where the axis is before its targets count. */
static int resume(sj_drive *drive, sj_servo_command *command)
{
    if (!drive->resync) {
        return 0;
    }
    sj_motion_adopt_actual(drive);
    sj_motion_stop(drive, command, 1);
    drive->resync = 0;
    return 1;
}

int32_t sj_cyclic_position(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    if (resume(drive, command)) {
        return SJ_FAULT_NONE;
    }
    return follow(drive, rx, command, (int64_t)rx->target_position + rx->position_offset);
}

/* Mode 7: 60C1h:1 instead of 607Ah, while bit 4 of the controlword enables it; without it a stop along
 * the ramp of 6084h. */
int32_t sj_cyclic_interpolated(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    if (!(drive->controlword & SJ_CW_MODE_4)) {
        sj_motion_begin_stop(drive, command, 1);
        drive->resync = 1;
        return SJ_FAULT_NONE;
    }
    if (resume(drive, command)) {
        return SJ_FAULT_NONE;
    }
    return follow(drive, rx, command, rx->interpolated_position);
}

/* The velocity command goes to its target over the period; the demand is where the axis is. */
void sj_cyclic_velocity(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const double to_period = increments_per_unit(drive) * drive->config.period_s;
    const double most = drive->scale.speed_limit;
    const double speed = 1.0 / per_period(drive);
    double goal = drive->demand.velocity;

    if (bridge_ends(drive)) {
        sj_motion_begin_stop(drive, command, 2);
        return;
    }
    if (!rx->sync_missed) {
        const double wanted =
            (double)with_polarity(drive, (int64_t)rx->target_velocity + rx->velocity_offset,
                                  SJ_POLARITY_VELOCITY) *
            to_period;
        goal = bounded(wanted, most);
        drive->follows = goal == wanted;
    }
    drive->limited |= !drive->follows;
    if (sj_motion_held_at_an_end(drive, command, goal, drive->demand.velocity)) {
        return;
    }
    command->control = SJ_SERVO_VELOCITY;
    command->velocity_start_rad_s = drive->demand.velocity * speed;
    command->velocity_end_rad_s = goal * speed;
    command->velocity_offset_rad_s = 0.0;
    sj_motion_feed_torque(drive, command, goal - drive->demand.velocity);
    drive->demand.point = drive->actual;
    drive->demand.fraction = 0.0;
    drive->demand.velocity = goal;
}

/* The torque command of the period; 60B2h is already in command->torque_nm. */
void sj_cyclic_torque(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const double offset = command->torque_nm;
    double torque = drive->demand.torque_nm;

    if (bridge_ends(drive)) {
        sj_motion_begin_stop(drive, command, 2);
        return;
    }
    if (!rx->sync_missed) {
        torque = offset + (double)with_polarity(drive, rx->target_torque, SJ_POLARITY_TORQUE) *
                              1e-3 * drive->config.rated_torque_nm;
        drive->follows = 1;
    }
    if (sj_motion_held_at_an_end(drive, command, torque, sj_motion_speed(drive))) {
        return;
    }
    sj_motion_adopt_speed(drive);
    command->control = SJ_SERVO_TORQUE;
    command->speed_max_rad_s /= SJ_SPEED_CLAMP;
    command->torque_nm = torque;
    drive->demand.torque_nm = torque;
}
