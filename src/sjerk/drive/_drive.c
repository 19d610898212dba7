/* One SYNC period of a drive, in the order of the data: supervision of what it is told, the state
 * machine, the motion its state allows, the servo, supervision of the result, the words.
 *
 * Pure: everything is in the struct that is passed in.
 * Never here: clocks, transport, planning, the motor's equations.
 */
#include <stddef.h> /* required by the contract */
#include <stdint.h> /* the contract's integer types */
#include "_internal.h" /* what the rooms of the drive share */

static int mode_supported(int32_t mode)
{
    switch (mode) {
    case SJ_MODE_NONE:
    case SJ_MODE_PROFILE_POSITION:
    case SJ_MODE_PROFILE_VELOCITY:
    case SJ_MODE_HOMING:
    case SJ_MODE_CSP:
    case SJ_MODE_CSV:
    case SJ_MODE_CST:
        return 1;
    default:
        return 0;
    }
}

/* The present fault leaves no control of the motor, or 605Eh wants none. */
static int coasts(const sj_drive *drive)
{
    return sj_drive_fault(drive->fault)->reaction == SJ_FAULT_COASTS ||
           drive->config.fault_option == 0;
}

/* T13: the fault reaction begins in the same period. */
static void raise(sj_drive *drive, int32_t fault)
{
    sj_drive_input input = {.fault = 1};
    uint32_t ran = 0;

    if (drive->state == SJ_STATE_FAULT || drive->state == SJ_STATE_FAULT_REACTION) {
        return;
    }
    drive->state = sj_drive_next(drive->state, &input, &ran);
    drive->transitions |= ran;
    drive->fault = fault;
    drive->error_code = sj_drive_fault(fault)->code;
    drive->follows = 0;
}

/* Missed SYNCs count while the drive is to follow: +3 for each, -1 for each that came. */
static int32_t supervise_sync(sj_drive *drive, const sj_drive_rx *rx)
{
    const uint32_t limit = drive->config.sync_error_limit;

    if (drive->state != SJ_STATE_OPERATION_ENABLED || drive->mode < SJ_MODE_CSP) {
        drive->missed_in_row = 0;
        drive->sync_errors = 0;
        return SJ_FAULT_NONE;
    }
    if (!rx->sync_missed) {
        drive->missed_in_row = 0;
        drive->sync_errors -= drive->sync_errors > 0;
        return SJ_FAULT_NONE;
    }
    drive->verdict.missed_syncs++;
    drive->warning = 1;
    drive->missed_in_row += drive->missed_in_row < INT32_MAX;
    drive->sync_errors += drive->sync_errors < INT32_MAX - 3 ? 3 : 0;
    return limit != 0xFFFF && (uint32_t)drive->sync_errors >= limit ? SJ_FAULT_SYNC : SJ_FAULT_NONE;
}

/* The fault this period begins with, if any. */
static int32_t supervise_inputs(sj_drive *drive, const sj_drive_rx *rx)
{
    const int powered = drive->state >= SJ_STATE_READY;
    const double speed = drive->servo.measured_rad_s;
    const double most = SJ_OVER_SPEED * drive->config.max_speed_rpm * SJ_RPM;
    const int32_t sync = supervise_sync(drive, rx);

    for (int32_t fault = 1; fault < SJ_FAULTS && drive->causes != 0; fault++) {
        /* without power a disabled drive just stays disabled; a lost link acts by 6007h */
        const int waits = (fault == SJ_FAULT_SAFE_TORQUE_OFF || fault == SJ_FAULT_UNDER_VOLTAGE) &&
                          !powered;
        const int by_option = fault == SJ_FAULT_LOST_LINK && drive->config.abort_option != 1;
        if (has_cause(drive, fault) && !waits && !by_option) {
            return fault;
        }
    }
    if (sync != SJ_FAULT_NONE) {
        return sync;
    }
    return speed > most || speed < -most ? SJ_FAULT_OVER_SPEED : SJ_FAULT_NONE;
}

