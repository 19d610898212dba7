/* Profile position and profile velocity (modes 1 and 3): the drive asks, the planner answers.
 *
 * A set-point becomes a request; sj_drive_cycle_planned() has it planned at the end of its period,
 * from the demand's own velocity and acceleration, and the next period begins to execute the plan.
 * That function is the only place that knows both the drive and the planner (_profile.c).
 * Never here: how a plan is found.
 */
#include <stddef.h> /* required by the contract */
#include <stdint.h> /* the contract's integer types */
#include "planner/_planner.h"
#include "_internal.h" /* what the rooms of the drive share */

void sj_profile_drop(sj_drive *drive)
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
    const uint32_t down = config->profile_deceleration < config->max_deceleration
                              ? config->profile_deceleration
                              : config->max_deceleration;
    const double jerk = config->profile_jerk_rev_s3 * config->encoder_increments /
                        config->encoder_revolutions * period * period * period;
    sj_drive_request *request = &drive->request;

    request->velocity = drive->demand_velocity;
    request->acceleration = drive->demand_acceleration;
    request->limits = (sj_limits){
        .velocity = drive->goal_set == SJ_POSITION_GOAL && wanted < most ? wanted : most,
        .acceleration = up * scale,
        .jerk = jerk,
        .deceleration = down * scale,
        .deceleration_jerk = jerk,
    };
    if (drive->goal_set == SJ_POSITION_GOAL) {
        const int64_t way = sj_point_difference(drive, drive->goal_units, drive->demand.units);
        request->kind = SJ_REQUEST_MOVE;
        request->distance = (double)way * increments - drive->demand_fraction;
    } else {
        const double goal = drive->goal_velocity;
        request->kind = SJ_REQUEST_VELOCITY;
        request->goal = goal > most ? most : goal < -most ? -most : goal;
    }
}

static void answer(sj_drive *drive, const sj_plan *plan)
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
        const int64_t way = sj_point_difference(drive, drive->goal_units, drive->demand.units);
        sj_profile_drop(drive);
        if (drive->goal_set == SJ_POSITION_GOAL) {
            /* what rounding of the sums has left, a fraction of a unit */
            advance = (double)way * (double)drive->ratio_increments / (double)drive->ratio_units -
                      drive->demand_fraction;
            sj_motion_ramp(drive, command, advance, 0.0);
            (void)sj_point_move_units(drive, &drive->demand,
                             sj_point_difference(drive, drive->goal_units, drive->demand.units));
            drive->demand_fraction = 0.0;
        } else {
            sj_motion_ramp(drive, command, drive->goal_velocity, drive->goal_velocity);
        }
        return;
    }
    jerk = plan->phase[drive->plan_phase].jerk;
    drive->plan_left--;
    advance = velocity + 0.5 * acceleration + jerk / 6.0;
    velocity += acceleration + 0.5 * jerk;
    drive->demand_acceleration = acceleration + jerk;
    sj_motion_ramp(drive, command, advance, velocity);
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
    const int64_t before =
        drive->goal_set == SJ_POSITION_GOAL ? drive->goal_units : drive->demand.units;
    const int64_t bases[] = {before, drive->demand.units, drive->actual.units}; /* 60F2h */
    const int64_t base = bases[drive->config.positioning_option];
    int64_t target = (int64_t)rx->target_position;

    if (drive->controlword & SJ_CW_MODE_6) {
        target += turned(drive, base, SJ_POLARITY_POSITION);
    }
    target = sj_motion_software_limited(drive, sj_point_wrap(drive, target));
    return sj_point_wrap(drive, turned(drive, target, SJ_POLARITY_POSITION));
}

/* Mode 1: bit 4 offers a set-point, bit 12 takes it; bit 5 at once or after the one at hand. */
void sj_profile_position(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
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
            drive->goal_set = SJ_POSITION_GOAL;
            fresh = 1;
        }
    }
    if (blocked(drive)) {
        sj_profile_drop(drive);
        drive->goal_set = 0;
        drive->goal_waits = 0;
        sj_motion_stop(drive, command, 2);
        return;
    }
    if (drive->plan_phase >= 0) {
        execute(drive, command);
    } else {
        sj_motion_stop(drive, command, 1);
    }
    if (drive->plan_phase < 0 && drive->goal_waits && drive->demand_velocity == 0.0) {
        drive->goal_units = drive->waiting_units;
        drive->goal_set = SJ_POSITION_GOAL;
        drive->goal_waits = 0;
        fresh = 1;
    }
    if (fresh) {
        ask(drive);
    }
}

