/* What the profile modes share: the drive asks, the planner answers, the drive executes.
 *
 * A set-point becomes a request; sj_drive_cycle_planned() (_drive.c) has it planned at the end of its
 * period, from the demand's own velocity and acceleration, and the next period begins to execute the
 * plan. One period of jerk j, Eqs. (2), (3), (5):
 *     P += V + A / 2 + j / 6,   V += A + j / 2,   A += j.
 * Never here: which set-point, how a plan is found.
 */
#include <math.h>            /* sqrt, fabs: in requests only */
#include <stddef.h>          /* NULL */
#include <stdint.h>          /* fixed widths */
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
    drive->goal.passes = 0;
    drive->goal.fresh = 0;
}

int sj_profile_planned(const sj_drive *drive)
{
    return drive->goal.plan_phase >= 0 || drive->goal.request.kind != SJ_REQUEST_NONE;
}

int64_t sj_profile_left(const sj_drive *drive)
{
    return subtract_wrapping(drive->goal.now.travel, drive->demand.point.travel);
}

/* The same in increments: to the middle of the unit, from where in its own unit the demand is. */
static double increments_left(const sj_drive *drive)
{
    const double inside = (double)(drive->demand.point.remainder - drive->scale.increments / 2);

    return ((double)sj_profile_left(drive) * (double)drive->scale.increments - inside) /
               (double)drive->scale.units -
           drive->demand.fraction;
}

static sj_limits limits_of(const sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const double increments = increments_per_unit(drive);
    const double period = config->period_s;
    const double most = drive->scale.speed_limit;
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

    return (sj_limits){
        .velocity = drive->goal.kind == SJ_POSITION_GOAL && wanted < most ? wanted : most,
        .acceleration = up * scale,
        .jerk = jerk,
        .deceleration = down * scale,
        .deceleration_jerk = jerk,
    };
}

/* The velocity with which a set-point is passed on the way to the one that waits: one from which the
 * axis comes to rest within the way that is left then,
 *     v^2 / 2d + v d / 2j = distance;
 * 0 where the way turns back. */
static double passing_velocity(const sj_drive *drive, const sj_limits *limits)
{
    const double first = (double)sj_profile_left(drive);
    const double second =
        (double)subtract_wrapping(drive->goal.next.travel, drive->goal.now.travel);
    const double distance = fabs(second) * increments_per_unit(drive);
    const double d = limits->deceleration;
    const double half = 0.5 * d * d / limits->deceleration_jerk;
    const double most = sqrt(half * half + 2.0 * d * distance) - half;

    if (!drive->goal.passes || first * second <= 0.0) {
        return 0.0;
    }
    return bounded(copysign(most, first), limits->velocity);
}

/* What is wanted from where the demand will be at the end of this period. */
void sj_profile_request(sj_drive *drive)
{
    sj_drive_request *request = &drive->goal.request;

    request->velocity = drive->demand.velocity;
    request->acceleration = drive->demand.acceleration;
    request->limits = limits_of(drive);
    if (drive->goal.kind == SJ_POSITION_GOAL) {
        request->kind = SJ_REQUEST_MOVE;
        request->distance = increments_left(drive);
        request->direction = drive->goal.now.direction;
        request->turn = (double)drive->scale.range * increments_per_unit(drive);
        request->goal = passing_velocity(drive, &request->limits);
    } else {
        request->kind = SJ_REQUEST_VELOCITY;
        request->goal = drive->goal.velocity;
    }
}

/* The plan that was asked for, and turns of the range by which its end lies further; NULL: there is
 * none. */
void sj_profile_answer(sj_drive *drive, const sj_plan *plan, int64_t turns)
{
    drive->goal.request.kind = SJ_REQUEST_NONE;
    if (plan == NULL) {
        drive->goal.kind = 0; /* an impossible profile: the axis slows down where it is */
        drive->goal.plan_phase = -1;
        drive->warning = 1;
        return;
    }
    drive->goal.now.travel = add_wrapping(drive->goal.now.travel, turns * drive->scale.range);
    drive->goal.through = drive->goal.kind == SJ_POSITION_GOAL && drive->goal.request.goal != 0.0;
    drive->goal.plan = *plan;
    drive->goal.plan_phase = 0;
    drive->goal.plan_left = plan->count > 0 ? plan->phase[0].cycles : 0;
}

/* The plan's end: a move lands on its goal to the unit, a velocity is kept. */
static void land(sj_drive *drive, sj_servo_command *command)
{
    sj_profile_drop(drive);
    if (drive->goal.kind == SJ_POSITION_GOAL) {
        /* what rounding of the sums has left, a fraction of an increment */
        sj_motion_ramp(drive, command, increments_left(drive), 0.0);
        (void)sj_point_move_units(drive, &drive->demand.point, sj_profile_left(drive));
        drive->demand.fraction = 0.0;
    } else {
        sj_motion_ramp(drive, command, drive->goal.velocity, drive->goal.velocity);
    }
}

/* One period of the plan. */
void sj_profile_execute(sj_drive *drive, sj_servo_command *command)
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
        land(drive, command);
        return;
    }
    jerk = plan->phase[drive->goal.plan_phase].jerk;
    drive->goal.plan_left--;
    advance = velocity + 0.5 * acceleration + jerk / 6.0;
    velocity += acceleration + 0.5 * jerk;
    drive->demand.acceleration = acceleration + jerk;
    sj_motion_ramp(drive, command, advance, velocity);
}