/* |60F4h| beyond 6065h for longer than 6066h, while the position loop is closed. */
static void supervise_following(sj_drive *drive, const sj_servo_command *command)
{
    const sj_drive_config *config = &drive->config;
    const int64_t error = sj_point_difference(drive, drive->demand.units, drive->actual.units);
    const int64_t size = error < 0 ? -error : error;
    const int supervised = drive->state == SJ_STATE_OPERATION_ENABLED &&
                           command->control == SJ_SERVO_POSITION;

    if (supervised && drive->follows && size > drive->verdict.following_max) {
        drive->verdict.following_max = (uint32_t)size;
    }
    if (!supervised || config->following_window == UINT32_MAX || size <= config->following_window) {
        drive->following_cycles = 0;
        return;
    }
    drive->following_cycles++;
    if (drive->following_cycles * config->period_s * 1e3 > config->following_time_ms) {
        drive->following_error = 1;
        raise(drive, SJ_FAULT_FOLLOWING_ERROR);
    }
}

/* The controlword that counts: not in local control, and 6007h when the link is lost. */
static uint16_t effective_controlword(const sj_drive *drive, uint16_t word)
{
    if (drive->local) {
        return drive->controlword;
    }
    if (has_cause(drive, SJ_FAULT_LOST_LINK)) {
        if (drive->config.abort_option == 2) {
            return 0x0000;
        }
        if (drive->config.abort_option == 3) {
            return SJ_CW_ENABLE_VOLTAGE;
        }
    }
    return word;
}

static void step_state(sj_drive *drive, uint16_t word)
{
    const int32_t before = drive->state;
    const uint32_t no_power =
        (uint32_t)1 << SJ_FAULT_SAFE_TORQUE_OFF | (uint32_t)1 << SJ_FAULT_UNDER_VOLTAGE;
    const sj_drive_input input = {
        .controlword = word,
        .previous = drive->controlword,
        .quick_stop_option = (int16_t)drive->config.quick_stop_option,
        .shutdown_option = (int16_t)drive->config.shutdown_option,
        .disable_option = (int16_t)drive->config.disable_option,
        .power = (drive->causes & no_power) == 0,
        .cause = drive->causes != 0 && !(drive->config.abort_option != 1 &&
                                         drive->causes == (uint32_t)1 << SJ_FAULT_LOST_LINK),
        .standing = (uint8_t)(drive->standing ||
                              (before == SJ_STATE_FAULT_REACTION && coasts(drive))),
    };
    uint32_t ran = 0;

    drive->state = sj_drive_next(before, &input, &ran);
    drive->transitions |= ran;
    drive->controlword_before = drive->controlword;
    drive->controlword = word;
    if (drive->state == SJ_STATE_OPERATION_ENABLED && before != drive->state) {
        sj_motion_adopt_actual(drive); /* T4, T16 */
        drive->servo.integral_nm = before == SJ_STATE_QUICK_STOP ? drive->servo.integral_nm : 0.0;
        drive->resync = 1;
        drive->warning = 0;
    }
    if (before == SJ_STATE_FAULT && drive->state != before) {
        drive->fault = SJ_FAULT_NONE; /* T15 */
        drive->error_code = 0;
        drive->following_error = 0;
        drive->warning = 0;
    }
}

/* 6061h follows 6060h between two periods, without a bump. */
static void step_mode(sj_drive *drive, int32_t wanted)
{
    if (wanted == drive->mode || !mode_supported(wanted)) {
        return;
    }
    if (drive->mode == SJ_MODE_CST && drive->state == SJ_STATE_OPERATION_ENABLED) {
        drive->servo.integral_nm = drive->servo.command_nm;
    }
    drive->torque_demand_nm = drive->servo.command_nm;
    drive->mode = wanted;
    drive->resync = 1;
    drive->goal_set = 0;
    drive->goal_waits = 0;
    drive->acknowledged = 0;
    sj_profile_drop(drive);
}

