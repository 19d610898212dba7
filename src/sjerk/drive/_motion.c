/* The motions of a drive: ramps and stops by option code, limits, following in CSP, CSV and CST.
 *
 * Each makes one period of command for the servo from the demand at hand.
 * Never here: which of them a state allows, the motor's equations.
 */
#include <stdint.h> /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

/* The demand becomes the actual position and speed: nothing jumps when the loop closes. */
void sj_motion_adopt_actual(sj_drive *drive)
{
    const double speed = drive->servo.measured_rad_s;
    const double still = SJ_STANDSTILL * drive->config.max_speed_rpm * SJ_RPM;

    drive->demand.point = drive->actual;
    drive->demand.fraction = 0.0;
    drive->demand.velocity = speed > still || speed < -still ? speed * per_period(drive) : 0.0;
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

/* A velocity the motor could have: what a wild target leaves behind stays finite. */
static double possible(const sj_drive *drive, double velocity)
{
    return bounded(velocity, drive->constants.speed_bound_rad_s * per_period(drive));
}

/* Torque feed-forward of a period: J times the acceleration that changes the demand's velocity. */
static void feed_torque(const sj_drive *drive, sj_servo_command *command, double change)
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
    feed_torque(drive, command, velocity - drive->demand.velocity);
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
    case 1:
        return config->profile_deceleration * scale;
    case 2:
        return config->quick_stop_deceleration * scale;
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

/* Limit switches, as 60FDh shows them: bit 0 negative, 1 positive, 2 home, 3 interlock. */
uint32_t sj_motion_inputs(const sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const double turns = (double)drive->servo.encoder * config->encoder_revolutions /
                         config->encoder_increments;

    return (config->switch_negative_rev > -1e9 && turns <= config->switch_negative_rev ? 1u : 0u) |
           (config->switch_positive_rev < 1e9 && turns >= config->switch_positive_rev ? 2u : 0u) |
           (config->switch_home_rev < 1e9 && turns >= config->switch_home_rev ? 4u : 0u) |
           (has_cause(drive, SJ_FAULT_SAFE_TORQUE_OFF) ? 8u : 0u);
}

int sj_motion_blocked(const sj_drive *drive, double direction)
{
    const uint32_t inputs = sj_motion_inputs(drive);
    return (inputs & 1u && direction < 0.0) || (inputs & 2u && direction > 0.0);
}

/* 607Dh: the target is held inside; an axis that is outside may only come back. */
int64_t sj_motion_software_limited(sj_drive *drive, int64_t target)
{
    const sj_drive_config *config = &drive->config;
    const int64_t now =
        sj_point_wrap(drive, with_polarity(drive, drive->demand.point.units, SJ_POLARITY_POSITION));
    int64_t low = config->software_min;
    int64_t high = config->software_max;

    if (low == 0 && high == 0) {
        return target;
    }
    low = now < low ? now : low;
    high = now > high ? now : high;
    if (target < low || target > high) {
        drive->limited = 1;
        return target < low ? low : high;
    }
    return target;
}

/* CSP: the target becomes the demand at the period's end. Returns a fault or SJ_FAULT_NONE. */
int32_t sj_motion_follow_position(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const sj_drive_config *config = &drive->config;
    const double speed = 1.0 / per_period(drive);
    const double before = drive->demand.velocity;
    int64_t target = sj_point_wrap(drive, (int64_t)rx->target_position + rx->position_offset);
    int64_t step = 0;
    int64_t advance = 0;

    if (rx->sync_missed) {
        /* never back to the last target: on at the last velocity, and then a stop */
        if ((uint32_t)drive->counts.missed_in_row > config->sync_extrapolation) {
            sj_motion_stop(drive, command, 2);
        } else {
            sj_motion_ramp(drive, command, before, before);
        }
        sj_verdict_pause(&drive->verdict);
        drive->follows = 0;
        return SJ_FAULT_NONE;
    }
    target = sj_motion_software_limited(drive, target);
    target = sj_point_wrap(drive, with_polarity(drive, target, SJ_POLARITY_POSITION));
    step = sj_point_difference(drive, target, drive->demand.point.units);
    if (sj_motion_blocked(drive, (double)step)) {
        /* a limit switch: stop, and follow again only away from it */
        drive->limited = 1;
        sj_motion_stop(drive, command, quick_stop_ramp(config));
        return SJ_FAULT_NONE;
    }
    if (drive->limited) {
        sj_verdict_pause(&drive->verdict);
    } else {
        sj_verdict_judge(drive, step);
        drive->warning |= drive->verdict.last_finding >= 0;
    }
    drive->follows = !drive->limited;
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
    drive->demand.velocity = possible(drive, command->advance);
    command->velocity_start_rad_s = drive->demand.velocity * speed;
    command->velocity_end_rad_s = command->velocity_start_rad_s;
    feed_torque(drive, command, drive->demand.velocity - before);
    return SJ_FAULT_NONE;
}

/* CSV and CST: the quick stop ramp where a limit switch blocks the direction, or SYNCs stay away. */
static int interrupted(sj_drive *drive, sj_servo_command *command, double direction)
{
    if (!sj_motion_blocked(drive, direction) &&
        (uint32_t)drive->counts.missed_in_row <= drive->config.sync_extrapolation) {
        return 0;
    }
    drive->limited |= (sj_motion_inputs(drive) & 3u) != 0;
    drive->follows = 0;
    sj_motion_ramp_to(drive, command, 0.0, deceleration(drive, 2, 0.0));
    return 1;
}

/* CSV: the velocity command goes to its target over the period; the demand is where the axis is. */
void sj_motion_follow_velocity(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const double to_period = increments_per_unit(drive) * drive->config.period_s;
    const double most = speed_limit(drive);
    const double speed = 1.0 / per_period(drive);
    double goal = drive->demand.velocity;

    if (!rx->sync_missed) {
        goal = (double)with_polarity(drive, (int64_t)rx->target_velocity + rx->velocity_offset,
                              SJ_POLARITY_VELOCITY) * to_period;
    }
    drive->follows = !rx->sync_missed;
    if (goal > most || goal < -most) {
        goal = bounded(goal, most);
        drive->limited = 1;
        drive->follows = 0;
    }
    if (interrupted(drive, command, goal)) {
        return;
    }
    command->control = SJ_SERVO_VELOCITY;
    command->velocity_start_rad_s = drive->demand.velocity * speed;
    command->velocity_end_rad_s = goal * speed;
    command->velocity_offset_rad_s = 0.0;
    feed_torque(drive, command, goal - drive->demand.velocity);
    drive->demand.point = drive->actual;
    drive->demand.fraction = 0.0;
    drive->demand.velocity = goal;
}

/* CST: the torque command of the period; 60B2h is already in command->torque_nm. */
void sj_motion_follow_torque(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    double torque = drive->demand.torque_nm;

    if (!rx->sync_missed) {
        torque = command->torque_nm + (double)with_polarity(drive, rx->target_torque, SJ_POLARITY_TORQUE) *
                                          1e-3 * drive->config.rated_torque_nm;
    }
    drive->demand.point = drive->actual;
    drive->demand.fraction = 0.0;
    drive->demand.velocity = possible(drive, drive->servo.measured_rad_s * per_period(drive));
    drive->follows = !rx->sync_missed;
    if (interrupted(drive, command, torque)) {
        return;
    }
    command->control = SJ_SERVO_TORQUE;
    command->speed_max_rad_s /= SJ_SPEED_CLAMP;
    command->torque_nm = torque;
    drive->demand.torque_nm = torque;
}
