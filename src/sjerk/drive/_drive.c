/* One SYNC period of a drive, in the order of the data: supervision of what it gets, the state
 * machine, the motion its state allows, the servo, supervision of the result, the words. And the
 * place where the drive meets the planner: what modes 1 and 3 ask for is planned at the period's end.
 *
 * Pure: everything is in the struct that is passed in.
 * Never here: clocks, transport, how a plan is found, the motor's equations.
 */
#include <math.h>             /* ceil, where a plan is made */
#include <stddef.h>           /* NULL */
#include <stdint.h>           /* fixed widths */
#include "drive/_internal.h"  /* what the files of the drive share */
#include "planner/_planner.h" /* modes 1 and 3 */

static int supports_mode(int32_t mode)
{
    switch (mode) {
    case SJ_MODE_NONE:
    case SJ_MODE_PROFILE_POSITION:
    case SJ_MODE_PROFILE_VELOCITY:
    case SJ_MODE_PROFILE_TORQUE:
    case SJ_MODE_HOMING:
    case SJ_MODE_INTERPOLATED:
    case SJ_MODE_CSP:
    case SJ_MODE_CSV:
    case SJ_MODE_CST: return 1;
    default: return 0;
    }
}

/* The present fault leaves no control of the motor, or 605Eh wants none. */
static int coasts(const sj_drive *drive)
{
    return sj_drive_fault(drive->fault)->reaction == SJ_FAULT_COASTS ||
           drive->config.fault_option == 0;
}