/* What the motor does in this period, by state. */
static void move(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const sj_drive_config *config = &drive->config;
    const uint16_t word = drive->controlword;
    int32_t fault = SJ_FAULT_NONE;

    switch (drive->state) {
    case SJ_STATE_OPERATION_ENABLED:
        if ((word & SJ_CW_SWITCH_ON) == 0 || (word & SJ_CW_ENABLE_OPERATION) == 0) {
            /* the ramp of 605Bh or 605Ch, before the state changes */
            sj_motion_stop(drive, command, 1);
            drive->resync = 1;
        } else if (word & SJ_CW_HALT) {
            sj_motion_stop(drive, command, config->halt_option);
            drive->resync = 1;
        } else if (drive->mode == SJ_MODE_NONE) {
            sj_motion_stop(drive, command, 1);
            drive->resync = 1;
        } else if (drive->resync && drive->mode == SJ_MODE_CSP) {
            /* the master sees where the axis is before its targets count */
            sj_motion_adopt_actual(drive);
            sj_motion_stop(drive, command, 1);
            drive->resync = 0;
        } else if (drive->mode == SJ_MODE_PROFILE_POSITION) {
            sj_profile_position(drive, rx, command);
        } else if (drive->mode == SJ_MODE_PROFILE_VELOCITY) {
            sj_profile_velocity(drive, rx, command);
        } else if (drive->mode == SJ_MODE_HOMING) {
            sj_homing_period(drive, command);
        } else if (drive->mode == SJ_MODE_CSP) {
            fault = sj_motion_follow_position(drive, rx, command);
        } else {
            if (drive->resync) {
                sj_motion_adopt_actual(drive);
                drive->resync = 0;
            }
            if (drive->mode == SJ_MODE_CSV) {
                sj_motion_follow_velocity(drive, rx, command);
            } else {
                sj_motion_follow_torque(drive, rx, command);
            }
        }
        if (fault == SJ_FAULT_NONE) {
            return;
        }
        raise(drive, fault);
        sj_motion_stop(drive, command, config->fault_option == 0 ? 2 : config->fault_option);
        return;

    case SJ_STATE_QUICK_STOP:
        if (config->quick_stop_option == 0) {
            sj_motion_power_off(drive, command);
        } else {
            /* 5..8 are the ramps 1..4 and stay here */
            sj_motion_stop(drive, command, (config->quick_stop_option - 1) % 4 + 1);
        }
        return;

    case SJ_STATE_FAULT_REACTION:
        if (coasts(drive)) {
            sj_motion_power_off(drive, command);
        } else {
            sj_motion_stop(drive, command, config->fault_option);
        }
        return;

    default:
        sj_motion_power_off(drive, command);
    }
}

/* Whether a stop has ended: no demand velocity, and the motor stands or had its time. */
static void judge_standing(sj_drive *drive)
{
    const double speed = drive->servo.measured_rad_s;
    const double still = SJ_STANDSTILL * drive->config.max_speed_rpm * SJ_RPM;

    if (drive->demand_velocity != 0.0) {
        drive->stop_cycles = 0;
        drive->standing = 0;
        return;
    }
    drive->stop_cycles += drive->stop_cycles < UINT32_MAX;
    drive->standing = (speed < still && speed > -still) ||
                      drive->stop_cycles * drive->config.period_s > drive->config.stop_timeout_s;
}

/* Bit 10: CSP inside the position window for its time; halted: standing. */
static int target_reached(sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const int64_t error = sj_point_difference(drive, drive->demand.units, drive->actual.units);

    if (drive->state != SJ_STATE_OPERATION_ENABLED) {
        drive->window_cycles = 0;
        return 0;
    }
    if (drive->controlword & SJ_CW_HALT) {
        return drive->standing;
    }
    if (drive->mode != SJ_MODE_CSP || !drive->follows ||
        (config->position_window != UINT32_MAX &&
         (error > config->position_window || error < -(int64_t)config->position_window))) {
        drive->window_cycles = 0;
        return 0;
    }
    drive->window_cycles += drive->window_cycles < UINT32_MAX;
    return drive->window_cycles * config->period_s * 1e3 >= config->position_time_ms;
}

static int32_t to_int32(double value)
{
    if (value >= 2147483647.0) {
        return INT32_MAX;
    }
    if (value <= -2147483648.0) {
        return INT32_MIN;
    }
    return (int32_t)(value < 0.0 ? value - 0.5 : value + 0.5);
}

