/* The memory of an emulated EtherCAT subdevice controller: registers, SyncManagers, SII.
 *
 * Registers: which can be written, and what a write sets off. SyncManagers: mailboxes (SM0, SM1) that
 * are full or empty; process data (SM2, SM3) in three buffers, so that half a write is never seen. A
 * register block of a SyncManager can only be written while it is not active.
 *
 * Never here: frames, clocks, what a mail means, the states of the application layer.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include "ports/ethercat/_esc.h"
#include "ports/ethercat/_words.h"

enum {
    SM_MAILBOX = 2,
    SM_MODE = 3, /* control, bits 0-1 */
    SM_WRITTEN = 4,
    SM_DIRECTION = 12, /* control, bits 2-3: by the main device */
    SM_FULL = 8,       /* status */
    SM_ACTIVE = 1,
    SM_REPEAT = 2, /* activate */
    SM_CLOSED = 1, /* PDI control */
    SII_READ = 1,
    SII_WRITE = 2,
    SII_RELOAD = 4
};

void sj_esc_init(sj_esc *esc)
{
    memset(esc->memory, 0, sizeof esc->memory);
    for (int k = 2; k < SM_COUNT; k++)
        esc->memory[REG_SM + 8 * k + 7] = SM_CLOSED;
    esc->outputs.bytes = esc->inputs.bytes = 0;
    esc->outputs.words = esc->inputs.words = 0;
    esc->events = 0;
    sj_esc_open(esc, 0);
}

static void reset_buffers(sj_esc_buffers *buffers)
{
    memset(buffers->data, 0, sizeof buffers->data);
    buffers->wire = 0;
    buffers->newest = 1;
    buffers->application = 2;
    buffers->fresh = 0;
}

void sj_esc_open(sj_esc *esc, int32_t opened)
{
    reset_buffers(&esc->outputs.buffers);
    reset_buffers(&esc->inputs.buffers);
    for (int k = 2; k < 4; k++)
        esc->memory[REG_SM + 8 * k + 7] = opened ? 0 : SM_CLOSED;
}

static void put_masked(uint8_t *to, const uint8_t *from, const uint8_t *mask, uint32_t count)
{
    if (mask == NULL)
        memcpy(to, from, count);
    else
        for (uint32_t i = 0; i < count; i++)
            to[i] = (uint8_t)((to[i] & ~mask[i]) | (from[i] & mask[i]));
}

/* The active SyncManager that the bytes touch, -1 none. */
static int manager_of(const sj_esc *esc, uint32_t address, uint32_t count)
{
    for (int k = 0; k < SM_COUNT; k++) {
        const uint8_t *sm = esc->memory + REG_SM + 8 * k;
        const uint32_t start = get16(sm), length = get16(sm + 2);
        if ((sm[6] & SM_ACTIVE) && length && address < start + length && address + count > start)
            return k;
    }
    return -1;
}

/* Whether a SyncManager is the one through which the device exchanges this process data. */
static int carries(const sj_esc_process *process, const uint8_t *sm)
{
    return process->bytes && get16(sm) == process->start && get16(sm + 2) == process->bytes;
}

static int read_managed(sj_esc *esc, int k, uint32_t address, uint8_t *data, uint32_t count)
{
    uint8_t *sm = esc->memory + REG_SM + 8 * k;
    const uint32_t start = get16(sm), length = get16(sm + 2), from = address - start;
    if ((sm[4] & SM_DIRECTION) != 0 || (sm[7] & SM_CLOSED))
        return 0;
    if (address < start || address + count > start + length)
        return 0;
    if ((sm[4] & SM_MODE) == SM_MAILBOX) {
        if (!(sm[5] & SM_FULL) || start + length > SJ_ESC_MEMORY)
            return 0;
        memcpy(data, esc->memory + address, count);
        if (from + count == length) {
            sm[5] = (uint8_t)((sm[5] & ~SM_FULL) | 2);
            esc->events |= SJ_ESC_MAIL_READ;
        }
        return 1;
    }
    if (k != 3 || !carries(&esc->inputs, sm))
        return 0;
    sj_esc_buffers *b = &esc->inputs.buffers;
    if (from == 0 && b->fresh) {
        const uint8_t taken = b->newest;
        b->newest = b->wire;
        b->wire = taken;
        b->fresh = 0;
    }
    memcpy(data, b->data[b->wire] + from, count);
    return 1;
}

