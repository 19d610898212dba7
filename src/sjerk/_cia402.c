/* The CiA 402 drive: state machine, supervision of what it is told, and one SYNC period.
 *
 * Top to bottom: faults by name, the state machine (transitions 0-16 of IEC 61800-7-201), positions
 * in two units, the motions a state allows, supervision, the words. sj_drive_cycle() at the end
 * runs them in the order of the data. Pure: everything is in the struct that is passed in.
 * Never here: clocks, transport, planning, the motor's equations (_servo.c), the verdict (_stream.c).
 */
#include <stdint.h> /* the contract's integer types */
#include <stddef.h> /* required by the contract */
#include "_kernel.h"

/* ---- faults by name ---- */

enum {                                  /* bits of 1001h */
    GENERIC = 1,
    CURRENT = 2,
    VOLTAGE = 4,
    TEMPERATURE = 8,
    COMMUNICATION = 16,
    PROFILE = 32,
    MAKER = 128
};
enum { RAMP = 0, COAST = 1 };           /* whether the motor can still be controlled */

typedef struct {
    uint16_t code;                      /* 603Fh and the first two bytes of an emergency */
    uint8_t error_register;             /* 1001h */
    uint8_t reaction;
} fault_row;

static const fault_row FAULTS[SJ_FAULTS] = {
    [SJ_FAULT_NONE] = {0x0000, 0, RAMP},
    [SJ_FAULT_OVER_CURRENT] = {0x2310, GENERIC | CURRENT, COAST},
    [SJ_FAULT_EARTH] = {0x2330, GENERIC | CURRENT, COAST},
    [SJ_FAULT_OVER_VOLTAGE] = {0x3210, GENERIC | VOLTAGE, COAST},
    [SJ_FAULT_UNDER_VOLTAGE] = {0x3220, GENERIC | VOLTAGE, COAST},
    [SJ_FAULT_OVER_TEMPERATURE] = {0x4310, GENERIC | TEMPERATURE, RAMP},
    [SJ_FAULT_ENCODER] = {0x7305, GENERIC | PROFILE, COAST},
    [SJ_FAULT_SAFE_TORQUE_OFF] = {0xFF80, GENERIC | MAKER, COAST},
    [SJ_FAULT_BRAKE] = {0x7110, GENERIC | PROFILE, RAMP},
    [SJ_FAULT_LOST_LINK] = {0x8130, GENERIC | COMMUNICATION, RAMP},
    [SJ_FAULT_OVER_SPEED] = {0x8400, GENERIC | PROFILE, RAMP},
    [SJ_FAULT_FOLLOWING_ERROR] = {0x8611, GENERIC | PROFILE, RAMP},
    [SJ_FAULT_REFERENCE_LIMIT] = {0x8612, GENERIC | PROFILE, RAMP},
    [SJ_FAULT_SYNC] = {0x8700, GENERIC | COMMUNICATION, RAMP},
};

static const double OVER_SPEED = 1.2;       /* of the maximum motor speed: trips */
static const double SPEED_CLAMP = 1.1;      /* the velocity command is held within */
static const double STANDSTILL = 1e-3;      /* of the maximum motor speed: stands */
static const double RPM = 6.283185307179586476925286766559 / 60.0;

uint16_t sj_drive_fault_code(int32_t fault)
{
    return fault >= 0 && fault < SJ_FAULTS ? FAULTS[fault].code : 0;
}

void sj_drive_inject(sj_drive *drive, int32_t fault, int32_t present)
{
    if (fault > SJ_FAULT_NONE && fault < SJ_FAULTS) {
        const uint32_t bit = (uint32_t)1 << fault;
        drive->causes = present ? drive->causes | bit : drive->causes & ~bit;
    }
}

static int has_cause(const sj_drive *drive, int32_t fault)
{
    return (drive->causes >> fault & 1u) != 0;
}

/* ---- the state machine ---- */

enum { DISABLE_VOLTAGE, QUICK_STOP, SHUTDOWN, SWITCH_ON, ENABLE_OPERATION };

/* The command in bits 3, 2, 1, 0; SWITCH_ON is Disable operation when operation is enabled.
 * Bit 7 acts by its edge in Fault alone: a master may leave it set and still command. */
static int command_of(uint16_t word)
{
    if (!(word & SJ_CW_ENABLE_VOLTAGE)) {
        return DISABLE_VOLTAGE;
    }
    if (!(word & SJ_CW_QUICK_STOP)) {
        return QUICK_STOP;
    }
    if (!(word & SJ_CW_SWITCH_ON)) {
        return SHUTDOWN;
    }
    return word & SJ_CW_ENABLE_OPERATION ? ENABLE_OPERATION : SWITCH_ON;
}

static int32_t take(uint32_t *transitions, int32_t number, int32_t state)
{
    *transitions |= (uint32_t)1 << number;
    return state;
}

