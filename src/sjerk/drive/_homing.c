/* Homing, mode 6: methods 0, 17, 18, 33, 34, 35 and 37 of 6098h with simulated switches.
 *
 * A rising edge of controlword bit 4 starts, a falling one ends the search where it is. The
 * position at home becomes 607Ch; the axis then stops where its ramp ends and does not return.
 * Never here: the other modes, states.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

static double in_increments(const sj_drive *drive, uint32_t units)
{
    return (double)units * (double)drive->scale.increments / (double)drive->scale.units;
}

static int64_t per_revolution(const sj_drive *drive)
{
    const int64_t whole = drive->config.encoder_increments / drive->config.encoder_revolutions;
    return whole > 0 ? whole : 1;
}

/* Index pulses passed since the turn count began: changes by one at each. */
static int64_t turn(const sj_drive *drive)
{
    const int64_t size = per_revolution(drive);
    const int64_t position = drive->actual.increments;
    return position / size - (position % size < 0);
}

static int searching(const sj_drive *drive)
{
    return drive->homing.phase == SJ_HOMING_SEARCH || drive->homing.phase == SJ_HOMING_BACK;
}

static void found(sj_drive *drive, int64_t home)
{
    sj_point_set_home(drive, home);
    drive->homing.homed = 1;
    drive->homing.phase = SJ_HOMING_STOPPING;
}

static void failed(sj_drive *drive)
{
    drive->homing.error = 1;
    drive->homing.phase = SJ_HOMING_STOPPING;
}

static void start(sj_drive *drive, uint32_t inputs)
{
    const sj_drive_config *config = &drive->config;

    drive->homing.homed = 0;
    drive->homing.error = 0;
    drive->homing.turn = turn(drive);
    drive->homing.phase = SJ_HOMING_SEARCH;
    switch (config->homing_method) {
    case 17:
        if (config->switch_negative_rev <= -1e9) {
            failed(drive);
        } else if (inputs & 1u) {
            drive->homing.phase = SJ_HOMING_BACK;
        }
        return;
    case 18:
        if (config->switch_positive_rev >= 1e9) {
            failed(drive);
        } else if (inputs & 2u) {
            drive->homing.phase = SJ_HOMING_BACK;
        }
        return;
    default: return;
    }
}

/* The velocity of this period, in increments per period; decides what the period has found. */
static double search(sj_drive *drive, uint32_t inputs)
{
    const sj_drive_config *config = &drive->config;
    const double period = config->period_s;
    const double fast = in_increments(drive, config->homing_speed_switch) * period;
    const double slow = in_increments(drive, config->homing_speed_zero) * period;
    const int32_t method = config->homing_method;
    const double direction = method == 17 || method == 33 ? -1.0 : 1.0;
    const uint32_t ahead = direction < 0.0 ? 1u : 2u;

    switch (method) {
    case 17:
    case 18:
        /* onto the limit switch, and back until it opens: that edge is home */
        if (drive->homing.phase == SJ_HOMING_SEARCH) {
            if (!(inputs & ahead)) {
                return direction * fast;
            }
            drive->homing.phase = SJ_HOMING_BACK;
        }
        if (inputs & ahead) {
            return -direction * slow;
        }
        found(drive, drive->actual.increments);
        return 0.0;
    case 33:
    case 34:
        if (inputs & ahead) {
            failed(drive);
            return 0.0;
        }
        if (turn(drive) == drive->homing.turn) {
            return direction * slow;
        }
        /* the pulse lies where the count of turns changed */
        found(drive, (direction > 0.0 ? turn(drive) : drive->homing.turn) * per_revolution(drive));
        return 0.0;
    case 0:
        drive->homing.homed = 1;
        drive->homing.phase = SJ_HOMING_STOPPING;
        return 0.0;
    default: found(drive, drive->actual.increments); return 0.0;
    }
}

void sj_homing_period(sj_drive *drive, sj_servo_command *command)
{
    const double period = drive->config.period_s;
    const double ramp = in_increments(drive, drive->config.homing_acceleration) * period * period;
    const uint16_t word = drive->controlword;
    const uint32_t inputs = sj_limit_inputs(drive);
    double velocity = 0.0;

    command->velocity_offset_rad_s = 0.0;
    if (word & ~drive->controlword_before & SJ_CW_MODE_4) {
        start(drive, inputs); /* shown for a period before anything is found */
    } else if (!(word & SJ_CW_MODE_4)) {
        if (searching(drive)) {
            drive->homing.phase = SJ_HOMING_STOPPING;
        }
    } else if (searching(drive)) {
        velocity = search(drive, inputs);
    }
    sj_motion_ramp_to(drive, command, velocity, ramp > 1e-9 ? ramp : 1e-9);
    if (drive->homing.phase == SJ_HOMING_STOPPING && velocity == 0.0 &&
        drive->demand.velocity == 0.0) {
        drive->homing.phase = SJ_HOMING_IDLE;
    }
}

uint16_t sj_homing_bits(const sj_drive *drive)
{
    const int standing = drive->homing.phase == SJ_HOMING_IDLE && drive->standing;

    return (uint16_t)((!searching(drive) && standing ? SJ_SW_TARGET_REACHED : 0) |
                      (drive->homing.homed ? SJ_SW_FOLLOWS : 0) |
                      (drive->homing.error ? SJ_SW_FOLLOWING_ERROR : 0));
}