/* Registers or process RAM, never both in one access. */
static int possible(uint32_t address, uint32_t count)
{
    if (count == 0 || address + count > SJ_ESC_MEMORY)
        return 0;
    return address >= SJ_ESC_RAM || address + count <= SJ_ESC_RAM;
}

int32_t sj_esc_read(sj_esc *esc, uint32_t address, uint8_t *data, uint32_t count, int64_t now)
{
    if (!possible(address, count))
        return 0;
    if (address >= SJ_ESC_RAM) {
        const int k = manager_of(esc, address, count);
        if (k >= 0)
            return read_managed(esc, k, address, data, count);
    } else if (address < REG_SYSTEM_TIME + 8 && address + count > REG_SYSTEM_TIME)
        put64(esc->memory + REG_SYSTEM_TIME, sj_esc_system_time(esc, now));
    memcpy(data, esc->memory + address, count);
    return 1;
}

static int write_managed(sj_line *line, sj_esc *esc, int k, uint32_t address, const uint8_t *data,
                         const uint8_t *mask, uint32_t count, int64_t now)
{
    uint8_t *sm = esc->memory + REG_SM + 8 * k;
    const uint32_t start = get16(sm), length = get16(sm + 2), from = address - start;
    if ((sm[4] & SM_DIRECTION) != SM_WRITTEN || (sm[7] & SM_CLOSED))
        return 0;
    if (address < start || address + count > start + length)
        return 0;
    const int last = from + count == length && (mask == NULL || mask[count - 1]);
    if ((sm[4] & SM_MODE) == SM_MAILBOX) {
        if ((sm[5] & SM_FULL) || start + length > SJ_ESC_MEMORY)
            return 0;
        put_masked(esc->memory + address, data, mask, count);
        if (last) {
            sm[5] |= SM_FULL | 1;
            esc->events |= SJ_ESC_MAIL;
        }
        return 1;
    }
    if (k != 2 || !carries(&esc->outputs, sm))
        return 0;
    sj_esc_buffers *b = &esc->outputs.buffers;
    put_masked(b->data[b->wire] + from, data, mask, count);
    if (last) {
        const uint8_t filled = b->wire;
        b->wire = b->newest;
        b->newest = filled;
        b->fresh = 1;
        esc->fresh = 1;
        esc->output_ns = now;
        esc->memory[REG_WATCHDOG_STATUS] |= 1;
        if (line->watch_outputs)
            esc->events |= SJ_ESC_OUTPUTS;
        if (esc->sync_source == SJ_SYNC_SM && (esc->memory[REG_AL_STATUS] & 15) >= AL_SAFEOP)
            sj_esc_period(esc, 0);
    }
    return 1;
}

static int within(uint32_t x, uint32_t first, uint32_t end) { return x >= first && x < end; }

/* Registers that only the device itself writes. */
static int fixed(const sj_esc *esc, uint32_t x)
{
    if (x < 0x0010 || within(x, 0x0110, 0x0120) || within(x, 0x0130, 0x0200))
        return 1;
    if (within(x, 0x0210, 0x0300) || within(x, 0x0440, 0x0442) || within(x, 0x0900, 0x0920))
        return 1;
    if (within(x, 0x092C, 0x0930))
        return 1;
    if (within(x, REG_SM, REG_SM + 8 * SM_COUNT)) {
        const uint32_t part = x & 7;
        return part == 5 || part == 7 || (part < 5 && (esc->memory[x - part + 6] & SM_ACTIVE));
    }
    return within(x, REG_SM + 8 * SM_COUNT, 0x0900);
}

