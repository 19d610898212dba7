/* The distributed clock of an emulated EtherCAT subdevice controller, and what is due in time.
 *
 * Local time runs with the device's own oscillator: `boot` and `drift`. System time is local time plus
 * the offset 0920h plus what the control loop added. The loop compares system time less the delay 0928h
 * with the time of the reference clock that a frame writes to 0910h, and turns offset and rate.
 * SYNC0 and SYNC1 come at their own system times, whenever the emulator wakes up: sj_line_advance()
 * does everything up to `now` in its order, a frame that came later is served afterwards.
 *
 * Never here: frames, the drive.
 */
#include <stddef.h>
#include <stdint.h>
#include "ports/ethercat/_esc.h"
#include "ports/ethercat/_words.h"

enum {
    SYNC_SHORTEST = 50000,   /* ns; a shorter SYNC0 cycle is ignored */
    LOOP_STEP = 4096,        /* ns; most of a deviation that one step of the loop sees */
    LOOP_SHARE = 4,          /* this part of it at once */
    FILTER = 16,             /* depth of 092Ch */
    SKIP = 100,              /* periods behind: the clock was set, not late */
    SILENCE = 10,            /* periods without outputs: the local clock goes on */
    LONGEST_SLEEP = 50000000 /* ns */
};
#define LOOP_RATE       2e-10 /* of a deviation in ns, per step, into the rate */
#define LOOP_DAMPING    0.05  /* most that one step's rate may add until the next */
#define DEVIATION_LEAST 1e-6  /* ns; less is none */
#define RATE_LIMIT      1e-3  /* no oscillator is that far off */

static int64_t local_time(const sj_esc *esc, int64_t now)
{
    const int64_t run = minus(now, esc->boot_ns), second = 1000000000;
    const int64_t drift = run / second * esc->drift_ppb + run % second * esc->drift_ppb / second;
    return plus(run, drift);
}

static int64_t loop_time(const sj_esc *esc, int64_t now)
{
    return plus(esc->trim_ns, (int64_t)((double)minus(now, esc->trimmed_ns) * esc->rate));
}

static int wide(const sj_esc *esc) { return (esc->memory[8] & DC_64_BITS) != 0; }

int64_t sj_esc_system_time(const sj_esc *esc, int64_t now)
{
    const int64_t time =
        plus(plus(local_time(esc, now), get64(esc->memory + REG_OFFSET)), loop_time(esc, now));
    return wide(esc) ? time : (int64_t)((uint64_t)time & 0xFFFFFFFF);
}

/* From a to b; in a 32-bit clock the shorter way round. */
static int64_t gap(const sj_esc *esc, int64_t a, int64_t b)
{
    if (wide(esc))
        return minus(b, a);
    return (int32_t)((uint32_t)(uint64_t)b - (uint32_t)(uint64_t)a);
}

void sj_esc_latch(sj_line *line, sj_esc *esc, int64_t now)
{
    const int32_t self = (int32_t)(esc - line->devices), last = line->cut - 1;
    const int64_t here = local_time(esc, now);
    const int64_t back = local_time(esc, plus(now, 2 * (int64_t)(last - self) * line->hop_ns));
    put32(esc->memory + REG_PORT_TIME, (uint32_t)(uint64_t)here);
    if (self < last)
        put32(esc->memory + REG_PORT_TIME + 4, (uint32_t)(uint64_t)back);
    put64(esc->memory + REG_RECEIVE_TIME, here);
}

void sj_esc_reset_loop(sj_esc *esc)
{
    esc->deviation_ns = 0.0;
    put32(esc->memory + REG_DEVIATION, 0);
}