static int16_t to_int16(double value)
{
    const int32_t whole = to_int32(value);
    return (int16_t)(whole > INT16_MAX ? INT16_MAX : whole < INT16_MIN ? INT16_MIN : whole);
}

static int32_t position_word(const sj_drive *drive, int64_t units)
{
    return (int32_t)sj_point_wrap(drive, turned(drive, units, SJ_POLARITY_POSITION));
}

static void tell(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    const sj_drive_config *config = &drive->config;
    const sj_servo *servo = &drive->servo;
    const double to_units = (double)drive->ratio_units / (double)drive->ratio_increments;
    const double per_mille = 1000.0 / config->rated_torque_nm;
    const double velocity_sign = config->polarity & SJ_POLARITY_VELOCITY ? -1.0 : 1.0;
    const double torque_sign = config->polarity & SJ_POLARITY_TORQUE ? -1.0 : 1.0;
    const int following = drive->follows && drive->state == SJ_STATE_OPERATION_ENABLED;
    uint16_t word = sj_drive_state_bits(drive->state);

    word |= has_cause(drive, SJ_FAULT_UNDER_VOLTAGE) ? 0 : SJ_SW_VOLTAGE;
    word |= drive->warning ? SJ_SW_WARNING : 0;
    word |= rx->sync_missed ? 0 : SJ_SW_SYNC;
    word |= drive->local ? 0 : SJ_SW_REMOTE;
    word |= drive->limited || servo->torque_limited || servo->speed_limited ? SJ_SW_LIMIT : 0;
    if (drive->mode == SJ_MODE_HOMING) {
        word |= sj_homing_bits(drive);
    } else if ((drive->mode == SJ_MODE_PROFILE_POSITION ||
                drive->mode == SJ_MODE_PROFILE_VELOCITY) &&
               drive->state == SJ_STATE_OPERATION_ENABLED &&
               !(drive->controlword & SJ_CW_HALT)) {
        word |= sj_profile_bits(drive);
    } else {
        word |= target_reached(drive) ? SJ_SW_TARGET_REACHED : 0;
        word |= following ? SJ_SW_FOLLOWS : 0;
        word |= drive->following_error ? SJ_SW_FOLLOWING_ERROR : 0;
    }

    tx->statusword = word;
    tx->mode_display = (int8_t)drive->mode;
    tx->error_register = sj_drive_fault(drive->fault)->error_register;
    tx->error_code = drive->error_code;
    tx->position_actual = position_word(drive, drive->actual.units);
    tx->position_demand = position_word(drive, drive->demand.units);
    tx->following_error = (int32_t)turned(
        drive, sj_point_difference(drive, drive->demand.units, drive->actual.units),
        SJ_POLARITY_POSITION);
    tx->velocity_actual = to_int32(velocity_sign * servo->measured_rad_s *
                                   drive->constants.increments_per_rad * to_units);
    tx->velocity_demand =
        to_int32(velocity_sign * drive->demand_velocity / config->period_s * to_units);
    tx->torque_actual = to_int16(torque_sign * servo->torque_nm * per_mille);
    tx->torque_demand = to_int16(torque_sign * servo->command_nm * per_mille);
    tx->current_actual = to_int16(servo->torque_nm * per_mille);
    tx->position_internal = (int32_t)(uint32_t)(uint64_t)drive->actual.increments;
    tx->demand_internal = (int32_t)(uint32_t)(uint64_t)drive->demand.increments;
    tx->digital_inputs = sj_drive_digital_inputs(drive);
    tx->dc_link_mv = has_cause(drive, SJ_FAULT_UNDER_VOLTAGE)  ? 0
                     : has_cause(drive, SJ_FAULT_OVER_VOLTAGE) ? 420000
                                                               : 325000;
}

