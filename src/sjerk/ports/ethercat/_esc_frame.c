/* A frame on its way through a line of emulated EtherCAT subdevices: datagrams, working counters, FMMUs.
 *
 *     14 Ethernet | 2 length, type 1 | datagrams: 10 header, n data, 2 working counter
 *     header: 1 command | 1 index | 4 address | 2 length, bit 15 more follow | 2 events
 *
 * Working counter: read +1, written +1; in a read-write read +1 and written +2. Logical addresses go
 * through the FMMUs bit by bit.
 *
 * Never here: what a byte of a device means.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include "ports/ethercat/_esc.h"
#include "ports/ethercat/_words.h"

enum {
    APRD = 1,
    APWR,
    APRW,
    FPRD,
    FPWR,
    FPRW,
    BRD,
    BWR,
    BRW,
    LRD,
    LWR,
    LRW,
    ARMW,
    FRMW,
    ETHERNET = 14,
    FIRST = 16,
    HEADER = 10,
    SHORTEST = 28,
    DATA = 1500
};

typedef struct {
    int command;
    uint8_t *head; /* of the datagram */
    uint8_t *data;
    uint32_t count;
} datagram;

/* One FMMU over the part [low, high) of logical bits that it shares with the datagram. */
static void map_part(sj_line *line, sj_esc *esc, const uint8_t *fmmu, const datagram *d,
                     const uint8_t *sent, uint64_t low, uint64_t high, int64_t now, int *read,
                     int *written)
{
    const uint64_t first = (uint64_t)get32(fmmu) * 8 + (fmmu[6] & 7);
    const uint64_t origin = (uint64_t)get32(d->head + 2) * 8;
    const uint64_t physical = (uint64_t)get16(fmmu + 8) * 8 + (fmmu[10] & 7) + (low - first);
    const uint32_t address = (uint32_t)(physical / 8), shift = (uint32_t)(physical % 8);
    const uint32_t bits = (uint32_t)(high - low), count = (shift + bits + 7) / 8;
    const uint32_t at = (uint32_t)(low - origin);
    uint8_t bytes[DATA + 1], mask[DATA + 1];
    if (count > sizeof bytes)
        return;
    if ((fmmu[11] & 2) && d->command != LRD) {
        if (((shift | at | bits) & 7) == 0)
            *written |= sj_esc_write(line, esc, address, sent + at / 8, NULL, count, now);
        else {
            memset(bytes, 0, count);
            memset(mask, 0, count);
            for (uint32_t i = 0; i < bits; i++)
                mask[(shift + i) >> 3] |= (uint8_t)(1u << ((shift + i) & 7));
            bits_copy(bytes, shift, sent, at, bits);
            *written |= sj_esc_write(line, esc, address, bytes, mask, count, now);
        }
    }
    if ((fmmu[11] & 1) && d->command != LWR && sj_esc_read(esc, address, bytes, count, now)) {
        bits_copy(d->data, at, bytes, shift, bits);
        *read = 1;
    }
}

static int logical(sj_line *line, sj_esc *esc, const datagram *d, int64_t now)
{
    const uint64_t from = (uint64_t)get32(d->head + 2) * 8, to = from + (uint64_t)d->count * 8;
    int read = 0, written = 0;
    uint8_t sent[DATA];
    memcpy(sent, d->data, d->count);
    for (int k = 0; k < FMMU_COUNT; k++) {
        const uint8_t *fmmu = esc->memory + REG_FMMU + 16 * k;
        const uint32_t length = get16(fmmu + 4);
        if (!(fmmu[12] & 1) || length == 0)
            continue;
        const uint64_t begin = (uint64_t)get32(fmmu) * 8;
        const uint64_t first = begin + (fmmu[6] & 7);
        const uint64_t end = begin + (uint64_t)(length - 1) * 8 + (fmmu[7] & 7) + 1;
        const uint64_t low = first > from ? first : from, high = end < to ? end : to;
        if (low < high)
            map_part(line, esc, fmmu, d, sent, low, high, now, &read, &written);
    }
    return read + (d->command == LRW ? 2 : 1) * written;
}

