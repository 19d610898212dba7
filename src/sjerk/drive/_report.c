/* What a drive says at the end of a period: the statusword and the actual values, in the units of the
 * objects.
 *
 * Never here: a decision; all that is said has happened.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

/* The axis is where it was to go: at a set-point of mode 1, at a target of CSP that stands. */
static int arrived(const sj_drive *drive, int64_t *off)
{
    switch (drive->mode) {
    case SJ_MODE_PROFILE_POSITION:
        *off = subtract_wrapping(drive->goal.now.travel, drive->actual.travel);
        return sj_profile_reached(drive);
    case SJ_MODE_INTERPOLATED:
    case SJ_MODE_CSP:
        *off = following_error(drive);
        return drive->follows && drive->demand.velocity == 0.0;
    default: return 0;
    }
}

/* Bit 10: within 6067h of the target for 6068h; after a halt, or a quick stop that ends in its state:
 * standing. */
static int target_reached(sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const int64_t window = config->position_window;
    int64_t off = 0;

    if (drive->state == SJ_STATE_QUICK_STOP) {
        drive->counts.window = 0;
        return config->quick_stop_option > 4 && drive->standing;
    }
    if (drive->state != SJ_STATE_OPERATION_ENABLED) {
        drive->counts.window = 0;
        return 0;
    }
    if (drive->controlword & SJ_CW_HALT) {
        drive->counts.window = 0;
        return drive->standing;
    }
    if (!arrived(drive, &off) || (window != UINT32_MAX && (off > window || off < -window))) {
        drive->counts.window = 0;
        return 0;
    }
    drive->counts.window += drive->counts.window < UINT32_MAX;
    return drive->counts.window * config->period_s * 1e3 >= config->position_time_ms;
}

/* Bits 10, 12 and 13, which belong to the mode. */
static uint16_t mode_bits(sj_drive *drive)
{
    const int enabled = drive->state == SJ_STATE_OPERATION_ENABLED;
    uint16_t word = 0;

    if (drive->mode == SJ_MODE_HOMING) {
        return sj_homing_bits(drive);
    }
    word |= drive->following_error ? SJ_SW_FOLLOWING_ERROR : 0;
    if (drive->mode == SJ_MODE_PROFILE_VELOCITY && enabled && !(drive->controlword & SJ_CW_HALT)) {
        return word | sj_profile_velocity_bits(drive);
    }
    if (drive->mode == SJ_MODE_PROFILE_TORQUE && enabled && !(drive->controlword & SJ_CW_HALT)) {
        return word | (sj_profile_torque_reached(drive) ? SJ_SW_TARGET_REACHED : 0);
    }
    word |= target_reached(drive) ? SJ_SW_TARGET_REACHED : 0;
    if (drive->mode == SJ_MODE_PROFILE_TORQUE) {
        return word;
    }
    if (drive->mode == SJ_MODE_PROFILE_POSITION) {
        return word | (enabled && drive->goal.acknowledged ? SJ_SW_FOLLOWS : 0);
    }
    return word | (enabled && drive->follows ? SJ_SW_FOLLOWS : 0);
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

void sj_report_words(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    const sj_drive_config *config = &drive->config;
    const sj_servo *servo = &drive->servo;
    const double to_units = units_per_increment(drive);
    const double per_mille = 1000.0 / config->rated_torque_nm;
    const double velocity_sign = config->polarity & SJ_POLARITY_VELOCITY ? -1.0 : 1.0;
    const double torque_sign = config->polarity & SJ_POLARITY_TORQUE ? -1.0 : 1.0;
    uint16_t word = sj_drive_state_bits(drive->state);

    word |= has_cause(drive, SJ_FAULT_UNDER_VOLTAGE) ? 0 : SJ_SW_VOLTAGE;
    word |= drive->warning ? SJ_SW_WARNING : 0;
    word |= rx->sync_missed ? 0 : SJ_SW_SYNC;
    word |= drive->local ? 0 : SJ_SW_REMOTE;
    word |= drive->limited || servo->torque_limited || servo->speed_limited ||
                    sj_limit_switches(drive) != 0
                ? SJ_SW_LIMIT
                : 0;
    word |= mode_bits(drive);

    tx->statusword = word;
    tx->mode_display = (int8_t)drive->mode;
    tx->error_register = sj_drive_fault(drive->fault)->error_register;
    tx->error_code = drive->error_code;
    tx->position_actual = (int32_t)sj_point_word(drive, drive->actual.units);
    tx->position_demand = (int32_t)sj_point_demand(drive);
    tx->following_error =
        to_int32((double)with_polarity(drive, following_error(drive), SJ_POLARITY_POSITION));
    tx->velocity_actual = to_int32(velocity_sign * servo->measured_rad_s *
                                   drive->constants.increments_per_rad * to_units);
    tx->velocity_demand =
        to_int32(velocity_sign * drive->demand.velocity / config->period_s * to_units);
    tx->torque_actual = to_int16(torque_sign * servo->torque_nm * per_mille);
    tx->torque_demand = to_int16(torque_sign * servo->command_nm * per_mille);
    tx->current_actual = to_int16(servo->torque_nm * per_mille);
    tx->position_internal = (int32_t)(uint32_t)(uint64_t)drive->actual.increments;
    tx->demand_internal = (int32_t)(uint32_t)(uint64_t)drive->demand.point.increments;
    tx->digital_inputs = sj_limit_inputs(drive);
    tx->probe_status = drive->probes.status;
    tx->probe_1_positive = drive->probes.position[0];
    tx->probe_1_negative = drive->probes.position[1];
    tx->probe_2_positive = drive->probes.position[2];
    tx->probe_2_negative = drive->probes.position[3];
    tx->dc_link_mv = has_cause(drive, SJ_FAULT_UNDER_VOLTAGE)  ? 0
                     : has_cause(drive, SJ_FAULT_OVER_VOLTAGE) ? 420000
                                                               : 325000;
}
