/* Registers by name, and numbers as the wire has them: little-endian, at any address. For C only. */
#pragma once
#include <stdint.h>
#include <string.h>

enum {
    REG_STATION = 0x0010,
    REG_ALIAS = 0x0012,
    REG_DL_CONTROL = 0x0100,
    REG_AL_CONTROL = 0x0120,
    REG_AL_STATUS = 0x0130,
    REG_WATCHDOG_DIVIDER = 0x0400,
    REG_WATCHDOG_SM = 0x0420,
    REG_WATCHDOG_STATUS = 0x0440,
    REG_WATCHDOG_COUNT = 0x0442,
    REG_SII = 0x0502,
    REG_FMMU = 0x0600,
    REG_SM = 0x0800,
    REG_PORT_TIME = 0x0900,
    REG_SYSTEM_TIME = 0x0910,
    REG_RECEIVE_TIME = 0x0918,
    REG_OFFSET = 0x0920,
    REG_DELAY = 0x0928,
    REG_DEVIATION = 0x092C,
    REG_SYNC_ACTIVATION = 0x0981,
    REG_SYNC_START = 0x0990,
    REG_SYNC0_CYCLE = 0x09A0,
    REG_SYNC1_CYCLE = 0x09A4,
    SM_COUNT = 8,
    FMMU_COUNT = 8,
    AL_INIT = 1,
    AL_PREOP = 2,
    AL_SAFEOP = 4,
    AL_OP = 8,
    DC_64_BITS = 8, /* 0008h */
    SII_READS_8 = 0x0040,
    SII_REFUSED = 0x2000,
    SII_NOT_ENABLED = 0x4000
};

static inline uint16_t get16(const uint8_t *p) { return (uint16_t)(p[0] | p[1] << 8); }

static inline uint32_t get32(const uint8_t *p)
{
    return (uint32_t)get16(p) | (uint32_t)get16(p + 2) << 16;
}

static inline int64_t get64(const uint8_t *p)
{
    return (int64_t)((uint64_t)get32(p) | (uint64_t)get32(p + 4) << 32);
}

static inline void put16(uint8_t *p, uint16_t value)
{
    p[0] = (uint8_t)(value & 0xFF);
    p[1] = (uint8_t)(value >> 8);
}

static inline void put32(uint8_t *p, uint32_t value)
{
    put16(p, (uint16_t)(value & 0xFFFF));
    put16(p + 2, (uint16_t)(value >> 16));
}

static inline void put64(uint8_t *p, int64_t value)
{
    put32(p, (uint32_t)((uint64_t)value & 0xFFFFFFFF));
    put32(p + 4, (uint32_t)((uint64_t)value >> 32));
}

/* Times come from the wire, any 64 bits: sums and differences are modulo 2^64. */
static inline int64_t plus(int64_t a, int64_t b) { return (int64_t)((uint64_t)a + (uint64_t)b); }
static inline int64_t minus(int64_t a, int64_t b) { return (int64_t)((uint64_t)a - (uint64_t)b); }

/* Any bits of one field to any bits of another. */
static inline void bits_copy(uint8_t *to, uint32_t to_bit, const uint8_t *from, uint32_t from_bit,
                             uint32_t count)
{
    if (((to_bit | from_bit | count) & 7) == 0) {
        memcpy(to + to_bit / 8, from + from_bit / 8, count / 8);
        return;
    }
    for (uint32_t i = 0; i < count; i++, to_bit++, from_bit++) {
        const unsigned bit = 1u << (to_bit & 7);
        const unsigned value = from[from_bit >> 3] >> (from_bit & 7) & 1u ? bit : 0u;
        to[to_bit >> 3] = (uint8_t)((to[to_bit >> 3] & ~bit) | value);
    }
}