static int read_over(sj_esc *esc, const datagram *d, uint16_t offset, int gather, int64_t now)
{
    uint8_t bytes[DATA];
    if (!sj_esc_read(esc, offset, bytes, d->count, now))
        return 0;
    for (uint32_t i = 0; i < d->count; i++)
        d->data[i] = (uint8_t)(gather ? d->data[i] | bytes[i] : bytes[i]);
    return 1;
}

static int physical(sj_line *line, sj_esc *esc, const datagram *d, int addressed, int64_t now)
{
    const uint16_t offset = get16(d->head + 4);
    uint8_t sent[DATA];
    int done;
    switch (d->command) {
    case APRD:
    case FPRD:
    case BRD: return addressed ? read_over(esc, d, offset, d->command == BRD, now) : 0;
    case APWR:
    case FPWR:
    case BWR: return addressed ? sj_esc_write(line, esc, offset, d->data, NULL, d->count, now) : 0;
    case APRW:
    case FPRW:
    case BRW:
        if (!addressed)
            return 0;
        memcpy(sent, d->data, d->count);
        done = read_over(esc, d, offset, d->command == BRW, now);
        return done + 2 * sj_esc_write(line, esc, offset, sent, NULL, d->count, now);
    default: /* ARMW, FRMW */
        return addressed ? read_over(esc, d, offset, 0, now)
                         : sj_esc_write(line, esc, offset, d->data, NULL, d->count, now);
    }
}

/* One datagram at one device: what it adds to the working counter. */
static int visit(sj_line *line, sj_esc *esc, const datagram *d, int64_t now)
{
    const uint16_t station = get16(d->head + 2);
    switch (d->command) {
    case APRD:
    case APWR:
    case APRW:
    case ARMW:
        put16(d->head + 2, (uint16_t)(station + 1));
        return physical(line, esc, d, station == 0, now);
    case FPRD:
    case FPWR:
    case FPRW:
    case FRMW:
        return physical(line, esc, d,
                        station == get16(esc->memory + REG_STATION) ||
                            ((esc->memory[REG_DL_CONTROL + 3] & 1) &&
                             station == get16(esc->memory + REG_ALIAS)),
                        now);
    case BRD:
    case BWR:
    case BRW: put16(d->head + 2, (uint16_t)(station + 1)); return physical(line, esc, d, 1, now);
    case LRD:
    case LWR:
    case LRW: return logical(line, esc, d, now);
    default: return 0;
    }
}

/* Whether the datagrams fit: their end, 0 if not. */
static int32_t checked(const uint8_t *frame, int32_t length)
{
    int32_t at = FIRST;
    if (length < SHORTEST || length > SJ_ESC_FRAME || frame[12] != 0x88 || frame[13] != 0xA4)
        return 0;
    const int32_t end = FIRST + (get16(frame + ETHERNET) & 0x7FF);
    if (get16(frame + ETHERNET) >> 12 != 1 || end > length)
        return 0;
    for (;;) {
        if (at + HEADER + 2 > end)
            return 0;
        const uint16_t size = get16(frame + at + 6);
        at += HEADER + 2 + (size & 0x7FF);
        if (at > end)
            return 0;
        if (!(size & 0x8000))
            return at;
    }
}

int32_t sj_line_frame(sj_line *line, uint8_t *frame, int32_t length, int64_t now)
{
    const int32_t end = checked(frame, length);
    if (end == 0) {
        line->broken++;
        return 0;
    }
    line->frames++;
    const int damage = line->damage_every && line->frames % line->damage_every == 0;
    for (int32_t at = FIRST; at < end;) {
        const uint32_t count = get16(frame + at + 6) & 0x7FF;
        const datagram d = {frame[at], frame + at, frame + at + HEADER, count};
        uint16_t counter = get16(d.data + count);
        for (int i = 0; i < line->cut; i++)
            if (!line->devices[i].silent)
                counter = (uint16_t)(counter +
                                     visit(line, line->devices + i, &d, now + i * line->hop_ns));
        if (damage && d.command >= LRD && d.command <= LRW) {
            counter = (uint16_t)(counter - 1);
            line->damaged++;
        }
        put16(d.data + count, counter);
        line->datagrams++;
        at += HEADER + 2 + (int32_t)count;
    }
    frame[6] |= 2;
    if (line->lose_every && line->frames % line->lose_every == 0) {
        line->lost++;
        return -1;
    }
    return length;
}
