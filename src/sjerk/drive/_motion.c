/* The motions that every mode has: ramps, and stops by option code.
 *
 * Each makes one period of command for the servo from the demand at hand. A stop that has begun
 * (`drive->stop`) ends at its own end, when its ramp has ended and the motor stands.
 * Never here: which of them a state allows, the motor's equations.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

/* A velocity the motor could have: what a wild target leaves behind stays finite. */
double sj_motion_possible(const sj_drive *drive, double velocity)
{
    return bounded(velocity, drive->constants.speed_bound_rad_s * per_period(drive));
}

/* The motor's speed as a demand, increments per period; below standstill it is rest. */
double sj_motion_speed(const sj_drive *drive)
{
    const double speed = drive->servo.measured_rad_s;
    const double still = SJ_STANDSTILL * drive->config.max_speed_rpm * SJ_RPM;

    return speed > still || speed < -still ? sj_motion_possible(drive, speed * per_period(drive))
                                           : 0.0;
}

/* The demand becomes the actual position and speed. */
void sj_motion_adopt_speed(sj_drive *drive)
{
    drive->demand.point = drive->actual;
    drive->demand.fraction = 0.0;
    drive->demand.velocity = sj_motion_speed(drive);
}

/* Nothing jumps when the loop closes: the stream of demands begins anew. */
void sj_motion_adopt_actual(sj_drive *drive)
{
    sj_motion_adopt_speed(drive);
    drive->counts.following = 0;
    drive->counts.window = 0;
    drive->following_error = 0;
    sj_verdict_pause(&drive->verdict);
}

void sj_motion_power_off(sj_drive *drive, sj_servo_command *command)
{
    command->control = SJ_SERVO_OFF;
    command->brake = 1;
    sj_motion_adopt_actual(drive);
}

/* Torque feed-forward of a period: J times the acceleration that changes the demand's velocity. */
void sj_motion_feed_torque(const sj_drive *drive, sj_servo_command *command, double change)
{
    const double speed = 1.0 / per_period(drive);
    command->torque_nm += drive->config.acceleration_feedforward * drive->constants.inertia_kg_m2 *
                          change * speed / drive->config.period_s;
}

/* One period of demand from the velocity at its start to the velocity at its end. */
void sj_motion_ramp(sj_drive *drive, sj_servo_command *command, double advance, double velocity)
{
    const double speed = 1.0 / per_period(drive);
    const double total = drive->demand.fraction + advance;
    int64_t whole = (int64_t)total;

    whole -= (double)whole > total;
    command->control = SJ_SERVO_POSITION;
    command->demand = drive->demand.point.increments;
    command->fraction = drive->demand.fraction;
    command->advance = advance;
    command->velocity_start_rad_s = drive->demand.velocity * speed;
    command->velocity_end_rad_s = velocity * speed;
    sj_motion_feed_torque(drive, command, velocity - drive->demand.velocity);
    sj_point_move_increments(drive, &drive->demand.point, whole);
    drive->demand.fraction = total - (double)whole;
    drive->demand.velocity = velocity;
}

/* Toward `goal` with at most this acceleration, in increments and periods:
 *     v1 = v0 +- a,  advance = (v0 + v1) / 2            or, where the goal is reached inside the period,
 *     part = |goal - v0| / a,  advance = part (v0 + goal) / 2 + (1 - part) goal. */
void sj_motion_ramp_to(sj_drive *drive, sj_servo_command *command, double goal, double acceleration)
{
    const double start = drive->demand.velocity;
    const double change = goal - start;
    double advance = goal;

    if (change > acceleration) {
        goal = start + acceleration;
        advance = 0.5 * (start + goal);
    } else if (change < -acceleration) {
        goal = start - acceleration;
        advance = 0.5 * (start + goal);
    } else if (change != 0.0) {
        /* reached within the period: the ramp's part of it, then the goal's */
        const double part = (change > 0.0 ? change : -change) / acceleration;
        advance = part * 0.5 * (start + goal) + (1.0 - part) * goal;
    }
    sj_motion_ramp(drive, command, advance, goal);
}

/* A deceleration of 605Ah..605Eh in increments per period^2: 1 profile, 2 quick stop, 3 and 4 all
 * that the torque limit gives (a voltage limit is not modelled). */
static double deceleration(const sj_drive *drive, int32_t option, double torque)
{
    const sj_drive_config *config = &drive->config;
    const double scale = increments_per_unit(drive) * config->period_s * config->period_s;

    switch (option) {
    case 1: return config->profile_deceleration * scale;
    case 2: return config->quick_stop_deceleration * scale;
    default:
        torque *= drive->constants.inertia_inverse * drive->constants.increments_per_rad *
                  config->period_s * config->period_s;
        return torque > 1e-6 ? torque : 1e-6;
    }
}

void sj_motion_stop(sj_drive *drive, sj_servo_command *command, int32_t option)
{
    const double torque = command->torque_max_nm < -command->torque_min_nm
                              ? command->torque_max_nm
                              : -command->torque_min_nm;

    sj_verdict_pause(&drive->verdict);
    drive->follows = 0;
    command->velocity_offset_rad_s = 0.0;
    sj_motion_ramp_to(drive, command, 0.0, deceleration(drive, option, torque));
}

void sj_motion_begin_stop(sj_drive *drive, sj_servo_command *command, int32_t option)
{
    drive->stop = drive->demand.velocity != 0.0 || !drive->standing ? option : 0;
    sj_motion_stop(drive, command, option);
}

int sj_motion_stopping(sj_drive *drive, sj_servo_command *command)
{
    if (drive->stop == 0) {
        return 0;
    }
    if (drive->demand.velocity == 0.0 && drive->standing) {
        drive->stop = 0;
        drive->resync = 1;
        return 0;
    }
    sj_motion_stop(drive, command, drive->stop);
    return 1;
}

int32_t sj_motion_limit_ramp(const sj_drive *drive)
{
    const int32_t ramp = quick_stop_ramp(&drive->config);
    return ramp == 0 ? 2 : ramp;
}

int sj_motion_held_at_an_end(sj_drive *drive, sj_servo_command *command, double wanted,
                             double velocity)
{
    const uint32_t ends = sj_limit_ends(drive);
    const int stands = ends != 0 && wanted == 0.0 && velocity == 0.0;

    if (!stands && !sj_limit_blocks(ends, wanted) && !sj_limit_blocks(ends, velocity)) {
        return 0;
    }
    drive->limited = 1;
    sj_motion_begin_stop(drive, command, sj_motion_limit_ramp(drive));
    drive->follows = stands;
    return 1;
}
