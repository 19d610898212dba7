/* Profile position, mode 1: set-points by bits 4, 5, 6 and 9 of the controlword, bit 12 takes them.
 *
 * Positions are linear: from +100 to -100 the axis goes -200, and a relative set-point goes as far as
 * it says. Bits 7 and 6 of 60F2h make the axis rotary: then a set-point is a place within the range of
 * 607Bh, and they say on which way. The whole way keeps 607Dh.
 * Never here: how the way is planned and gone.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

static int64_t within_range(const sj_drive *drive, int64_t distance)
{
    const int64_t rest = distance % drive->scale.range;
    return rest < 0 ? rest + drive->scale.range : rest;
}

/* The way to a place, by bits 7 and 6 of 60F2h. */
static int64_t way(const sj_drive *drive, int64_t distance)
{
    switch (drive->config.positioning_option & SJ_ROTARY_BITS) {
    case SJ_ROTARY_NEGATIVE: return -within_range(drive, -distance);
    case SJ_ROTARY_POSITIVE: return within_range(drive, distance);
    case SJ_ROTARY_SHORTEST: return sj_point_difference(drive, distance, 0);
    default: return distance;
    }
}

static int32_t direction(const sj_drive *drive)
{
    switch (drive->config.positioning_option & SJ_ROTARY_BITS) {
    case SJ_ROTARY_NEGATIVE: return (int32_t)with_polarity(drive, -1, SJ_POLARITY_POSITION);
    case SJ_ROTARY_POSITIVE: return (int32_t)with_polarity(drive, 1, SJ_POLARITY_POSITION);
    default: return 0;
    }
}

/* What a relative set-point counts from: bits 1 and 0 of 60F2h. */
static int64_t base(const sj_drive *drive)
{
    switch (drive->config.positioning_option & SJ_RELATIVE_BITS) {
    case SJ_RELATIVE_ACTUAL: return drive->actual.travel;
    case SJ_RELATIVE_TARGET:
        return drive->goal.kind == SJ_POSITION_GOAL ? drive->goal.now.travel
                                                    : drive->demand.point.travel;
    default: return drive->demand.point.travel;
    }
}

/* The set-point in 607Ah, for a motion that begins at `from`. */
static sj_drive_set_point set_point(const sj_drive *drive, const sj_drive_rx *rx, int64_t from)
{
    const int64_t ahead = subtract_wrapping(from, drive->demand.point.travel);
    const int64_t word = sj_point_wrap(
        drive, sj_point_demand(drive) + with_polarity(drive, ahead, SJ_POLARITY_POSITION));
    int64_t distance = 0;
    int64_t kept = 0;

    if (drive->controlword & SJ_CW_MODE_6) {
        distance = rx->target_position +
                   with_polarity(drive, subtract_wrapping(base(drive), from), SJ_POLARITY_POSITION);
    } else {
        distance = sj_point_wrap(drive, rx->target_position) - word;
    }
    distance = way(drive, distance);
    kept = sj_limit_distance(drive, word, distance);
    return (sj_drive_set_point){
        .travel = add_wrapping(from, with_polarity(drive, kept, SJ_POLARITY_POSITION)),
        .direction = kept == distance ? direction(drive) : 0,
        .limited = kept != distance,
    };
}

int sj_profile_reached(const sj_drive *drive)
{
    return drive->goal.kind == SJ_POSITION_GOAL && !drive->goal.waits &&
           !sj_profile_planned(drive) && sj_profile_left(drive) == 0;
}

/* Bit 4 offers a set-point, bit 12 takes it: bit 5 at once, or else after the one at hand; with bit 9
 * that one is passed and not stopped at. Under halt as well. */
void sj_profile_offer(sj_drive *drive, const sj_drive_rx *rx)
{
    const uint16_t word = drive->controlword;
    const int offered = (word & ~drive->controlword_before & SJ_CW_MODE_4) != 0;
    const int busy = drive->goal.kind == SJ_POSITION_GOAL && !sj_profile_reached(drive);
    sj_drive_goal *goal = &drive->goal;

    if (!(word & SJ_CW_MODE_4)) {
        goal->acknowledged = goal->waits; /* room for another set-point, or not */
        return;
    }
    if (!offered || (goal->waits && !(word & SJ_CW_MODE_5))) {
        return;
    }
    goal->acknowledged = 1;
    if (busy && !(word & SJ_CW_MODE_5)) {
        goal->next = set_point(drive, rx, goal->now.travel);
        goal->waits = 1;
        goal->passes = (word & SJ_CW_MODE_9) != 0;
        goal->fresh = goal->passes;
        return;
    }
    goal->now = set_point(drive, rx, drive->demand.point.travel);
    goal->kind = SJ_POSITION_GOAL;
    goal->waits = 0;
    goal->passes = 0;
    goal->fresh = 1;
}

/* The period at hand was the last one of the plan. */
static int plan_is_over(const sj_drive_goal *goal)
{
    int64_t left = goal->plan_left;

    for (int32_t i = goal->plan_phase + 1; i < goal->plan.count; i++) {
        left += goal->plan.phase[i].cycles;
    }
    return goal->plan_phase >= 0 && left == 0;
}

/* The set-point that waits has its turn: the first is reached, or passed at the end of its plan. */
static int turn_of_next(const sj_drive *drive)
{
    const sj_drive_goal *goal = &drive->goal;

    if (!goal->waits || goal->request.kind != SJ_REQUEST_NONE) {
        return 0;
    }
    if (goal->through && goal->plan_phase >= 0) {
        return plan_is_over(goal);
    }
    return goal->plan_phase < 0 && sj_profile_left(drive) == 0;
}

void sj_profile_position(sj_drive *drive, sj_servo_command *command)
{
    sj_drive_goal *goal = &drive->goal;
    const uint32_t ends = sj_limit_switches(drive);

    if (goal->kind == SJ_POSITION_GOAL && sj_limit_blocks(ends, (double)sj_profile_left(drive))) {
        sj_profile_give_up(drive); /* onto a closed switch */
    }
    if (sj_limit_blocks(ends, drive->demand.velocity)) {
        sj_profile_drop(drive); /* a set-point away from it waits for the stop's end */
        sj_motion_begin_stop(drive, command, sj_motion_limit_ramp(drive));
        return;
    }
    if (goal->plan_phase >= 0) {
        sj_profile_execute(drive, command);
    } else {
        sj_motion_stop(drive, command, 1);
    }
    if (turn_of_next(drive)) {
        goal->now = goal->next;
        goal->waits = 0;
        goal->passes = 0;
        goal->fresh = 1;
    } else if (goal->kind == SJ_POSITION_GOAL && !sj_profile_planned(drive) &&
               (sj_profile_left(drive) != 0 || drive->demand.velocity != 0.0)) {
        goal->fresh = 1; /* a stop has come between */
    }
    drive->limited |= goal->kind == SJ_POSITION_GOAL && goal->now.limited;
    if (goal->fresh) {
        sj_profile_request(drive);
        goal->fresh = 0;
    }
}
