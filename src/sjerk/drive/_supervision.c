/* The supervision of a drive: what can become a fault in a period, before the motor moves and after.
 *
 * Missed SYNCs (10F1h), injected causes and over-speed first; the following error (60F4h, 6065h,
 * 6066h) and standstill last.
 * Never here: the reaction to a fault (the state machine, and the motion of its state), words.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

void sj_drive_inject(sj_drive *drive, int32_t fault, int32_t present)
{
    if (fault > SJ_FAULT_NONE && fault < SJ_FAULTS) {
        const uint32_t bit = (uint32_t)1 << fault;
        drive->causes = present ? drive->causes | bit : drive->causes & ~bit;
    }
}

/* T13: the fault reaction begins in the same period. */
void sj_drive_raise(sj_drive *drive, int32_t fault)
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

/* The mode lives of a target in each period. */
static int streams(const sj_drive *drive)
{
    if (drive->mode == SJ_MODE_INTERPOLATED) {
        return (drive->controlword & SJ_CW_MODE_4) != 0;
    }
    return drive->mode >= SJ_MODE_CSP;
}

/* Missed SYNCs count while the drive is to follow: +3 for each, -1 for each that came. */
static int32_t supervise_sync(sj_drive *drive, const sj_drive_rx *rx)
{
    const uint32_t limit = drive->config.sync_error_limit;

    if (drive->state != SJ_STATE_OPERATION_ENABLED || !streams(drive)) {
        drive->counts.missed_in_row = 0;
        drive->counts.sync_errors = 0;
        return SJ_FAULT_NONE;
    }
    if (!rx->sync_missed) {
        drive->counts.missed_in_row = 0;
        drive->counts.sync_errors -= drive->counts.sync_errors > 0;
        return SJ_FAULT_NONE;
    }
    drive->verdict.missed_syncs++;
    drive->warning = 1;
    drive->counts.missed_in_row += drive->counts.missed_in_row < INT32_MAX;
    drive->counts.sync_errors += drive->counts.sync_errors < INT32_MAX - 3 ? 3 : 0;
    return limit != 0xFFFF && (uint32_t)drive->counts.sync_errors >= limit ? SJ_FAULT_SYNC
                                                                           : SJ_FAULT_NONE;
}

/* The fault this period begins with, if any. */
int32_t sj_supervise_inputs(sj_drive *drive, const sj_drive_rx *rx)
{
    const int powered = drive->state >= SJ_STATE_READY;
    const double speed = drive->servo.measured_rad_s;
    const double most = SJ_OVER_SPEED * drive->config.max_speed_rpm * SJ_RPM;
    const int32_t sync = supervise_sync(drive, rx);

    for (int32_t fault = 1; fault < SJ_FAULTS && drive->causes != 0; fault++) {
        /* without power a disabled drive just stays disabled; a lost link acts by 6007h */
        const int waits =
            (fault == SJ_FAULT_SAFE_TORQUE_OFF || fault == SJ_FAULT_UNDER_VOLTAGE) && !powered;
        const int by_option = (SJ_LINK_CAUSES >> fault & 1) != 0 && drive->config.abort_option != 1;
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
void sj_supervise_following(sj_drive *drive, const sj_servo_command *command)
{
    const sj_drive_config *config = &drive->config;
    const int64_t error = following_error(drive);
    const int64_t size = error < 0 ? -error : error;
    const int supervised =
        drive->state == SJ_STATE_OPERATION_ENABLED && command->control == SJ_SERVO_POSITION;

    if (supervised && drive->follows && size > drive->verdict.following_max) {
        drive->verdict.following_max = size < UINT32_MAX ? (uint32_t)size : UINT32_MAX;
    }
    if (!supervised || config->following_window == UINT32_MAX || size <= config->following_window) {
        drive->counts.following = 0;
        return;
    }
    drive->counts.following++;
    if (drive->counts.following * config->period_s * 1e3 > config->following_time_ms) {
        drive->following_error = 1;
        sj_drive_raise(drive, SJ_FAULT_FOLLOWING_ERROR);
    }
}

/* Whether a stop has ended: no demand velocity, and the motor stands or had its time. */
void sj_supervise_standing(sj_drive *drive)
{
    const double speed = drive->servo.measured_rad_s;
    const double still = SJ_STANDSTILL * drive->config.max_speed_rpm * SJ_RPM;

    if (drive->demand.velocity != 0.0) {
        drive->counts.stop = 0;
        drive->standing = 0;
        return;
    }
    drive->counts.stop += drive->counts.stop < UINT32_MAX;
    drive->standing = (speed < still && speed > -still) ||
                      drive->counts.stop * drive->config.period_s > drive->config.stop_timeout_s;
}
