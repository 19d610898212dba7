/* Where the axis may not go on: limit switches (60FDh) and software position limits (607Dh).
 *
 * Switches belong to the motor; the ends of 607Dh are words, polarity applied. Pure: they say what is
 * there. Never here: what a mode does about it.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

uint32_t sj_limit_inputs(const sj_drive *drive)
{
    uint32_t inputs = 0;

    inputs |= sj_signal_closed(drive, SJ_INPUT_NEGATIVE) ? SJ_DI_NEGATIVE : 0;
    inputs |= sj_signal_closed(drive, SJ_INPUT_POSITIVE) ? SJ_DI_POSITIVE : 0;
    inputs |= sj_signal_closed(drive, SJ_INPUT_HOME) ? SJ_DI_HOME : 0;
    inputs |= sj_signal_closed(drive, SJ_INPUT_PROBE_1) ? SJ_DI_PROBE_1 : 0;
    inputs |= sj_signal_closed(drive, SJ_INPUT_PROBE_2) ? SJ_DI_PROBE_2 : 0;
    inputs |= has_cause(drive, SJ_FAULT_SAFE_TORQUE_OFF) ? SJ_DI_INTERLOCK : 0;
    return inputs;
}

uint32_t sj_limit_switches(const sj_drive *drive)
{
    return (sj_signal_closed(drive, SJ_INPUT_NEGATIVE) ? SJ_DI_NEGATIVE : 0u) |
           (sj_signal_closed(drive, SJ_INPUT_POSITIVE) ? SJ_DI_POSITIVE : 0u);
}

/* Words beyond which the axis may not go. Not min < max: none; an end of the range of 607Bh is none
 * on its side, since no word lies beyond it. They are words of 607Ah, or (software_from_home) of the
 * machine: CiA 402 takes 607Ch from them before it compares. */
static void software_limits(const sj_drive *drive, int64_t *low, int64_t *high)
{
    const sj_drive_config *config = &drive->config;
    const int64_t range_max = drive->scale.range_min + drive->scale.range - 1;
    const int64_t home = config->software_from_home ? config->home_offset : 0;

    *low = INT64_MIN / 4;
    *high = INT64_MAX / 4;
    if (config->software_min >= config->software_max) {
        return;
    }
    if (config->software_min - home > drive->scale.range_min) {
        *low = config->software_min - home;
    }
    if (config->software_max - home < range_max) {
        *high = config->software_max - home;
    }
}

uint32_t sj_limit_ends(const sj_drive *drive)
{
    const int turned = (drive->config.polarity & SJ_POLARITY_POSITION) != 0;
    const int64_t now = sj_point_demand(drive);
    int64_t low;
    int64_t high;

    software_limits(drive, &low, &high);
    return sj_limit_switches(drive) |
           (now <= low ? (turned ? SJ_DI_POSITIVE : SJ_DI_NEGATIVE) : 0u) |
           (now >= high ? (turned ? SJ_DI_NEGATIVE : SJ_DI_POSITIVE) : 0u);
}

int sj_limit_blocks(uint32_t ends, double direction)
{
    return ((ends & SJ_DI_NEGATIVE) != 0 && direction < 0.0) ||
           ((ends & SJ_DI_POSITIVE) != 0 && direction > 0.0);
}

/* The whole way stays inside; an axis that is outside may only come back. */
int64_t sj_limit_distance(const sj_drive *drive, int64_t from, int64_t distance)
{
    int64_t low;
    int64_t high;
    int64_t to = from + distance;

    software_limits(drive, &low, &high);
    low = from < low ? from : low;
    high = from > high ? from : high;
    to = to < low ? low : to;
    to = to > high ? high : to;
    return to - from;
}