/* Mode 3: 60FFh is the velocity to go to; a new value is planned from where the old plan is. */
void sj_profile_velocity(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const double goal =
        (double)turned(drive, (int64_t)rx->target_velocity + rx->velocity_offset,
                       SJ_POLARITY_VELOCITY) *
        drive->config.period_s * (double)drive->ratio_increments / (double)drive->ratio_units;
    const double bound = (double)drive->jump_limit / drive->config.jump_factor *
                         ((double)drive->ratio_increments / (double)drive->ratio_units);
    const double held = goal > bound ? bound : goal < -bound ? -bound : goal;
    const int fresh = drive->goal_set != SJ_VELOCITY_GOAL || held != drive->goal_velocity;

    command->velocity_offset_rad_s = 0.0;
    drive->limited |= held != goal;
    if (blocked(drive)) {
        sj_profile_drop(drive);
        drive->goal_set = 0;
        sj_motion_stop(drive, command, 2);
        return;
    }
    drive->goal_velocity = held;
    drive->goal_set = SJ_VELOCITY_GOAL;
    if (drive->plan_phase >= 0) {
        execute(drive, command);
    } else {
        sj_motion_ramp(drive, command, drive->demand_velocity, drive->demand_velocity);
    }
    if (fresh) {
        ask(drive);
    }
}

/* Bit 10: within 606Dh of the target for 606Eh; bit 12: not above 606Fh for longer than 6070h. */
static uint16_t velocity_bits(sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const double units = (double)drive->ratio_units / (double)drive->ratio_increments;
    const double actual = drive->servo.measured_rad_s * drive->constants.increments_per_rad * units;
    const double off = actual - drive->goal_velocity / config->period_s * units;
    const double window = config->velocity_window;
    const double threshold = config->velocity_threshold;
    const double period_ms = config->period_s * 1e3;

    if (drive->goal_set == SJ_VELOCITY_GOAL && off <= window && off >= -window) {
        drive->velocity_cycles += drive->velocity_cycles < UINT32_MAX;
    } else {
        drive->velocity_cycles = 0;
    }
    if (actual > threshold || actual < -threshold) {
        drive->moving_cycles += drive->moving_cycles < UINT32_MAX;
    } else {
        drive->moving_cycles = 0;
    }
    return (uint16_t)((drive->velocity_cycles > 0 &&
                               drive->velocity_cycles * period_ms >= config->velocity_time_ms
                           ? SJ_SW_TARGET_REACHED
                           : 0) |
                      (drive->moving_cycles == 0 ||
                               drive->moving_cycles * period_ms <= config->threshold_time_ms
                           ? SJ_SW_FOLLOWS
                           : 0));
}

uint16_t sj_profile_bits(sj_drive *drive)
{
    const int done = drive->plan_phase < 0 && drive->request.kind == SJ_REQUEST_NONE &&
                     !drive->goal_waits;
    const int64_t error = sj_point_difference(drive, drive->goal_units, drive->actual.units);
    const int64_t window = drive->config.position_window;
    uint16_t word = drive->following_error ? SJ_SW_FOLLOWING_ERROR : 0;

    if (drive->mode == SJ_MODE_PROFILE_VELOCITY) {
        word |= velocity_bits(drive);
        return word;
    }
    word |= drive->acknowledged ? SJ_SW_FOLLOWS : 0;
    if (drive->goal_set == SJ_POSITION_GOAL && done && error <= window && error >= -window) {
        word |= SJ_SW_TARGET_REACHED;
    }
    return word;
}

void sj_drive_cycle_planned(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    const sj_drive_request *request = &drive->request;
    sj_plan plan;
    int32_t status = SJ_PLAN_OK;

    sj_drive_cycle(drive, rx, tx);
    switch (request->kind) {
    case SJ_REQUEST_MOVE:
        status = sj_plan_move(request->distance, request->velocity, request->acceleration, 0.0,
                              &request->limits, &plan);
        break;
    case SJ_REQUEST_VELOCITY:
        status = sj_plan_velocity(request->velocity, request->acceleration, request->goal,
                                  &request->limits, &plan);
        break;
    default:
        return;
    }
    answer(drive, status == SJ_PLAN_OK ? &plan : NULL);
}
