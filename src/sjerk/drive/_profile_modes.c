/* Profile position and profile velocity (modes 1 and 3): the drive asks, the planner answers.
 *
 * A set-point becomes a request; sj_drive_cycle_planned() (_drive.c) has it planned at the end of its
 * period, from the demand's own velocity and acceleration, and the next period begins to execute the
 * plan. One period of jerk j, Eqs. (2), (3), (5):
 *     P += V + A / 2 + j / 6,   V += A + j / 2,   A += j.
 * Never here: how a plan is found.
 */
#include <stddef.h> /* NULL */
#include <stdint.h> /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

void sj_profile_drop(sj_drive *drive)
{
    drive->goal.plan_phase = -1;
    drive->demand.acceleration = 0.0;
    drive->goal.request.kind = SJ_REQUEST_NONE;
}

void sj_profile_give_up(sj_drive *drive)
{
    sj_profile_drop(drive);
    drive->goal.kind = 0;
    drive->goal.waits = 0;
}

/* From the demand to the set-point, pu. */
static int64_t to_goal(const sj_drive *drive)
{
    return sj_point_difference(drive, drive->goal.units, drive->demand.point.units);
}

/* What is wanted from where the demand will be at the end of this period. */
static void request_plan(sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const double increments = increments_per_unit(drive);
    const double period = config->period_s;
    const double most = speed_limit(drive);
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
    sj_drive_request *request = &drive->goal.request;

    request->velocity = drive->demand.velocity;
    request->acceleration = drive->demand.acceleration;
    request->limits = (sj_limits){
        .velocity = drive->goal.kind == SJ_POSITION_GOAL && wanted < most ? wanted : most,
        .acceleration = up * scale,
        .jerk = jerk,
        .deceleration = down * scale,
        .deceleration_jerk = jerk,
    };
    if (drive->goal.kind == SJ_POSITION_GOAL) {
        const int64_t distance = to_goal(drive);
        request->kind = SJ_REQUEST_MOVE;
        request->distance = (double)distance * increments - drive->demand.fraction;
    } else {
        request->kind = SJ_REQUEST_VELOCITY;
        request->goal = bounded(drive->goal.velocity, most);
    }
}

/* The plan that was asked for; NULL: there is none. */
void sj_profile_answer(sj_drive *drive, const sj_plan *plan)
{
    drive->goal.request.kind = SJ_REQUEST_NONE;
    if (plan == NULL) {
        drive->goal.kind = 0; /* an impossible profile: the axis slows down where it is */
        drive->goal.plan_phase = -1;
        drive->warning = 1;
        return;
    }
    drive->goal.plan = *plan;
    drive->goal.plan_phase = 0;
    drive->goal.plan_left = plan->count > 0 ? plan->phase[0].cycles : 0;
}

/* One period of the plan; at its end a move lands on its goal to the unit. */
static void execute_plan(sj_drive *drive, sj_servo_command *command)
{
    const sj_plan *plan = &drive->goal.plan;
    double velocity = drive->demand.velocity;
    double acceleration = drive->demand.acceleration;
    double jerk = 0.0;
    double advance = 0.0;

    while (drive->goal.plan_phase < plan->count && drive->goal.plan_left == 0) {
        drive->goal.plan_phase++;
        drive->goal.plan_left =
            drive->goal.plan_phase < plan->count ? plan->phase[drive->goal.plan_phase].cycles : 0;
    }
    if (drive->goal.plan_phase >= plan->count) {
        const int64_t distance = to_goal(drive);
        sj_profile_drop(drive);
        if (drive->goal.kind == SJ_POSITION_GOAL) {
            /* what rounding of the sums has left, a fraction of a unit */
            advance = (double)distance * (double)drive->scale.increments /
                          (double)drive->scale.units -
                      drive->demand.fraction;
            sj_motion_ramp(drive, command, advance, 0.0);
            (void)sj_point_move_units(drive, &drive->demand.point, to_goal(drive));
            drive->demand.fraction = 0.0;
        } else {
            sj_motion_ramp(drive, command, drive->goal.velocity, drive->goal.velocity);
        }
        return;
    }
    jerk = plan->phase[drive->goal.plan_phase].jerk;
    drive->goal.plan_left--;
    advance = velocity + 0.5 * acceleration + jerk / 6.0;
    velocity += acceleration + 0.5 * jerk;
    drive->demand.acceleration = acceleration + jerk;
    sj_motion_ramp(drive, command, advance, velocity);
}

/* A limit switch where the demand goes. */
static int blocked(sj_drive *drive)
{
    const int in_the_way = sj_motion_blocked(drive, drive->demand.velocity);
    drive->limited |= in_the_way;
    return in_the_way;
}