/* The command in 0502h: eight bytes of the SII to 0508h, two bytes from there, or the alias anew. */
static void sii(sj_esc *esc)
{
    uint8_t *memory = esc->memory;
    const uint16_t control = get16(memory + REG_SII);
    const unsigned command = control >> 8 & 7;
    const uint64_t at = (uint64_t)get32(memory + REG_SII + 2) * 2;
    uint16_t result = SII_READS_8;
    if (memory[0x0500] & 1)
        result |= SII_REFUSED;
    else if (command == SII_READ) {
        for (uint64_t i = 0; i < 8; i++)
            memory[REG_SII + 6 + i] = at + i < esc->sii_bytes ? esc->sii[at + i] : 0xFF;
    } else if (command == SII_RELOAD) {
        if (esc->sii_bytes >= 10)
            put16(memory + REG_ALIAS, get16(esc->sii + 8));
    } else if (command != SII_WRITE)
        result |= SII_REFUSED;
    else if (!(control & 1))
        result |= SII_NOT_ENABLED;
    else if (at + 2 > esc->sii_bytes)
        result |= SII_REFUSED;
    else {
        memcpy(esc->sii + at, memory + REG_SII + 6, 2);
        esc->events |= SJ_ESC_SII;
    }
    put16(memory + REG_SII, result);
}

static void write_byte(sj_esc *esc, uint32_t x, uint8_t value)
{
    uint8_t *memory = esc->memory;
    if (within(x, REG_SM, REG_SM + 8 * SM_COUNT) && (x & 7) == 6) {
        const uint8_t changed = memory[x] ^ value;
        if (changed & SM_ACTIVE) { /* (de)activated: empty */
            const uint32_t k = (x - REG_SM) / 8;
            memory[x - 1] = 0;
            if (k == 2)
                reset_buffers(&esc->outputs.buffers);
            else if (k == 3)
                reset_buffers(&esc->inputs.buffers);
        }
        if ((changed & SM_REPEAT) && x == REG_SM + 8 + 6)
            esc->events |= SJ_ESC_REPEAT;
    }
    memory[x] = value;
}

static void write_registers(sj_line *line, sj_esc *esc, uint32_t address, const uint8_t *data,
                            const uint8_t *mask, uint32_t count, int64_t now)
{
    uint8_t *memory = esc->memory;
    const uint32_t end = address + count;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t x = address + i;
        const uint8_t value =
            mask ? (uint8_t)((memory[x] & ~mask[i]) | (data[i] & mask[i])) : data[i];
        if (within(x, 0x0300, 0x0314))
            memset(memory + 0x0300, 0, 0x14);
        else if (x == 0x0442 || x == 0x0443)
            memory[x] = 0;
        else if (!fixed(esc, x))
            write_byte(esc, x, value);
    }
    if (within(0x0900, address, end))
        sj_esc_latch(line, esc, now);
    if (within(REG_SYSTEM_TIME, address, end) && end >= REG_SYSTEM_TIME + 4)
        sj_esc_follow_clock(esc, data + (REG_SYSTEM_TIME - address), end - REG_SYSTEM_TIME, now);
    if ((address < 0x0936 && end > 0x0930) || (address < 0x0928 && end > 0x0920))
        sj_esc_reset_loop(esc);
    if (within(REG_AL_CONTROL, address, end))
        esc->events |= SJ_ESC_AL_CONTROL;
    if (within(REG_SII + 1, address, end) && (memory[REG_SII + 1] & 7))
        sii(esc);
    if (within(REG_SYNC_ACTIVATION, address, end))
        sj_esc_start_sync(esc, now);
}

int32_t sj_esc_write(sj_line *line, sj_esc *esc, uint32_t address, const uint8_t *data,
                     const uint8_t *mask, uint32_t count, int64_t now)
{
    if (!possible(address, count))
        return 0;
    if (address < SJ_ESC_RAM) {
        write_registers(line, esc, address, data, mask, count, now);
        return 1;
    }
    const int k = manager_of(esc, address, count);
    if (k >= 0)
        return write_managed(line, esc, k, address, data, mask, count, now);
    put_masked(esc->memory + address, data, mask, count);
    return 1;
}
