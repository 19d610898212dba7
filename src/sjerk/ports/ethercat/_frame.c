/* The cyclic frame: what the kernel wants of its drives out, what they say in, and the relation of the
 * two clocks.
 *
 *     first frame:  FRMW 0910h of the reference | BRD 0130h | FPRD 0130h of one drive in turn | LRW ...
 *     the others:   LRW of those drives that found no room
 *
 * One LRW for each drive: its working counter tells which drive is lost. The BRD counts the devices and
 * joins their states; the FPRD tells whose state it is, and its code.
 *
 * The clock. With sent - deadline taken away, the time that the frame met at the reference clock says
 * where the cycle lies in the period of that clock, whatever the wake-up was:
 *
 *     e = (clock - (sent - deadline) - phase) mod T        -T/2 < e <= T/2
 *     correction = -e/10 - sum(e)/2000                     e within +-T/16
 *
 * Never here: sockets, reading a clock, decisions about motion.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include "kernel/_clock.h"
#include "ports/ethercat/_frame.h"
#include "ports/ethercat/_words.h"

enum {
    FPRD = 4,
    BRD = 7,
    LRW = 12,
    FRMW = 14,
    ETHERNET = 14,
    FIRST = 16,
    HEADER = 10,
    COUNTER = 2,
    MORE = 0x8000,
    SHORTEST = 60,
    OWN = 0x80, /* indices from here on are the cycle's; below are those of requests */
    CLOCK_BYTES = 8,
    BROAD_BYTES = 2,
    STATE_BYTES = 6,
    FRONT = 3 * (HEADER + COUNTER) + CLOCK_BYTES + BROAD_BYTES + STATE_BYTES,
    CLAMP = 16, /* part of the period */
    PROPORTIONAL = 10,
    INTEGRAL = 2000,
    NEAR = 50,        /* part of the period: aligned */
    LONG_ENOUGH = 100 /* cycles */
};

static uint32_t data_bytes(const sj_bus_drive *d)
{
    return d->out_bytes > d->in_bytes ? d->out_bytes : d->in_bytes;
}

/* Of the logical addresses of all drives; they follow each other. */
static uint32_t span(const sj_bus *bus)
{
    const sj_bus_drive *last = &bus->drive[bus->count - 1];
    return last->logical + data_bytes(last) - bus->drive[0].logical;
}

int32_t sj_bus_lay_out(sj_bus *bus)
{
    uint32_t at = FIRST + FRONT;
    int32_t frame = 0;
    for (int i = 0; i < bus->count; i++) {
        sj_bus_drive *d = &bus->drive[i];
        const uint32_t need = HEADER + data_bytes(d) + COUNTER;
        if (at + need > SJ_BUS_FRAME) {
            frame++;
            at = FIRST;
        }
        if (at + need > SJ_BUS_FRAME || frame >= SJ_BUS_FRAMES)
            return 0;
        d->frame = frame;
        at += need;
    }
    bus->frames = frame + 1;
    return bus->frames;
}

/* ---- composing ---- */

/* One datagram at `at`, its data empty; the place behind it. */
static uint32_t put(uint8_t *frame, uint32_t at, int command, uint8_t index, uint32_t address,
                    uint32_t count)
{
    frame[at] = (uint8_t)command;
    frame[at + 1] = index;
    put32(frame + at + 2, address);
    put16(frame + at + 6, (uint16_t)(count | MORE));
    put16(frame + at + 8, 0);
    memset(frame + at + HEADER, 0, count + COUNTER);
    return at + HEADER + count + COUNTER;
}

/* Of a datagram at `at`: its data, and the working counter behind them. */
static uint8_t *data_at(uint8_t *frame, uint32_t at) { return frame + at + HEADER; }

static void put_outputs(const sj_bus *bus, const sj_bus_drive *d, uint8_t *data)
{
    const uint8_t *rx = (const uint8_t *)&bus->kernel->rx[d->axis];
    for (int i = 0; i < d->out_words; i++)
        bits_copy(data, d->outputs[i].bit, rx, 8u * d->outputs[i].offset, d->outputs[i].bits);
}

static void begin(uint8_t *frame)
{
    memset(frame, 0xFF, 6);
    memset(frame + 6, 0x10, 6);
    frame[12] = 0x88;
    frame[13] = 0xA4;
}