void sj_esc_follow_clock(sj_esc *esc, const uint8_t *data, uint32_t count, int64_t now)
{
    const int64_t mine = minus(sj_esc_system_time(esc, now), get32(esc->memory + REG_DELAY));
    const int64_t off = count >= 8 && wide(esc) ? minus(mine, get64(data))
                                                : (int32_t)((uint32_t)(uint64_t)mine - get32(data));
    const int64_t step = off > LOOP_STEP ? LOOP_STEP : off < -LOOP_STEP ? -LOOP_STEP : off;
    const double since = (double)minus(now, esc->trimmed_ns);
    double turn = LOOP_RATE;
    if (since > 0.0 && turn * since > LOOP_DAMPING)
        turn = LOOP_DAMPING / since;
    esc->trim_ns = minus(loop_time(esc, now), step / LOOP_SHARE);
    esc->trimmed_ns = now;
    esc->rate -= (double)step * turn;
    if (esc->rate > RATE_LIMIT || esc->rate < -RATE_LIMIT)
        esc->rate = 0.0;
    esc->deviation_ns += ((double)off - esc->deviation_ns) / FILTER;
    double size = esc->deviation_ns < 0.0 ? -esc->deviation_ns : esc->deviation_ns;
    if (size < DEVIATION_LEAST)
        esc->deviation_ns = size = 0.0; /* no subnormal numbers: slow */
    if (size > 2147483647.0)
        size = 2147483647.0;
    put32(esc->memory + REG_DEVIATION,
          (uint32_t)size | (esc->deviation_ns > 0.0 ? 0x80000000u : 0u));
}

/* The period of the event that counts, and its way after SYNC0. SYNC1 comes with every SYNC0, later by
 * 09A4h; a 09A4h of n SYNC0 cycles or more skips n of them. */
static int64_t sync_period(const sj_esc *esc, int64_t *after)
{
    const int64_t sync0 = get32(esc->memory + REG_SYNC0_CYCLE);
    const int64_t sync1 = get32(esc->memory + REG_SYNC1_CYCLE);
    *after = 0;
    if (sync0 < SYNC_SHORTEST)
        return 0;
    if (!esc->sync1_counts || !(esc->memory[REG_SYNC_ACTIVATION] & 4))
        return sync0;
    *after = sync1 % sync0;
    return (sync1 / sync0 + 1) * sync0;
}

void sj_esc_start_sync(sj_esc *esc, int64_t now)
{
    int64_t after, first = get64(esc->memory + REG_SYNC_START);
    const int64_t time = sj_esc_system_time(esc, now), far = INT64_C(1) << 60;
    esc->sync_period_ns = 0;
    if ((esc->memory[REG_SYNC_ACTIVATION] & 3) != 3)
        return;
    const int64_t period = sync_period(esc, &after);
    int64_t late = gap(esc, first, time);
    if (period == 0)
        return;
    if (late > far || late < -far) { /* a start that is no time */
        first = time;
        late = 0;
    }
    if (late >= 0)
        first = plus(first, (late / period + 1) * period);
    esc->sync_period_ns = period;
    esc->sync_next_ns = plus(first, after);
}

static void sync_events(sj_esc *esc, int64_t now)
{
    const int state = esc->memory[REG_AL_STATUS] & 15;
    const int64_t period = esc->sync_period_ns;
    if (period == 0 || state < AL_PREOP)
        return;
    const int64_t time = sj_esc_system_time(esc, now);
    int64_t late = gap(esc, esc->sync_next_ns, time);
    if (late > SKIP * period) {
        esc->sync_next_ns = plus(esc->sync_next_ns, late / period * period);
        late = gap(esc, esc->sync_next_ns, time);
    }
    for (; late >= 0; late -= period) {
        esc->sync_next_ns = plus(esc->sync_next_ns, period);
        esc->syncs++;
        if (esc->sync_source >= SJ_SYNC_DC0 && state >= AL_SAFEOP) {
            const int missed = esc->applied && !esc->fresh;
            esc->syncs_missed += (uint64_t)missed;
            sj_esc_period(esc, missed);
        }
    }
    put64(esc->memory + REG_SYNC_START, esc->sync_next_ns);
}