/* The controlword that counts: not in local control, and 6007h when the link is lost. */
static uint16_t effective_controlword(const sj_drive *drive, uint16_t word)
{
    if (drive->local) {
        return drive->controlword;
    }
    if (drive->causes & SJ_LINK_CAUSES) {
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
        .cause = (drive->causes &
                  ~(drive->config.abort_option == 1 ? 0u : (uint32_t)SJ_LINK_CAUSES)) != 0,
        .standing =
            (uint8_t)(drive->standing || (before == SJ_STATE_FAULT_REACTION && coasts(drive))),
    };
    uint32_t ran = 0;

    drive->state = sj_drive_next(before, &input, &ran);
    drive->transitions |= ran;
    drive->controlword_before = drive->controlword;
    drive->controlword = word;
    if (drive->state == SJ_STATE_OPERATION_ENABLED && before != drive->state) {
        if (drive->stop == 0) {
            sj_motion_adopt_actual(drive); /* T4, T16; a ramp that is under way goes on */
        }
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
    if (wanted == drive->mode || !supports_mode(wanted)) {
        return;
    }
    if (drive->mode == SJ_MODE_CST && drive->state == SJ_STATE_OPERATION_ENABLED) {
        drive->servo.integral_nm = drive->servo.command_nm;
    }
    drive->demand.torque_nm = drive->servo.command_nm;
    drive->mode = wanted;
    drive->resync = 1;
    drive->goal.acknowledged = 0;
    sj_profile_give_up(drive);
}

/* Modes that plan their own way go on from any velocity: a stop that was ordered ends with its order. */
static int plans_its_way(int32_t mode)
{
    return mode == SJ_MODE_PROFILE_POSITION || mode == SJ_MODE_PROFILE_VELOCITY ||
           mode == SJ_MODE_PROFILE_TORQUE || mode == SJ_MODE_HOMING;
}

/* The ramp that the words ask for while operation is enabled: of 605Bh or 605Ch before the state
 * changes, of halt, of no mode; 0: none. */
static int32_t ordered_stop(const sj_drive *drive)
{
    const uint16_t word = drive->controlword;

    if ((word & SJ_CW_SWITCH_ON) == 0 || (word & SJ_CW_ENABLE_OPERATION) == 0) {
        return 1;
    }
    if (word & SJ_CW_HALT) {
        return drive->config.halt_option;
    }
    return drive->mode == SJ_MODE_NONE;
}

/* What the mode does in a period; returns a fault or SJ_FAULT_NONE. */
static int32_t run_mode(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    switch (drive->mode) {
    case SJ_MODE_PROFILE_POSITION: sj_profile_position(drive, command); return SJ_FAULT_NONE;
    case SJ_MODE_PROFILE_VELOCITY: sj_profile_velocity(drive, rx, command); return SJ_FAULT_NONE;
    case SJ_MODE_HOMING: sj_homing_period(drive, command); return SJ_FAULT_NONE;
    case SJ_MODE_INTERPOLATED: return sj_cyclic_interpolated(drive, rx, command);
    case SJ_MODE_CSP: return sj_cyclic_position(drive, rx, command);
    default: break;
    }
    if (drive->resync) {
        sj_motion_adopt_actual(drive);
        drive->demand.torque_nm = drive->servo.command_nm;
        drive->resync = 0;
    }
    switch (drive->mode) {
    case SJ_MODE_PROFILE_TORQUE: sj_profile_torque(drive, rx, command); break;
    case SJ_MODE_CSV: sj_cyclic_velocity(drive, rx, command); break;
    default: sj_cyclic_torque(drive, rx, command);
    }
    return SJ_FAULT_NONE;
}

/* Operation enabled: a stop that is ordered or has begun, or else the mode. */
static int32_t operate(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const int32_t ordered = ordered_stop(drive);

    if (drive->mode == SJ_MODE_PROFILE_POSITION) {
        sj_profile_offer(drive, rx);
    }
    if (ordered != 0) {
        sj_profile_drop(drive);
        sj_motion_begin_stop(drive, command, ordered);
        drive->resync = 1;
        if (plans_its_way(drive->mode)) {
            drive->stop = 0;
        }
        return SJ_FAULT_NONE;
    }
    if (sj_motion_stopping(drive, command)) {
        return SJ_FAULT_NONE;
    }
    return run_mode(drive, rx, command);
}

/* What the motor does in this period, by state. */
static void command_motion(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const sj_drive_config *config = &drive->config;
    int32_t fault = SJ_FAULT_NONE;

    switch (drive->state) {
    case SJ_STATE_OPERATION_ENABLED:
        fault = operate(drive, rx, command);
        if (fault == SJ_FAULT_NONE) {
            return;
        }
        sj_drive_raise(drive, fault);
        sj_motion_stop(drive, command, config->fault_option == 0 ? 2 : config->fault_option);
        return;

    case SJ_STATE_QUICK_STOP:
        if (config->quick_stop_option == 0) {
            sj_motion_power_off(drive, command);
        } else {
            sj_motion_begin_stop(drive, command, quick_stop_ramp(config)); /* and after T16 */
        }
        return;

    case SJ_STATE_FAULT_REACTION:
        if (coasts(drive)) {
            sj_motion_power_off(drive, command);
        } else {
            sj_motion_stop(drive, command, config->fault_option);
        }
        return;

    default: sj_motion_power_off(drive, command);
    }
}

/* What bound_command the period's command whatever it is: torque limits, speed limit, offsets. */
static sj_servo_command bound_command(const sj_drive *drive, const sj_drive_rx *rx)
{
    const sj_drive_config *config = &drive->config;
    const double unit = 1e-3 * config->rated_torque_nm;
    const double rated = config->max_torque * unit;
    const double most = rated < config->peak_torque_nm ? rated : config->peak_torque_nm;
    const double high = config->torque_limit_positive * unit;
    const double low = config->torque_limit_negative * unit;
    const double to_speed = increments_per_unit(drive) / drive->constants.increments_per_rad;

    return (sj_servo_command){
        .velocity_offset_rad_s =
            (double)with_polarity(drive, rx->velocity_offset, SJ_POLARITY_VELOCITY) * to_speed,
        .torque_nm = (double)with_polarity(drive, rx->torque_offset, SJ_POLARITY_TORQUE) * unit,
        .torque_max_nm = high < most ? high : most,
        .torque_min_nm = low < most ? -low : -most,
        .speed_max_rad_s = SJ_SPEED_CLAMP * config->max_speed_rpm * SJ_RPM,
    };
}

/* Up to the servo's command. */
static sj_servo_command begin_period(sj_drive *drive, const sj_drive_rx *rx)
{
    sj_servo_command command = bound_command(drive, rx);
    const int32_t fault = sj_supervise_inputs(drive, rx);

    drive->cycles++;
    drive->transitions = 0;
    drive->limited = 0;
    if (fault != SJ_FAULT_NONE && drive->state != SJ_STATE_FAULT &&
        drive->state != SJ_STATE_FAULT_REACTION) {
        sj_drive_raise(drive, fault);
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
        drive->homing.phase = SJ_HOMING_IDLE; /* a search that is left is over */
    }
    if (drive->state != SJ_STATE_OPERATION_ENABLED) {
        drive->goal.acknowledged = 0;
        sj_profile_give_up(drive);
    }
    if (drive->state != SJ_STATE_OPERATION_ENABLED && drive->state != SJ_STATE_QUICK_STOP) {
        drive->stop = 0;
    }
    command_motion(drive, rx, &command);
    command.brake |= (rx->digital_outputs & rx->output_mask & 1u) != 0;
    return command;
}

/* After the servo's period; before: the encoder at its begin. */
static void end_period(sj_drive *drive, const sj_drive_rx *rx, const sj_servo_command *command,
                       int64_t before, sj_drive_tx *tx)
{
    sj_point_move_increments(drive, &drive->actual,
                             subtract_wrapping(drive->servo.encoder, before));
    if (command->control == SJ_SERVO_OFF) {
        sj_motion_adopt_actual(drive);
    }
    sj_probes_period(drive, rx->probe_function, before);
    sj_supervise_standing(drive);
    sj_supervise_following(drive, command);
    sj_report_words(drive, rx, tx);
}

void sj_drive_cycle(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    const sj_servo_command command = begin_period(drive, rx);
    const int64_t before = drive->servo.encoder;

    sj_servo_period(&drive->servo, &drive->constants, &command);
    end_period(drive, rx, &command, before, tx);
}

void sj_drive_cycles(sj_drive *const *drives, const sj_drive_rx *const *rx, sj_drive_tx *const *tx,
                     int32_t count)
{
    sj_servo_command command[SJ_SERVO_LANES];
    int64_t before[SJ_SERVO_LANES];

    for (int32_t first = 0; first < count; first += SJ_SERVO_LANES) {
        const int32_t n = count - first < SJ_SERVO_LANES ? count - first : SJ_SERVO_LANES;
        for (int32_t i = 0; i < n; i++) {
            command[i] = begin_period(drives[first + i], rx[first + i]);
            before[i] = drives[first + i]->servo.encoder;
        }
        sj_servo_periods(n, &drives[first], command);
        for (int32_t i = 0; i < n; i++) {
            end_period(drives[first + i], rx[first + i], &command[i], before[i], tx[first + i]);
        }
    }
}

/* Where a plan ends, from its start. */
static double end_of(const sj_plan *plan, double velocity, double acceleration)
{
    double distance = 0.0;

    for (int32_t i = 0; i < plan->count; i++) {
        const double n = (double)plan->phase[i].cycles;
        const double jerk = plan->phase[i].jerk;
        distance += n * (velocity + n * (acceleration / 2.0 + n * jerk / 6.0));
        velocity += n * (acceleration + n * jerk / 2.0);
        acceleration += n * jerk;
    }
    return distance;
}

/* Turns of the range that a move in one direction needs: it may be too fast to stop at the first. */
static int64_t turns_needed(const sj_drive_request *request)
{
    const double direction = request->direction;
    sj_plan stop;
    double beyond = 0.0;

    if (request->direction == 0 || direction * request->velocity <= 0.0 ||
        sj_plan_velocity(request->velocity, request->acceleration, 0.0, &request->limits, &stop) !=
            SJ_PLAN_OK) {
        return 0;
    }
    beyond =
        direction * (end_of(&stop, request->velocity, request->acceleration) - request->distance);
    return beyond > 0.0 && beyond < 0x1p30 * request->turn ? (int64_t)ceil(beyond / request->turn)
                                                           : 0;
}

/* A move to its end at rest, or through it where that is sooner; request->goal says which. */
static int32_t plan_move(sj_drive_request *request, double distance, sj_plan *plan)
{
    const int32_t status = sj_plan_move(distance, request->velocity, request->acceleration, 0.0,
                                        &request->limits, plan);
    sj_plan through;

    if (request->goal != 0.0 && status == SJ_PLAN_OK &&
        sj_plan_move(distance, request->velocity, request->acceleration, request->goal,
                     &request->limits, &through) == SJ_PLAN_OK &&
        through.cycles <= plan->cycles) {
        *plan = through;
    } else {
        request->goal = 0.0;
    }
    return status;
}

void sj_drive_cycle_planned(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    sj_drive_request *request = &drive->goal.request;
    sj_plan plan;
    int32_t status = SJ_PLAN_OK;
    int64_t turns = 0;

    sj_drive_cycle(drive, rx, tx);
    switch (request->kind) {
    case SJ_REQUEST_MOVE:
        turns = request->direction * turns_needed(request);
        status = plan_move(request, request->distance + (double)turns * request->turn, &plan);
        break;
    case SJ_REQUEST_VELOCITY:
        status = sj_plan_velocity(request->velocity, request->acceleration, request->goal,
                                  &request->limits, &plan);
        break;
    default: return;
    }
    sj_profile_answer(drive, status == SJ_PLAN_OK ? &plan : NULL, turns);
}