/* `last`: where the last datagram begins; no more follow it. */
static int32_t finish(uint8_t *frame, uint32_t last, uint32_t end)
{
    put16(frame + last + 6, (uint16_t)(get16(frame + last + 6) & ~MORE));
    put16(frame + ETHERNET, (uint16_t)((end - FIRST) | 0x1000));
    if (end >= SHORTEST)
        return (int32_t)end;
    memset(frame + end, 0, SHORTEST - end);
    return SHORTEST;
}

static uint32_t station_of(const sj_bus *bus, int32_t drive)
{
    return bus->count ? bus->drive[drive].station : 0u;
}

static void compose(sj_bus *bus, int32_t number)
{
    sj_bus_flight *flight = &bus->flight[number];
    uint8_t *frame = flight->bytes;
    const uint8_t index = (uint8_t)(OWN | (bus->index & (OWN - 1)));
    uint32_t at = FIRST, last = FIRST;
    begin(frame);
    if (number == 0) {
        const uint32_t clock = (uint32_t)REG_SYSTEM_TIME << 16,
                       state = (uint32_t)REG_AL_STATUS << 16;
        at = put(frame, at, bus->reference ? FRMW : 0, index, clock | bus->reference, CLOCK_BYTES);
        at = put(frame, at, BRD, index, state, BROAD_BYTES);
        last = at;
        at = put(frame, at, FPRD, index, state | station_of(bus, bus->turn), STATE_BYTES);
    }
    if (bus->together) {
        last = at;
        at = put(frame, at, LRW, index, bus->drive[0].logical, span(bus));
    }
    for (int i = 0; i < bus->count; i++) {
        const sj_bus_drive *d = &bus->drive[i];
        if (bus->together) {
            put_outputs(bus, d, data_at(frame, last) + (d->logical - bus->drive[0].logical));
            continue;
        }
        if (d->frame != number)
            continue;
        last = at;
        at = put(frame, at, LRW, index, d->logical, data_bytes(d));
        put_outputs(bus, d, data_at(frame, last));
    }
    flight->length = finish(frame, last, at);
    flight->answered = 0;
}

void sj_bus_compose(sj_bus *bus, int64_t sent_ns, int64_t deadline_ns)
{
    bus->turn = bus->count ? (bus->turn + 1) % bus->count : 0;
    for (int32_t i = 0; i < bus->frames; i++) {
        bus->index++;
        compose(bus, i);
    }
    bus->told.sent += (uint64_t)bus->frames;
    bus->sent_ns = sent_ns;
    bus->deadline_ns = deadline_ns;
}

/* ---- taking apart ---- */

/* Whether a frame is what became of another: the same datagrams, passed on by a device. A broadcast's
 * address counts the devices. */
static int answers(const uint8_t *frame, const uint8_t *sent, int32_t length)
{
    uint32_t more = MORE, at = FIRST;
    if (!(frame[6] & 2) || memcmp(frame + 12, sent + 12, FIRST - 12) != 0)
        return 0;
    while (more) {
        const uint32_t count = get16(sent + at + 6) & 0x7FF;
        more = get16(sent + at + 6) & MORE;
        if (at + HEADER + count + COUNTER > (uint32_t)length || frame[at] != sent[at] ||
            frame[at + 1] != sent[at + 1] || memcmp(frame + at + 4, sent + at + 4, 4) != 0)
            return 0;
        if (frame[at] != BRD && memcmp(frame + at + 2, sent + at + 2, 2) != 0)
            return 0;
        at += HEADER + count + COUNTER;
    }
    return 1;
}

static void take_clock(sj_bus *bus, const uint8_t *data)
{
    const int64_t now = plus(bus->clock_ns, minus(bus->sent_ns, bus->clock_sent_ns));
    const uint32_t low = get32(data), expected = (uint32_t)(uint64_t)now;
    bus->clock_ns = bus->wide ? get64(data) : plus(now, (int32_t)(low - expected));
    bus->clock_sent_ns = bus->sent_ns;
    bus->clock_came = 1;
}

static void take_front(sj_bus *bus, const uint8_t *frame)
{
    const uint8_t *clock = frame + FIRST + HEADER;
    const uint8_t *broad = clock + CLOCK_BYTES + COUNTER + HEADER;
    const uint8_t *state = broad + BROAD_BYTES + COUNTER + HEADER;
    if (bus->reference && get16(clock + CLOCK_BYTES) != 0)
        take_clock(bus, clock);
    bus->told.states = get16(broad);
    bus->told.present = get16(broad + BROAD_BYTES);
    if (bus->count == 0 || get16(state + STATE_BYTES) != 1)
        return;
    bus->drive[bus->turn].told.state = get16(state);
    bus->drive[bus->turn].told.code = get16(state + 4);
    bus->drive[bus->turn].been_up |= get16(state) == AL_OP;
}