int32_t sj_drive_next(int32_t state, const sj_drive_input *in, uint32_t *ran)
{
    const int command = command_of(in->controlword);
    const int reset = (in->controlword & ~in->previous & SJ_CW_FAULT_RESET) != 0;

    *ran = 0;
    if (in->fault && state != SJ_STATE_FAULT_REACTION && state != SJ_STATE_FAULT) {
        return take(ran, 13, SJ_STATE_FAULT_REACTION);
    }
    switch (state) {
    case SJ_STATE_NOT_READY:
        return take(ran, 1, SJ_STATE_SWITCH_ON_DISABLED);

    case SJ_STATE_SWITCH_ON_DISABLED:
        if (command == SHUTDOWN && in->power) {
            return take(ran, 2, SJ_STATE_READY);
        }
        return state;

    case SJ_STATE_READY:
        switch (command) {
        case DISABLE_VOLTAGE:
        case QUICK_STOP:
            return take(ran, 7, SJ_STATE_SWITCH_ON_DISABLED);
        case SWITCH_ON:
            return take(ran, 3, SJ_STATE_SWITCHED_ON);
        case ENABLE_OPERATION:
            (void)take(ran, 3, SJ_STATE_SWITCHED_ON);
            return take(ran, 4, SJ_STATE_OPERATION_ENABLED);
        default:
            return state;
        }

    case SJ_STATE_SWITCHED_ON:
        switch (command) {
        case DISABLE_VOLTAGE:
        case QUICK_STOP:
            return take(ran, 10, SJ_STATE_SWITCH_ON_DISABLED);
        case SHUTDOWN:
            return take(ran, 6, SJ_STATE_READY);
        case ENABLE_OPERATION:
            return take(ran, 4, SJ_STATE_OPERATION_ENABLED);
        default:
            return state;
        }

    case SJ_STATE_OPERATION_ENABLED:
        switch (command) {
        case DISABLE_VOLTAGE:
            return take(ran, 9, SJ_STATE_SWITCH_ON_DISABLED);
        case QUICK_STOP:
            return take(ran, 11, SJ_STATE_QUICK_STOP);
        case SHUTDOWN: /* with a ramp first, the state changes when the motor stands */
            return in->shutdown_option == 1 && !in->standing ? state
                                                             : take(ran, 8, SJ_STATE_READY);
        case SWITCH_ON:
            return in->disable_option == 1 && !in->standing
                       ? state
                       : take(ran, 5, SJ_STATE_SWITCHED_ON);
        default:
            return state;
        }

    case SJ_STATE_QUICK_STOP:
        if (command == DISABLE_VOLTAGE) {
            return take(ran, 12, SJ_STATE_SWITCH_ON_DISABLED);
        }
        if (in->quick_stop_option >= 5) {
            return command == ENABLE_OPERATION ? take(ran, 16, SJ_STATE_OPERATION_ENABLED) : state;
        }
        return in->standing || in->quick_stop_option == 0
                   ? take(ran, 12, SJ_STATE_SWITCH_ON_DISABLED)
                   : state;

    case SJ_STATE_FAULT_REACTION:
        return in->standing ? take(ran, 14, SJ_STATE_FAULT) : state;

    case SJ_STATE_FAULT:
        return reset && !in->cause ? take(ran, 15, SJ_STATE_SWITCH_ON_DISABLED) : state;

    default:
        return state;
    }
}

uint16_t sj_drive_state_bits(int32_t state)
{
    switch (state) {
    case SJ_STATE_SWITCH_ON_DISABLED:
        return SJ_SW_DISABLED;
    case SJ_STATE_READY:
        return SJ_SW_READY | SJ_SW_QUICK_STOP;
    case SJ_STATE_SWITCHED_ON:
        return SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_QUICK_STOP;
    case SJ_STATE_OPERATION_ENABLED:
        return SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_OPERATION_ENABLED | SJ_SW_QUICK_STOP;
    case SJ_STATE_QUICK_STOP:
        return SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_OPERATION_ENABLED;
    case SJ_STATE_FAULT_REACTION:
        return SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_OPERATION_ENABLED | SJ_SW_FAULT;
    case SJ_STATE_FAULT:
        return SJ_SW_FAULT;
    default:
        return 0;
    }
}

/* ---- positions in increments and in pu ---- */

/* Into the range of 607Bh; the full range is the plain wrap of INT32. */
static int64_t wrap(const sj_drive *drive, int64_t units)
{
    if (drive->range == (int64_t)1 << 32) {
        return (int32_t)(uint32_t)(uint64_t)units;
    }
    const int64_t above = (units - drive->config.range_min) % drive->range;
    return drive->config.range_min + (above < 0 ? above + drive->range : above);
}

