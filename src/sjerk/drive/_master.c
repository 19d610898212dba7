/* The master's side of CiA 402: the controlword that leads a drive where one wants it, one step at a
 * time, and what its statusword says. Pure; the drive's side is _cia402.c.
 */
#include <stdint.h>
#include "drive/_words.h"

enum {
    SHUTDOWN = SJ_CW_ENABLE_VOLTAGE | SJ_CW_QUICK_STOP,
    SWITCH_ON = SHUTDOWN | SJ_CW_SWITCH_ON,
    ENABLE = SWITCH_ON | SJ_CW_ENABLE_OPERATION,
    STATE_BITS = SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_OPERATION_ENABLED | SJ_SW_FAULT |
        SJ_SW_QUICK_STOP | SJ_SW_DISABLED
};

static int is_in(uint16_t statusword, int32_t state)
{
    return (statusword & STATE_BITS) == sj_drive_state_bits(state);
}

int32_t sj_master_enabled(uint16_t statusword)
{
    return is_in(statusword, SJ_STATE_OPERATION_ENABLED);
}

static int follows(uint16_t statusword)
{
    return sj_master_enabled(statusword) && (statusword & SJ_SW_FOLLOWS) != 0;
}

int32_t sj_master_fault(uint16_t statusword) { return (statusword & SJ_SW_FAULT) != 0; }

/* 81xxh: communication (8130h the link), 8250h: no process data, 87xxh: synchronisation. */
int32_t sj_master_lost(uint16_t error_code)
{
    return (error_code & 0xFF00) == 0x8100 || error_code == 0x8250 ||
           (error_code & 0xFF00) == 0x8700;
}

/* Transitions 2, 3, 4 upwards, 5 and 6 downwards; 15 by the rising edge of `reset`. */
uint16_t sj_master_controlword(uint16_t statusword, int32_t enable, int32_t reset)
{
    if (sj_master_fault(statusword))
        return reset ? SJ_CW_FAULT_RESET : 0;
    if (!enable)
        return is_in(statusword, SJ_STATE_OPERATION_ENABLED) ? SWITCH_ON : SHUTDOWN;
    if (is_in(statusword, SJ_STATE_READY))
        return SWITCH_ON;
    if (is_in(statusword, SJ_STATE_SWITCHED_ON) || is_in(statusword, SJ_STATE_OPERATION_ENABLED))
        return ENABLE;
    return SHUTDOWN;
}

int32_t sj_master_bridging(const sj_drive_tx *tx)
{
    return sj_master_enabled(tx->statusword) && (tx->statusword & SJ_SW_LIMIT) == 0 &&
           (tx->mode_display == SJ_MODE_CSP || tx->mode_display == SJ_MODE_NONE);
}

int32_t sj_master_stopping(uint16_t statusword) { return is_in(statusword, SJ_STATE_QUICK_STOP); }

/* A master that does not map 6061h reads a zero: then the statusword has to do. */
int32_t sj_master_follows_position(const sj_drive_tx *tx)
{
    return follows(tx->statusword) &&
           (tx->mode_display == SJ_MODE_CSP || tx->mode_display == SJ_MODE_NONE);
}

uint32_t sj_master_switches(const sj_drive_tx *tx)
{
    return tx->digital_inputs & (SJ_DI_NEGATIVE | SJ_DI_POSITIVE);
}

int32_t sj_master_homing(const sj_drive_tx *tx)
{
    if (tx->mode_display != SJ_MODE_HOMING || !sj_master_enabled(tx->statusword))
        return 0;
    if (tx->statusword & SJ_SW_FOLLOWING_ERROR)
        return -1;
    return (tx->statusword & SJ_SW_FOLLOWS) && (tx->statusword & SJ_SW_TARGET_REACHED) ? 1 : 0;
}
