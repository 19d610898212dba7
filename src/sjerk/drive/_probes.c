/* Touch probes: positions latched at edges of an input, 60B8h to 60BDh (IEC 61800-7-201).
 *
 * 60B8h has for each probe, from bit 0 or bit 8 on: 0 enables it, 1 each event and not only the first,
 * 3 and 2 the source (00 its input, 01 the index pulse of the encoder), 4 the positive edge, 5 the
 * negative one. 60B9h likewise: 0 enabled, 1 a positive edge stored, 2 a negative one; a bit goes with the
 * bit that asked for it, the position stays. Works in every state, as the encoder does.
 * Never here: motions.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

enum {
    ENABLED = 0x01,
    CONTINUOUS = 0x02,
    SOURCE = 0x0C,
    SOURCE_INPUT = 0x00,
    SOURCE_INDEX = 0x04,
    POSITIVE = 0x10,
    NEGATIVE = 0x20,
    STORED = 0x02 /* the positive edge; the bit above it is the negative one */
};

/* 6064h at a place that the period has passed. */
static int32_t position_at(const sj_drive *drive, int64_t place)
{
    sj_drive_point point = drive->actual;

    sj_point_move_increments(drive, &point, subtract_wrapping(place, drive->servo.encoder));
    return (int32_t)sj_point_word(drive, point.units);
}

/* An edge of probe 0 or 1; negative: 0 or 1. */
static void latch(sj_drive *drive, int probe, int negative, uint16_t function, int64_t place)
{
    const uint16_t bit = (uint16_t)(STORED << negative << 8 * probe);
    const uint16_t asked = (uint16_t)(POSITIVE << negative);

    if ((function & asked) == 0 ||
        ((drive->probes.status & bit) != 0 && (function & CONTINUOUS) == 0)) {
        return;
    }
    drive->probes.position[2 * probe + negative] = position_at(drive, place);
    drive->probes.status |= bit;
}

/* The index pulse is one increment wide: both of its edges tell its place. Of several pulses in one
 * period the first counts, or with each event the last. */
static void latch_index(sj_drive *drive, int probe, uint16_t function, int64_t from)
{
    const int64_t to = drive->servo.encoder;
    const int up = to > from;
    const int64_t first = sj_signal_pulse(drive, up ? from : from + 1, up ? 1 : -1);
    const int64_t last = sj_signal_pulse(drive, up ? to + 1 : to, up ? -1 : 1);

    if (to == from || (up ? first > to : first <= to)) {
        return;
    }
    for (int negative = 0; negative < 2; negative++) {
        latch(drive, probe, negative, function, function & CONTINUOUS ? last : first);
    }
}

static void run(sj_drive *drive, int probe, uint16_t function, int64_t from)
{
    const uint16_t keeps = (uint16_t)((function & ENABLED) | (function & POSITIVE ? STORED : 0) |
                                      (function & NEGATIVE ? STORED << 1 : 0));
    const uint16_t others = (uint16_t)(0xFF00 >> 8 * probe);
    sj_signal_edge edge[2];
    int32_t count = 0;

    drive->probes.status &= (uint16_t)(others | (function & ENABLED ? keeps << 8 * probe : 0));
    if (!(function & ENABLED)) {
        return;
    }
    drive->probes.status |= (uint16_t)(ENABLED << 8 * probe);
    switch (function & SOURCE) {
    case SOURCE_INPUT:
        count = sj_signal_edges(drive, SJ_INPUT_PROBE_1 + probe, from, drive->servo.encoder, edge);
        for (int32_t i = 0; i < count; i++) {
            latch(drive, probe, !edge[i].rises, function, edge[i].place);
        }
        return;
    case SOURCE_INDEX: latch_index(drive, probe, function, from); return;
    default: return;
    }
}

void sj_probes_period(sj_drive *drive, uint16_t function, int64_t from)
{
    for (int probe = 0; probe < 2; probe++) {
        run(drive, probe, (uint16_t)(function >> 8 * probe & 0xFF), from);
    }
}