/* The short way from one position to another, around the wrap if that is shorter. */
static int64_t difference(const sj_drive *drive, int64_t to, int64_t from)
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

static int64_t add_wrapping(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a + (uint64_t)b);
}

static int64_t subtract_wrapping(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a - (uint64_t)b);
}

/* Invariant of a point: increments * ratio_units + ratio_increments / 2
 *                       = units * ratio_increments + remainder, apart from wraps of both. */
static void move_increments(const sj_drive *drive, sj_drive_point *point, int64_t way)
{
    const int64_t share = way * drive->ratio_units + point->remainder;
    const int64_t units = floor_div(share, drive->ratio_increments);

    point->increments = add_wrapping(point->increments, way);
    point->remainder = share - units * drive->ratio_increments;
    point->units = wrap(drive, point->units + units);
}

/* The units are met exactly, the increments to the nearest; returns the way in increments. */
static int64_t move_units(const sj_drive *drive, sj_drive_point *point, int64_t way)
{
    const int64_t wanted =
        way * drive->ratio_increments - (point->remainder - drive->ratio_increments / 2);
    const int64_t increments =
        floor_div(wanted + drive->ratio_units / 2, drive->ratio_units);

    point->remainder += increments * drive->ratio_units - way * drive->ratio_increments;
    point->increments = add_wrapping(point->increments, increments);
    point->units = wrap(drive, point->units + way);
    return increments;
}

static void set_point(const sj_drive *drive, sj_drive_point *point, int64_t increments, int64_t units)
{
    point->increments = increments;
    point->units = wrap(drive, units);
    point->remainder = drive->ratio_increments / 2;
}

/* Polarity between the words and the motor. */
static int64_t turned(const sj_drive *drive, int64_t value, uint32_t bit)
{
    return drive->config.polarity & bit ? -value : value;
}

enum { POLARITY_POSITION = 0x80, POLARITY_VELOCITY = 0x40, POLARITY_TORQUE = 0x20 };

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
    set_point(drive, &drive->actual, 0, 0);
    set_point(drive, &drive->demand, 0, 0);
    sj_verdict_clear(&drive->verdict);
    return 0;
}

/* A new scale: positions are told anew from the encoder, a reference is lost. */
void sj_drive_rescale(sj_drive *drive)
{
    const int64_t increments = drive->actual.increments;

    set_point(drive, &drive->actual, 0, 0);
    move_increments(drive, &drive->actual, increments % ((int64_t)1 << 32));
    drive->actual.increments = increments;
    drive->demand = drive->actual;
    drive->demand_fraction = 0.0;
    drive->resync = 1;
    drive->homed = 0;
    sj_verdict_pause(&drive->verdict);
}

