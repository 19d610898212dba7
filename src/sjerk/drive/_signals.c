/* Inputs that belong to places of the motor: switches, touch probes, the index pulse of the encoder.
 *
 * A place is a number of increments; an edge or a pulse there lies between that increment and the one
 * below, so that the same place is told whichever way it is passed. What a period has passed is found
 * from the encoder at its ends: latched to the increment, as the inputs of a drive do it. To leave a
 * place and come back within one period is to pass nothing.
 * Never here: what an edge means.
 */
#include <math.h>            /* ceil, floor: while preparing only */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

static int64_t floor_div(int64_t value, int64_t divisor)
{
    return value / divisor - (value % divisor < 0);
}

/* Closed from the first increment at `begin_rev` to the last at `end_rev`. */
static sj_drive_signal between(const sj_drive_config *config, double begin_rev, double end_rev)
{
    const double increments = (double)config->encoder_increments / config->encoder_revolutions;
    sj_drive_signal signal = {INT64_MIN, INT64_MAX};

    if (begin_rev > -1e9) {
        signal.closes = begin_rev < 1e9 ? (int64_t)ceil(begin_rev * increments) : INT64_MAX;
    }
    if (end_rev < 1e9) {
        signal.opens = end_rev > -1e9 ? (int64_t)floor(end_rev * increments) + 1 : INT64_MIN;
    }
    if (signal.opens <= signal.closes) {
        signal.opens = signal.closes = INT64_MAX; /* never */
    }
    return signal;
}

void sj_signal_prepare(sj_drive_signal input[SJ_INPUTS], const sj_drive_config *config)
{
    input[SJ_INPUT_NEGATIVE] = between(config, -1e9, config->switch_negative_rev);
    input[SJ_INPUT_POSITIVE] = between(config, config->switch_positive_rev, 1e9);
    input[SJ_INPUT_HOME] = between(config, config->switch_home_rev, config->switch_home_end_rev);
    input[SJ_INPUT_PROBE_1] = between(config, config->probe_1_rev, config->probe_1_end_rev);
    input[SJ_INPUT_PROBE_2] = between(config, config->probe_2_rev, config->probe_2_end_rev);
}

int sj_signal_closed(const sj_drive *drive, int32_t input)
{
    const sj_drive_signal *signal = &drive->scale.input[input];

    return drive->servo.encoder >= signal->closes && drive->servo.encoder < signal->opens;
}

int32_t sj_signal_edges(const sj_drive *drive, int32_t input, int64_t from, int64_t to,
                        sj_signal_edge edge[2])
{
    const sj_drive_signal *signal = &drive->scale.input[input];
    const int up = to > from;
    int32_t count = 0;

    if (signal->closes == signal->opens) {
        return 0;
    }
    for (int k = 0; k < 2; k++) {
        const int closes = (k == 0) == up; /* upwards it closes first */
        const int64_t place = closes ? signal->closes : signal->opens;
        if (up ? from < place && place <= to : to < place && place <= from) {
            edge[count++] = (sj_signal_edge){place, closes == up};
        }
    }
    return count;
}

/* Pulse k lies at k times the increments of a revolution, and a place is the next whole increment:
 *     pulse(k) = ceil(k I / R),   the last pulse not above x: k = floor(x R / I). */
int64_t sj_signal_pulse(const sj_drive *drive, int64_t place, int32_t direction)
{
    const int64_t increments = drive->config.encoder_increments;
    const int64_t revolutions = drive->config.encoder_revolutions;
    const int64_t below = direction > 0 ? place : place - 1;
    const int64_t whole = floor_div(below, increments);
    const int64_t rest = below - whole * increments;
    const int64_t part = rest * revolutions / increments + (direction > 0); /* of `whole` */
    const int64_t share = part * increments;

    return whole * increments + share / revolutions + (share % revolutions != 0);
}