/* What bounds the period's command whatever it is: torque limits, speed limit, offsets. */
static sj_servo_command bounds(const sj_drive *drive, const sj_drive_rx *rx)
{
    const sj_drive_config *config = &drive->config;
    const double unit = 1e-3 * config->rated_torque_nm;
    const double rated = config->max_torque * unit;
    const double most = rated < config->peak_torque_nm ? rated : config->peak_torque_nm;
    const double high = config->torque_limit_positive * unit;
    const double low = config->torque_limit_negative * unit;
    const double to_speed = (double)drive->ratio_increments / (double)drive->ratio_units /
                            drive->constants.increments_per_rad;

    return (sj_servo_command){
        .velocity_offset_rad_s =
            (double)turned(drive, rx->velocity_offset, SJ_POLARITY_VELOCITY) * to_speed,
        .torque_nm = (double)turned(drive, rx->torque_offset, SJ_POLARITY_TORQUE) * unit,
        .torque_max_nm = high < most ? high : most,
        .torque_min_nm = low < most ? -low : -most,
        .speed_max_rad_s = SJ_SPEED_CLAMP * config->max_speed_rpm * SJ_RPM,
    };
}

/* Up to the servo's command. */
static sj_servo_command begin(sj_drive *drive, const sj_drive_rx *rx)
{
    sj_servo_command command = bounds(drive, rx);
    const int32_t fault = supervise_inputs(drive, rx);

    drive->cycles++;
    drive->transitions = 0;
    drive->limited = 0;
    if (fault != SJ_FAULT_NONE && drive->state != SJ_STATE_FAULT &&
        drive->state != SJ_STATE_FAULT_REACTION) {
        raise(drive, fault);
        drive->controlword_before = drive->controlword;
        drive->controlword = effective_controlword(drive, rx->controlword);
    } else {
        step_state(drive, effective_controlword(drive, rx->controlword));
    }
    step_mode(drive, rx->mode);
    if (drive->state != SJ_STATE_OPERATION_ENABLED || drive->resync ||
        drive->controlword & SJ_CW_HALT) {
        drive->follows = 0;
    }
    if (drive->state != SJ_STATE_OPERATION_ENABLED || drive->mode != SJ_MODE_HOMING ||
        drive->controlword & SJ_CW_HALT) {
        drive->homing = SJ_HOMING_IDLE; /* a search that is left is over */
    }
    if (drive->state != SJ_STATE_OPERATION_ENABLED) {
        drive->goal_set = 0;
        drive->goal_waits = 0;
        drive->acknowledged = 0;
        sj_profile_drop(drive);
    } else if (drive->controlword & SJ_CW_HALT &&
               (drive->plan_phase >= 0 || drive->goal_set == SJ_VELOCITY_GOAL)) {
        /* released, the axis waits for a new set-point; a velocity comes back */
        sj_profile_drop(drive);
        drive->goal_set = 0;
        drive->goal_waits = 0;
    }
    move(drive, rx, &command);
    command.brake |= (rx->digital_outputs & rx->output_mask & 1u) != 0;
    return command;
}

/* After the servo's period; before: the encoder at its begin. */
static void end(sj_drive *drive, const sj_drive_rx *rx, const sj_servo_command *command,
                int64_t before, sj_drive_tx *tx)
{
    sj_point_move_increments(drive, &drive->actual,
                             subtract_wrapping(drive->servo.encoder, before));
    if (command->control == SJ_SERVO_OFF) {
        sj_motion_adopt_actual(drive);
    }
    judge_standing(drive);
    supervise_following(drive, command);
    tell(drive, rx, tx);
}

void sj_drive_cycle(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    const sj_servo_command command = begin(drive, rx);
    const int64_t before = drive->servo.encoder;

    sj_servo_period(&drive->servo, &drive->constants, &command);
    end(drive, rx, &command, before, tx);
}

void sj_drive_cycles(sj_drive *const *drives, const sj_drive_rx *const *rx, sj_drive_tx *const *tx,
                     int32_t count)
{
    sj_servo_command command[SJ_MOTORS];
    int64_t before[SJ_MOTORS];

    for (int32_t first = 0; first < count; first += SJ_MOTORS) {
        const int32_t n = count - first < SJ_MOTORS ? count - first : SJ_MOTORS;
        for (int32_t i = 0; i < n; i++) {
            command[i] = begin(drives[first + i], rx[first + i]);
            before[i] = drives[first + i]->servo.encoder;
        }
        sj_servo_periods(n, &drives[first], command);
        for (int32_t i = 0; i < n; i++) {
            end(drives[first + i], rx[first + i], &command[i], before[i], tx[first + i]);
        }
    }
}