void sj_drive_set_home(sj_drive *drive, int64_t increments)
{
    const int64_t home = turned(drive, drive->config.home_offset, POLARITY_POSITION);
    sj_drive_point *const points[] = {&drive->actual, &drive->demand};

    for (int i = 0; i < 2; i++) {
        const int64_t now = points[i]->increments;
        const int64_t way = subtract_wrapping(now, increments) % ((int64_t)1 << 32);
        set_point(drive, points[i], increments, home);
        move_increments(drive, points[i], way);
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

/* ---- motions ---- */

/* Increments per period from rad/s of the motor, and back. */
static double per_period(const sj_drive *drive)
{
    return drive->constants.increments_per_rad * drive->config.period_s;
}

/* The demand becomes the actual position and speed: nothing jumps when the loop closes. */
static void adopt_actual(sj_drive *drive)
{
    const double speed = drive->servo.measured_rad_s;
    const double still = STANDSTILL * drive->config.max_speed_rpm * RPM;

    drive->demand = drive->actual;
    drive->demand_fraction = 0.0;
    drive->demand_velocity = speed > still || speed < -still ? speed * per_period(drive) : 0.0;
    drive->following_cycles = 0;
    drive->window_cycles = 0;
    drive->following_error = 0;
    sj_verdict_pause(&drive->verdict);
}

static void power_off(sj_drive *drive, sj_servo_command *command)
{
    command->control = SJ_SERVO_OFF;
    command->brake = 1;
    adopt_actual(drive);
}

/* A velocity the motor could have: what a wild target leaves behind stays finite. */
static double bounded(const sj_drive *drive, double velocity)
{
    const double most = drive->constants.speed_bound_rad_s * per_period(drive);
    return velocity > most ? most : velocity < -most ? -most : velocity;
}

/* One period of demand from the velocity at its start to the velocity at its end. */
static void ramp(sj_drive *drive, sj_servo_command *command, double advance, double velocity)
{
    const double speed = 1.0 / per_period(drive);
    const double total = drive->demand_fraction + advance;
    int64_t whole = (int64_t)total;

    whole -= (double)whole > total;
    command->control = SJ_SERVO_POSITION;
    command->demand = drive->demand.increments;
    command->fraction = drive->demand_fraction;
    command->advance = advance;
    command->velocity_start_rad_s = drive->demand_velocity * speed;
    command->velocity_end_rad_s = velocity * speed;
    command->torque_nm += drive->config.acceleration_feedforward * drive->constants.inertia_kg_m2 *
                          (velocity - drive->demand_velocity) * speed / drive->config.period_s;
    move_increments(drive, &drive->demand, whole);
    drive->demand_fraction = total - (double)whole;
    drive->demand_velocity = velocity;
}

void sj_drive_ramp_to(sj_drive *drive, sj_servo_command *command, double goal, double acceleration)
{
    const double start = drive->demand_velocity;
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
    ramp(drive, command, advance, goal);
}

/* A deceleration of 605Ah..605Eh in increments per period^2: 1 profile, 2 quick stop, 3 and 4 all
 * that the torque limit gives (a voltage limit is not modelled). */
static double deceleration(const sj_drive *drive, int32_t option, double torque)
{
    const sj_drive_config *config = &drive->config;
    const double scale = (double)drive->ratio_increments / (double)drive->ratio_units *
                         config->period_s * config->period_s;

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

static void stop(sj_drive *drive, sj_servo_command *command, int32_t option)
{
    const double torque = command->torque_max_nm < -command->torque_min_nm
                              ? command->torque_max_nm
                              : -command->torque_min_nm;

    sj_verdict_pause(&drive->verdict);
    drive->follows = 0;
    command->velocity_offset_rad_s = 0.0;
    sj_drive_ramp_to(drive, command, 0.0, deceleration(drive, option, torque));
}

/* Limit switches, as 60FDh shows them: bit 0 negative, 1 positive, 2 home, 3 interlock. */
uint32_t sj_drive_digital_inputs(const sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const double turns = (double)drive->servo.encoder * config->encoder_revolutions /
                         config->encoder_increments;

    return (config->switch_negative_rev > -1e9 && turns <= config->switch_negative_rev ? 1u : 0u) |
           (config->switch_positive_rev < 1e9 && turns >= config->switch_positive_rev ? 2u : 0u) |
           (config->switch_home_rev < 1e9 && turns >= config->switch_home_rev ? 4u : 0u) |
           (has_cause(drive, SJ_FAULT_SAFE_TORQUE_OFF) ? 8u : 0u);
}

/* 607Dh: the target is held inside; an axis that is outside may only come back. */
static int64_t software_limited(sj_drive *drive, int64_t target)
{
    const sj_drive_config *config = &drive->config;
    const int64_t now = wrap(drive, turned(drive, drive->demand.units, POLARITY_POSITION));
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
static int32_t follow_position(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const sj_drive_config *config = &drive->config;
    const double speed = 1.0 / per_period(drive);
    const double before = drive->demand_velocity;
    int64_t target = wrap(drive, (int64_t)rx->target_position + rx->position_offset);
    int64_t step = 0;
    int64_t advance = 0;

    if (rx->sync_missed) {
        /* never back to the last target: on at the last velocity, and then a stop */
        if ((uint32_t)drive->missed_in_row > config->sync_extrapolation) {
            stop(drive, command, 2);
        } else {
            ramp(drive, command, before, before);
        }
        sj_verdict_pause(&drive->verdict);
        drive->follows = 0;
        return SJ_FAULT_NONE;
    }
    target = software_limited(drive, target);
    step = difference(drive, wrap(drive, turned(drive, target, POLARITY_POSITION)),
                      drive->demand.units);
    const uint32_t inputs = sj_drive_digital_inputs(drive);
    if ((inputs & 1u && step < 0) || (inputs & 2u && step > 0)) {
        /* a limit switch: stop, and follow again only away from it */
        drive->limited = 1;
        stop(drive, command, config->quick_stop_option > 4 ? config->quick_stop_option - 4
                                                           : config->quick_stop_option);
        drive->follows = 0;
        return SJ_FAULT_NONE;
    }
    if (drive->limited) {
        sj_verdict_pause(&drive->verdict);
    } else {
        sj_verdict_judge(drive, step);
        drive->warning |= drive->verdict.last_finding >= 0;
    }
    drive->follows = !drive->limited;
    if (step > drive->jump_limit || step < -drive->jump_limit) {
        if (config->jump_option == SJ_JUMP_FAULT) {
            return SJ_FAULT_REFERENCE_LIMIT;
        }
        if (config->jump_option == SJ_JUMP_CLAMP) {
            step = step > 0 ? drive->jump_limit : -drive->jump_limit;
            drive->limited = 1;
            drive->follows = 0;
        }
    }
    command->control = SJ_SERVO_POSITION;
    command->demand = drive->demand.increments;
    command->fraction = drive->demand_fraction;
    advance = move_units(drive, &drive->demand, step);
    command->advance = (double)advance - drive->demand_fraction;
    drive->demand_fraction = 0.0;
    drive->demand_velocity = bounded(drive, command->advance);
    command->velocity_start_rad_s = drive->demand_velocity * speed;
    command->velocity_end_rad_s = command->velocity_start_rad_s;
    command->torque_nm += config->acceleration_feedforward * drive->constants.inertia_kg_m2 *
                          (drive->demand_velocity - before) * speed / config->period_s;
    return SJ_FAULT_NONE;
}

/* CSV: the velocity command goes to its target over the period; the demand is where the axis is. */
static void follow_velocity(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const double to_period = (double)drive->ratio_increments / (double)drive->ratio_units *
                             drive->config.period_s;
    const double most = (double)drive->jump_limit / drive->config.jump_factor *
                        ((double)drive->ratio_increments / (double)drive->ratio_units);
    const double speed = 1.0 / per_period(drive);
    double goal = drive->demand_velocity;

    if (!rx->sync_missed) {
        goal = (double)turned(drive, (int64_t)rx->target_velocity + rx->velocity_offset,
                              POLARITY_VELOCITY) * to_period;
    }
    drive->follows = !rx->sync_missed;
    if (goal > most || goal < -most) {
        goal = goal > 0.0 ? most : -most;
        drive->limited = 1;
        drive->follows = 0;
    }
    const uint32_t inputs = sj_drive_digital_inputs(drive);
    if ((inputs & 1u && goal < 0.0) || (inputs & 2u && goal > 0.0) ||
        (uint32_t)drive->missed_in_row > drive->config.sync_extrapolation) {
        drive->limited |= (inputs & 3u) != 0;
        drive->follows = 0;
        sj_drive_ramp_to(drive, command, 0.0, deceleration(drive, 2, 0.0));
        return;
    }
    command->control = SJ_SERVO_VELOCITY;
    command->velocity_start_rad_s = drive->demand_velocity * speed;
    command->velocity_end_rad_s = goal * speed;
    command->velocity_offset_rad_s = 0.0;
    command->torque_nm += drive->config.acceleration_feedforward * drive->constants.inertia_kg_m2 *
                          (goal - drive->demand_velocity) * speed / drive->config.period_s;
    drive->demand = drive->actual;
    drive->demand_fraction = 0.0;
    drive->demand_velocity = goal;
}

/* CST: the torque command of the period; 60B2h is already in command->torque_nm. */
static void follow_torque(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const uint32_t inputs = sj_drive_digital_inputs(drive);
    double torque = drive->torque_demand_nm;

    if (!rx->sync_missed) {
        torque = command->torque_nm + (double)turned(drive, rx->target_torque, POLARITY_TORQUE) *
                                          1e-3 * drive->config.rated_torque_nm;
    }
    drive->demand = drive->actual;
    drive->demand_fraction = 0.0;
    drive->demand_velocity = bounded(drive, drive->servo.measured_rad_s * per_period(drive));
    drive->follows = !rx->sync_missed;
    if ((inputs & 1u && torque < 0.0) || (inputs & 2u && torque > 0.0) ||
        (uint32_t)drive->missed_in_row > drive->config.sync_extrapolation) {
        drive->limited |= (inputs & 3u) != 0;
        drive->follows = 0;
        sj_drive_ramp_to(drive, command, 0.0, deceleration(drive, 2, 0.0));
        return;
    }
    command->control = SJ_SERVO_TORQUE;
    command->speed_max_rad_s /= SPEED_CLAMP;
    command->torque_nm = torque;
    drive->torque_demand_nm = torque;
}

/* ---- profiles: set-points become requests, plans become demands ---- */

enum { POSITION_GOAL = 1, VELOCITY_GOAL = 2 };

static void drop_plan(sj_drive *drive)
{
    drive->plan_phase = -1;
    drive->demand_acceleration = 0.0;
    drive->request.kind = SJ_REQUEST_NONE;
}

/* What is wanted from where the demand will be at the end of this period. */
static void ask(sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const double increments = (double)drive->ratio_increments / (double)drive->ratio_units;
    const double period = config->period_s;
    const double most = (double)drive->jump_limit / config->jump_factor * increments;
    const double wanted = config->profile_velocity * increments * period;
    const double scale = increments * period * period;
    const uint32_t up = config->profile_acceleration < config->max_acceleration
                            ? config->profile_acceleration
                            : config->max_acceleration;
    const double jerk = config->profile_jerk_rev_s3 * config->encoder_increments /
                        config->encoder_revolutions * period * period * period;
    sj_drive_request *request = &drive->request;

    request->velocity = drive->demand_velocity;
    request->acceleration = drive->demand_acceleration;
    request->limits = (sj_limits){
        .velocity = drive->goal_set == POSITION_GOAL && wanted < most ? wanted : most,
        .acceleration = up * scale,
        .jerk = jerk,
        .deceleration = config->profile_deceleration * scale,
        .deceleration_jerk = jerk,
    };
    if (drive->goal_set == POSITION_GOAL) {
        const int64_t way = difference(drive, drive->goal_units, drive->demand.units);
        request->kind = SJ_REQUEST_MOVE;
        request->distance = (double)way * increments - drive->demand_fraction;
    } else {
        const double goal = drive->goal_velocity;
        request->kind = SJ_REQUEST_VELOCITY;
        request->goal = goal > most ? most : goal < -most ? -most : goal;
    }
}

void sj_drive_answer(sj_drive *drive, const sj_plan *plan)
{
    drive->request.kind = SJ_REQUEST_NONE;
    if (plan == NULL) {
        drive->goal_set = 0; /* an impossible profile: the axis slows down where it is */
        drive->plan_phase = -1;
        drive->warning = 1;
        return;
    }
    drive->plan = *plan;
    drive->plan_phase = 0;
    drive->plan_left = plan->count > 0 ? plan->phase[0].cycles : 0;
}

/* One period of the plan; at its end a move lands on its goal to the unit. */
static void execute(sj_drive *drive, sj_servo_command *command)
{
    const sj_plan *plan = &drive->plan;
    double velocity = drive->demand_velocity;
    double acceleration = drive->demand_acceleration;
    double jerk = 0.0;
    double advance = 0.0;

    while (drive->plan_phase < plan->count && drive->plan_left == 0) {
        drive->plan_phase++;
        drive->plan_left =
            drive->plan_phase < plan->count ? plan->phase[drive->plan_phase].cycles : 0;
    }
    if (drive->plan_phase >= plan->count) {
        const int64_t way = difference(drive, drive->goal_units, drive->demand.units);
        drop_plan(drive);
        if (drive->goal_set == POSITION_GOAL) {
            /* what rounding of the sums has left, a fraction of a unit */
            advance = (double)way * (double)drive->ratio_increments / (double)drive->ratio_units -
                      drive->demand_fraction;
            ramp(drive, command, advance, 0.0);
            (void)move_units(drive, &drive->demand,
                             difference(drive, drive->goal_units, drive->demand.units));
            drive->demand_fraction = 0.0;
        } else {
            ramp(drive, command, drive->goal_velocity, drive->goal_velocity);
        }
        return;
    }
    jerk = plan->phase[drive->plan_phase].jerk;
    drive->plan_left--;
    advance = velocity + 0.5 * acceleration + jerk / 6.0;
    velocity += acceleration + 0.5 * jerk;
    drive->demand_acceleration = acceleration + jerk;
    ramp(drive, command, advance, velocity);
}

/* A limit switch in the way of the demand. */
static int blocked(sj_drive *drive)
{
    const uint32_t inputs = sj_drive_digital_inputs(drive);
    const int in_the_way = (inputs & 1u && drive->demand_velocity < 0.0) ||
                           (inputs & 2u && drive->demand_velocity > 0.0);
    drive->limited |= in_the_way;
    return in_the_way;
}

static int64_t set_point_units(sj_drive *drive, const sj_drive_rx *rx)
{
    const int64_t base =
        drive->goal_set == POSITION_GOAL ? drive->goal_units : drive->demand.units;
    int64_t target = (int64_t)rx->target_position;

    if (drive->controlword & SJ_CW_MODE_6) { /* relative to the set-point before */
        target += turned(drive, base, POLARITY_POSITION);
    }
    target = software_limited(drive, wrap(drive, target));
    return wrap(drive, turned(drive, target, POLARITY_POSITION));
}

/* Mode 1: bit 4 offers a set-point, bit 12 takes it; bit 5 at once or after the one at hand. */
static void profile_position(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const uint16_t word = drive->controlword;
    const int offered = (word & ~drive->controlword_before & SJ_CW_MODE_4) != 0;
    const int busy = drive->plan_phase >= 0 || drive->request.kind != SJ_REQUEST_NONE;
    int fresh = 0;

    if (!(word & SJ_CW_MODE_4)) {
        drive->acknowledged = drive->goal_waits; /* room for another set-point, or not */
    } else if (offered && !drive->goal_waits) {
        drive->acknowledged = 1;
        if (busy && !(word & SJ_CW_MODE_5)) {
            drive->waiting_units = set_point_units(drive, rx);
            drive->goal_waits = 1;
        } else {
            drive->goal_units = set_point_units(drive, rx);
            drive->goal_set = POSITION_GOAL;
            fresh = 1;
        }
    }
    if (blocked(drive)) {
        drop_plan(drive);
        drive->goal_set = 0;
        drive->goal_waits = 0;
        stop(drive, command, 2);
        return;
    }
    if (drive->plan_phase >= 0) {
        execute(drive, command);
    } else {
        stop(drive, command, 1);
    }
    if (drive->plan_phase < 0 && drive->goal_waits && drive->demand_velocity == 0.0) {
        drive->goal_units = drive->waiting_units;
        drive->goal_set = POSITION_GOAL;
        drive->goal_waits = 0;
        fresh = 1;
    }
    if (fresh) {
        ask(drive);
    }
}

/* Mode 3: 60FFh is the velocity to go to; a new value is planned from where the old plan is. */
static void profile_velocity(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const double goal =
        (double)turned(drive, (int64_t)rx->target_velocity + rx->velocity_offset,
                       POLARITY_VELOCITY) *
        drive->config.period_s * (double)drive->ratio_increments / (double)drive->ratio_units;
    const double bound = (double)drive->jump_limit / drive->config.jump_factor *
                         ((double)drive->ratio_increments / (double)drive->ratio_units);
    const double held = goal > bound ? bound : goal < -bound ? -bound : goal;
    const int fresh = drive->goal_set != VELOCITY_GOAL || held != drive->goal_velocity;

    command->velocity_offset_rad_s = 0.0;
    drive->limited |= held != goal;
    if (blocked(drive)) {
        drop_plan(drive);
        drive->goal_set = 0;
        stop(drive, command, 2);
        return;
    }
    drive->goal_velocity = held;
    drive->goal_set = VELOCITY_GOAL;
    if (drive->plan_phase >= 0) {
        execute(drive, command);
    } else {
        ramp(drive, command, drive->demand_velocity, drive->demand_velocity);
    }
    if (fresh) {
        ask(drive);
    }
}

static uint16_t profile_bits(sj_drive *drive)
{
    const int done = drive->plan_phase < 0 && drive->request.kind == SJ_REQUEST_NONE &&
                     !drive->goal_waits;
    const int64_t error = difference(drive, drive->goal_units, drive->actual.units);
    const int64_t window = drive->config.position_window;
    uint16_t word = drive->following_error ? SJ_SW_FOLLOWING_ERROR : 0;

    if (drive->mode == SJ_MODE_PROFILE_VELOCITY) {
        const double goal = drive->goal_velocity / per_period(drive);
        const double off = goal - drive->servo.measured_rad_s;
        const double near = STANDSTILL * drive->config.max_speed_rpm * RPM;
        word |= drive->goal_set == VELOCITY_GOAL && done && off < near && off > -near
                    ? SJ_SW_TARGET_REACHED : 0;
        word |= drive->standing ? SJ_SW_FOLLOWS : 0; /* bit 12: speed is 0 */
        return word;
    }
    word |= drive->acknowledged ? SJ_SW_FOLLOWS : 0;
    if (drive->goal_set == POSITION_GOAL && done && error <= window && error >= -window) {
        word |= SJ_SW_TARGET_REACHED;
    }
    return word;
}

/* ---- one period ---- */

static int mode_supported(int32_t mode)
{
    return mode == SJ_MODE_NONE || mode == SJ_MODE_PROFILE_POSITION ||
           mode == SJ_MODE_PROFILE_VELOCITY || mode == SJ_MODE_HOMING || mode == SJ_MODE_CSP || mode == SJ_MODE_CSV ||
           mode == SJ_MODE_CST;
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
    drive->error_code = FAULTS[fault].code;
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
    const double most = OVER_SPEED * drive->config.max_speed_rpm * RPM;
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
    const int64_t error = difference(drive, drive->demand.units, drive->actual.units);
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
    const int coasts = FAULTS[drive->fault].reaction == COAST || drive->config.fault_option == 0;
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
                              (before == SJ_STATE_FAULT_REACTION && coasts)),
    };
    uint32_t ran = 0;

    drive->state = sj_drive_next(before, &input, &ran);
    drive->transitions |= ran;
    drive->controlword_before = drive->controlword;
    drive->controlword = word;
    if (drive->state == SJ_STATE_OPERATION_ENABLED && before != drive->state) {
        adopt_actual(drive); /* T4, T16 */
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
    drop_plan(drive);
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
            stop(drive, command, 1); /* the ramp of 605Bh or 605Ch before the state changes */
            drive->resync = 1;
        } else if (word & SJ_CW_HALT) {
            stop(drive, command, config->halt_option);
            drive->resync = 1;
        } else if (drive->mode == SJ_MODE_NONE) {
            stop(drive, command, 1);
            drive->resync = 1;
        } else if (drive->resync && drive->mode == SJ_MODE_CSP) {
            /* the master sees where the axis is before its targets count */
            adopt_actual(drive);
            stop(drive, command, 1);
            drive->resync = 0;
        } else if (drive->mode == SJ_MODE_PROFILE_POSITION) {
            profile_position(drive, rx, command);
        } else if (drive->mode == SJ_MODE_PROFILE_VELOCITY) {
            profile_velocity(drive, rx, command);
        } else if (drive->mode == SJ_MODE_HOMING) {
            sj_homing_period(drive, command);
        } else if (drive->mode == SJ_MODE_CSP) {
            fault = follow_position(drive, rx, command);
        } else {
            if (drive->resync) {
                adopt_actual(drive);
                drive->resync = 0;
            }
            if (drive->mode == SJ_MODE_CSV) {
                follow_velocity(drive, rx, command);
            } else {
                follow_torque(drive, rx, command);
            }
        }
        if (fault == SJ_FAULT_NONE) {
            return;
        }
        raise(drive, fault);
        stop(drive, command, config->fault_option == 0 ? 2 : config->fault_option);
        return;

    case SJ_STATE_QUICK_STOP:
        if (config->quick_stop_option == 0) {
            power_off(drive, command);
        } else {
            stop(drive, command, config->quick_stop_option > 4 ? config->quick_stop_option - 4
                                                               : config->quick_stop_option);
        }
        return;

    case SJ_STATE_FAULT_REACTION:
        if (FAULTS[drive->fault].reaction == COAST || config->fault_option == 0) {
            power_off(drive, command);
        } else {
            stop(drive, command, config->fault_option);
        }
        return;

    default:
        power_off(drive, command);
    }
}

/* Whether a stop has ended: no demand velocity, and the motor stands or had its time. */
static void judge_standing(sj_drive *drive)
{
    const double speed = drive->servo.measured_rad_s;
    const double still = STANDSTILL * drive->config.max_speed_rpm * RPM;

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
    const int64_t error = difference(drive, drive->demand.units, drive->actual.units);

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
    return (int32_t)wrap(drive, turned(drive, units, POLARITY_POSITION));
}

static void tell(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    const sj_drive_config *config = &drive->config;
    const sj_servo *servo = &drive->servo;
    const double to_units = (double)drive->ratio_units / (double)drive->ratio_increments;
    const double per_mille = 1000.0 / config->rated_torque_nm;
    const double velocity_sign = config->polarity & POLARITY_VELOCITY ? -1.0 : 1.0;
    const double torque_sign = config->polarity & POLARITY_TORQUE ? -1.0 : 1.0;
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
        word |= profile_bits(drive);
    } else {
        word |= target_reached(drive) ? SJ_SW_TARGET_REACHED : 0;
        word |= following ? SJ_SW_FOLLOWS : 0;
        word |= drive->following_error ? SJ_SW_FOLLOWING_ERROR : 0;
    }

    tx->statusword = word;
    tx->mode_display = (int8_t)drive->mode;
    tx->error_register = FAULTS[drive->fault].error_register;
    tx->error_code = drive->error_code;
    tx->position_actual = position_word(drive, drive->actual.units);
    tx->position_demand = position_word(drive, drive->demand.units);
    tx->following_error = (int32_t)turned(
        drive, difference(drive, drive->demand.units, drive->actual.units), POLARITY_POSITION);
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
            (double)turned(drive, rx->velocity_offset, POLARITY_VELOCITY) * to_speed,
        .torque_nm = (double)turned(drive, rx->torque_offset, POLARITY_TORQUE) * unit,
        .torque_max_nm = high < most ? high : most,
        .torque_min_nm = low < most ? -low : -most,
        .speed_max_rad_s = SPEED_CLAMP * config->max_speed_rpm * RPM,
    };
}

void sj_drive_cycle(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    sj_servo_command command = bounds(drive, rx);
    const int32_t fault = supervise_inputs(drive, rx);
    int64_t before = drive->servo.encoder;

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
        drop_plan(drive);
    } else if (drive->controlword & SJ_CW_HALT &&
               (drive->plan_phase >= 0 || drive->goal_set == VELOCITY_GOAL)) {
        drop_plan(drive); /* released, the axis waits for a new set-point; a velocity comes back */
        drive->goal_set = 0;
        drive->goal_waits = 0;
    }
    move(drive, rx, &command);
    sj_servo_period(&drive->servo, &drive->constants, &command);
    move_increments(drive, &drive->actual, subtract_wrapping(drive->servo.encoder, before));
    if (command.control == SJ_SERVO_OFF) {
        adopt_actual(drive);
    }
    judge_standing(drive);
    supervise_following(drive, &command);
    tell(drive, rx, tx);
}

void sj_drive_cycle_many(sj_drive *drives, const sj_drive_rx *rx, sj_drive_tx *tx, int32_t count)
{
    for (int32_t i = 0; i < count; i++) {
        sj_drive_cycle(&drives[i], &rx[i], &tx[i]);
    }
}