static int64_t set_point_units(sj_drive *drive, const sj_drive_rx *rx)
{
    const int64_t before =
        drive->goal.kind == SJ_POSITION_GOAL ? drive->goal.units : drive->demand.point.units;
    const int64_t bases[] = {before, drive->demand.point.units, drive->actual.units}; /* 60F2h */
    const int64_t base = bases[drive->config.positioning_option];
    int64_t target = (int64_t)rx->target_position;

    if (drive->controlword & SJ_CW_MODE_6) {
        target += with_polarity(drive, base, SJ_POLARITY_POSITION);
    }
    target = sj_motion_software_limited(drive, sj_point_wrap(drive, target));
    return sj_point_wrap(drive, with_polarity(drive, target, SJ_POLARITY_POSITION));
}

/* Mode 1: bit 4 offers a set-point, bit 12 takes it; bit 5 at once or after the one at hand. */
void sj_profile_position(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const uint16_t word = drive->controlword;
    const int offered = (word & ~drive->controlword_before & SJ_CW_MODE_4) != 0;
    const int busy = drive->goal.plan_phase >= 0 || drive->goal.request.kind != SJ_REQUEST_NONE;
    int fresh = 0;

    if (!(word & SJ_CW_MODE_4)) {
        drive->goal.acknowledged = drive->goal.waits; /* room for another set-point, or not */
    } else if (offered && !drive->goal.waits) {
        drive->goal.acknowledged = 1;
        if (busy && !(word & SJ_CW_MODE_5)) {
            drive->goal.waiting_units = set_point_units(drive, rx);
            drive->goal.waits = 1;
        } else {
            drive->goal.units = set_point_units(drive, rx);
            drive->goal.kind = SJ_POSITION_GOAL;
            fresh = 1;
        }
    }
    if (blocked(drive)) {
        sj_profile_give_up(drive);
        sj_motion_stop(drive, command, 2);
        return;
    }
    if (drive->goal.plan_phase >= 0) {
        execute_plan(drive, command);
    } else {
        sj_motion_stop(drive, command, 1);
    }
    if (drive->goal.plan_phase < 0 && drive->goal.waits && drive->demand.velocity == 0.0) {
        drive->goal.units = drive->goal.waiting_units;
        drive->goal.kind = SJ_POSITION_GOAL;
        drive->goal.waits = 0;
        fresh = 1;
    }
    if (fresh) {
        request_plan(drive);
    }
}

/* Mode 3: 60FFh is the velocity to go to; a new value is planned from where the old plan is. */
void sj_profile_velocity(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const double goal =
        (double)with_polarity(drive, (int64_t)rx->target_velocity + rx->velocity_offset,
                       SJ_POLARITY_VELOCITY) *
        drive->config.period_s * (double)drive->scale.increments / (double)drive->scale.units;
    const double held = bounded(goal, speed_limit(drive));
    const int fresh = drive->goal.kind != SJ_VELOCITY_GOAL || held != drive->goal.velocity;

    command->velocity_offset_rad_s = 0.0;
    drive->limited |= held != goal;
    if (blocked(drive)) {
        sj_profile_give_up(drive);
        sj_motion_stop(drive, command, 2);
        return;
    }
    drive->goal.velocity = held;
    drive->goal.kind = SJ_VELOCITY_GOAL;
    if (drive->goal.plan_phase >= 0) {
        execute_plan(drive, command);
    } else {
        sj_motion_ramp(drive, command, drive->demand.velocity, drive->demand.velocity);
    }
    if (fresh) {
        request_plan(drive);
    }
}

/* Bit 10: within 606Dh of the target for 606Eh; bit 12: not above 606Fh for longer than 6070h. */
static uint16_t velocity_bits(sj_drive *drive)
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

uint16_t sj_profile_bits(sj_drive *drive)
{
    const int done = drive->goal.plan_phase < 0 && drive->goal.request.kind == SJ_REQUEST_NONE &&
                     !drive->goal.waits;
    const int64_t error = sj_point_difference(drive, drive->goal.units, drive->actual.units);
    const int64_t window = drive->config.position_window;
    uint16_t word = drive->following_error ? SJ_SW_FOLLOWING_ERROR : 0;

    if (drive->mode == SJ_MODE_PROFILE_VELOCITY) {
        word |= velocity_bits(drive);
        return word;
    }
    word |= drive->goal.acknowledged ? SJ_SW_FOLLOWS : 0;
    if (drive->goal.kind == SJ_POSITION_GOAL && done && error <= window && error >= -window) {
        word |= SJ_SW_TARGET_REACHED;
    }
    return word;
}