/* Whether the drive's periods come from the local clock now. */
static int free_running(const sj_esc *esc, int64_t now)
{
    if (esc->sync_source == SJ_SYNC_FREE || (esc->memory[REG_AL_STATUS] & 15) < AL_SAFEOP)
        return 1;
    return esc->sync_source == SJ_SYNC_SM && minus(now, esc->output_ns) > SILENCE * esc->period_ns;
}

static void local_events(sj_esc *esc, int64_t now)
{
    if (esc->period_ns <= 0 || !free_running(esc, now))
        return;
    if (minus(now, esc->period_next_ns) > SKIP * esc->period_ns)
        esc->period_next_ns = now;
    while (minus(now, esc->period_next_ns) >= 0) {
        sj_esc_period(esc, 0);
        esc->period_next_ns = plus(esc->period_next_ns, esc->period_ns);
    }
}

static int64_t watchdog_ns(const sj_esc *esc)
{
    const int64_t unit = (get16(esc->memory + REG_WATCHDOG_DIVIDER) + 2) * INT64_C(40);
    return unit * get16(esc->memory + REG_WATCHDOG_SM);
}

/* SM2 triggers it (control bit 6), it counts in OP. */
static int watched(const sj_esc *esc)
{
    return (esc->memory[REG_SM + 8 * 2 + 4] & 0x40) && esc->outputs.bytes &&
           (esc->memory[REG_AL_STATUS] & 15) == AL_OP && (esc->memory[REG_WATCHDOG_STATUS] & 1) &&
           watchdog_ns(esc) > 0;
}

static void watchdog(sj_esc *esc, int64_t now)
{
    if (!watched(esc) || minus(now, esc->output_ns) <= watchdog_ns(esc))
        return;
    esc->memory[REG_WATCHDOG_STATUS] &= 0xFE;
    if (esc->memory[REG_WATCHDOG_COUNT] < 255)
        esc->memory[REG_WATCHDOG_COUNT]++;
    esc->events |= SJ_ESC_WATCHDOG;
}

void sj_line_advance(sj_line *line, int64_t now)
{
    for (int i = 0; i < line->count; i++) {
        sj_esc *esc = line->devices + i;
        if (esc->silent)
            continue;
        sync_events(esc, now);
        local_events(esc, now);
        watchdog(esc, now);
    }
}

static int64_t earlier(int64_t a, int64_t b) { return a < b ? a : b; }

int64_t sj_line_due(const sj_line *line, int64_t now)
{
    int64_t wait = LONGEST_SLEEP;
    for (int i = 0; i < line->count; i++) {
        const sj_esc *esc = line->devices + i;
        if (esc->silent)
            continue;
        if (esc->sync_period_ns && (esc->memory[REG_AL_STATUS] & 15) >= AL_PREOP)
            wait = earlier(wait, gap(esc, sj_esc_system_time(esc, now), esc->sync_next_ns));
        if (esc->period_ns > 0 && free_running(esc, now))
            wait = earlier(wait, minus(esc->period_next_ns, now));
        else if (esc->sync_source == SJ_SYNC_SM)
            wait = earlier(wait, minus(esc->output_ns, now) + SILENCE * esc->period_ns + 1);
        if (watched(esc))
            wait = earlier(wait, minus(esc->output_ns, now) + watchdog_ns(esc) + 1);
    }
    return plus(now, wait < 0 ? 0 : wait);
}

int32_t sj_line_pass(sj_line *line, int64_t *now, int64_t end, int32_t single)
{
    do {
        const int64_t due = sj_line_due(line, *now);
        if (due > *now)
            *now = earlier(due, end);
        sj_line_advance(line, *now);
        for (int i = 0; i < line->count; i++)
            if (line->devices[i].events)
                return 1;
    } while (*now < end && !single);
    return 0;
}
