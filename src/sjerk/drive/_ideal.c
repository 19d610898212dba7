/* The ideal drive: the state machine of CiA 402 in front of an axis that is at its target
 * at once.
 *
 * Never here: a motor, a fault, any mode but CSP.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

void sj_ideal_cycle(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    const sj_drive_input input = {.controlword = rx->controlword,
                                  .previous = drive->controlword,
                                  .quick_stop_option = 2,
                                  .power = 1,
                                  .standing = 1};
    const int32_t before = drive->state;
    uint32_t ran = 0;
    int follows;

    drive->state = sj_drive_next(before, &input, &ran);
    drive->controlword = rx->controlword;
    /* the master sees where the axis is before its targets count */
    follows = drive->state == SJ_STATE_OPERATION_ENABLED && before == drive->state &&
              rx->mode == drive->mode;
    drive->mode = rx->mode;
    tx->velocity_actual = 0;
    if (follows && drive->mode == SJ_MODE_CSP) {
        int64_t distance = (int64_t)rx->target_position - tx->position_actual;
        tx->velocity_actual = (int32_t)((double)distance / drive->config.period_s);
        tx->position_actual = rx->target_position;
    }
    tx->mode_display = (int8_t)drive->mode;
    tx->statusword = (uint16_t)(sj_drive_state_bits(drive->state) | SJ_SW_VOLTAGE |
                                (follows ? SJ_SW_FOLLOWS | SJ_SW_TARGET_REACHED : 0));
}