static void take_inputs(sj_bus *bus, sj_bus_drive *d, const uint8_t *data, uint32_t expected,
                        uint16_t counter)
{
    uint8_t *tx = (uint8_t *)&bus->kernel->tx[d->axis];
    d->told.counter = counter;
    if (counter != expected) {
        d->told.wrong++;
        return;
    }
    for (int i = 0; i < d->in_words; i++)
        bits_copy(tx, 8u * d->inputs[i].offset, data, d->inputs[i].bit, d->inputs[i].bits);
    d->told.in_row = -1; /* it has answered; settled below */
}

int32_t sj_bus_accept(sj_bus *bus, const uint8_t *frame, int32_t length)
{
    for (int32_t i = 0; i < bus->frames; i++) {
        sj_bus_flight *flight = &bus->flight[i];
        uint32_t at = i == 0 ? FIRST + FRONT : FIRST;
        if (flight->length == 0 || flight->answered || length < flight->length ||
            !answers(frame, flight->bytes, length))
            continue;
        flight->answered = 1;
        if (i == 0)
            take_front(bus, frame);
        for (int k = 0; k < bus->count; k++) {
            sj_bus_drive *d = &bus->drive[k];
            const uint8_t *data = frame + at + HEADER;
            if (bus->together) {
                take_inputs(bus, d, data + (d->logical - bus->drive[0].logical),
                            (uint32_t)bus->count * d->expected, get16(data + span(bus)));
            } else if (d->frame == i) {
                take_inputs(bus, d, data, d->expected, get16(data + data_bytes(d)));
                at += HEADER + data_bytes(d) + COUNTER;
            }
        }
        return 1;
    }
    bus->told.stray++;
    return 0;
}

/* ---- the clock ---- */

static int64_t within(int64_t x, int64_t limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

static int64_t align(sj_bus *bus)
{
    const int64_t T = bus->period_ns;
    const int64_t late = bus->raw ? 0 : minus(bus->sent_ns, bus->deadline_ns);
    int64_t e = minus(minus(bus->clock_ns, late), bus->phase_ns) % T, size;
    if (e > T / 2)
        e -= T;
    else if (e <= -(T - T / 2))
        e += T;
    size = e < 0 ? -e : e;
    bus->told.phase_ns = e;
    bus->good = size > T / NEAR ? 0 : bus->good + (bus->good < LONG_ENOUGH);
    bus->told.aligned |= bus->good >= LONG_ENOUGH;
    if (bus->told.aligned) {
        sj_histogram_add(&bus->phase, (uint64_t)size);
        if (size > bus->told.worst_ns)
            bus->told.worst_ns = size;
    }
    e = within(e, T / CLAMP);
    bus->integral_ns = within(bus->integral_ns + e, 2 * T); /* 1000 ppm */
    return -e / PROPORTIONAL - bus->integral_ns / INTEGRAL;
}

int64_t sj_bus_settle(sj_bus *bus)
{
    if (bus->flight[0].length == 0)
        return 0; /* nothing has been sent yet */
    for (int32_t i = 0; i < bus->frames; i++)
        bus->told.lost += !bus->flight[i].answered;
    for (int k = 0; k < bus->count; k++) {
        sj_bus_drive *d = &bus->drive[k];
        const int missed = d->told.in_row >= 0;
        d->told.lost += (uint64_t)missed;
        d->told.in_row = missed ? d->told.in_row + (d->told.in_row < INT32_MAX) : 0;
        if (d->told.in_row >= bus->lost)
            d->told.state = 0; /* what it was last is no news of it */
        bus->kernel->stale[d->axis] =
            d->been_up && (d->told.in_row >= bus->lost || d->told.state != AL_OP);
    }
    for (int32_t i = 0; i < bus->frames; i++)
        bus->flight[i].length = 0;
    if (bus->flight[0].answered == 0)
        bus->told.present = 0;
    bus->told.correction_ns = bus->clock_came ? align(bus) : -bus->integral_ns / INTEGRAL;
    bus->clock_came = 0;
    return bus->told.correction_ns;
}

void sj_bus_state(const sj_bus *bus, sj_feedback *feedback)
{
    feedback->bus = bus->told;
    feedback->bus.devices = bus->count;
    for (int k = 0; k < bus->count; k++) {
        sj_axis_bus *out = &feedback->axis[bus->drive[k].axis].bus;
        *out = bus->drive[k].told;
        out->present = 1;
    }
}
