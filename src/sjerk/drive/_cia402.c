/* The CiA 402 device control: faults by name and the state machine, transitions 0-16 of
 * IEC 61800-7-201. Pure: a state and what it decides upon in, a state out.
 * Never here: motions, positions, clocks, the motor.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

/* ---- faults by name ---- */

/* bits of 1001h */
enum {
    GENERIC = 1,
    CURRENT = 2,
    VOLTAGE = 4,
    TEMPERATURE = 8,
    COMMUNICATION = 16,
    PROFILE = 32,
    MAKER = 128
};
static const sj_drive_fault_row FAULTS[SJ_FAULTS] = {
    [SJ_FAULT_NONE] = {0x0000, 0, SJ_FAULT_RAMPS},
    [SJ_FAULT_OVER_CURRENT] = {0x2310, GENERIC | CURRENT, SJ_FAULT_COASTS},
    [SJ_FAULT_EARTH] = {0x2330, GENERIC | CURRENT, SJ_FAULT_COASTS},
    [SJ_FAULT_OVER_VOLTAGE] = {0x3210, GENERIC | VOLTAGE, SJ_FAULT_COASTS},
    [SJ_FAULT_UNDER_VOLTAGE] = {0x3220, GENERIC | VOLTAGE, SJ_FAULT_COASTS},
    [SJ_FAULT_OVER_TEMPERATURE] = {0x4310, GENERIC | TEMPERATURE, SJ_FAULT_RAMPS},
    [SJ_FAULT_ENCODER] = {0x7305, GENERIC | PROFILE, SJ_FAULT_COASTS},
    [SJ_FAULT_SAFE_TORQUE_OFF] = {0xFF80, GENERIC | MAKER, SJ_FAULT_COASTS},
    [SJ_FAULT_BRAKE] = {0x7110, GENERIC | PROFILE, SJ_FAULT_RAMPS},
    [SJ_FAULT_LOST_LINK] = {0x8130, GENERIC | COMMUNICATION, SJ_FAULT_RAMPS},
    [SJ_FAULT_RPDO_TIMEOUT] = {0x8250, GENERIC | COMMUNICATION, SJ_FAULT_RAMPS},
    [SJ_FAULT_OVER_SPEED] = {0x8400, GENERIC | PROFILE, SJ_FAULT_RAMPS},
    [SJ_FAULT_FOLLOWING_ERROR] = {0x8611, GENERIC | PROFILE, SJ_FAULT_RAMPS},
    [SJ_FAULT_REFERENCE_LIMIT] = {0x8612, GENERIC | PROFILE, SJ_FAULT_RAMPS},
    [SJ_FAULT_SYNC] = {0x8700, GENERIC | COMMUNICATION, SJ_FAULT_RAMPS},
};

uint16_t sj_drive_fault_code(int32_t fault)
{
    return fault >= 0 && fault < SJ_FAULTS ? FAULTS[fault].code : 0;
}

const sj_drive_fault_row *sj_drive_fault(int32_t fault) { return &FAULTS[fault]; }

/* ---- the state machine ---- */

enum { DISABLE_VOLTAGE, QUICK_STOP, SHUTDOWN, SWITCH_ON, ENABLE_OPERATION };

/* The command in bits 3, 2, 1, 0; SWITCH_ON is Disable operation when operation is enabled.
 * Bit 7 acts by its edge in Fault alone: a master may leave it set and still command. */
static int command_of(uint16_t word)
{
    if (!(word & SJ_CW_ENABLE_VOLTAGE)) {
        return DISABLE_VOLTAGE;
    }
    if (!(word & SJ_CW_QUICK_STOP)) {
        return QUICK_STOP;
    }
    if (!(word & SJ_CW_SWITCH_ON)) {
        return SHUTDOWN;
    }
    return word & SJ_CW_ENABLE_OPERATION ? ENABLE_OPERATION : SWITCH_ON;
}

static int32_t take(uint32_t *transitions, int32_t number, int32_t state)
{
    *transitions |= (uint32_t)1 << number;
    return state;
}

int32_t sj_drive_next(int32_t state, const sj_drive_input *in, uint32_t *ran)
{
    const int command = command_of(in->controlword);
    const int reset = (in->controlword & ~in->previous & SJ_CW_FAULT_RESET) != 0;

    *ran = 0;
    if (in->fault && state != SJ_STATE_FAULT_REACTION && state != SJ_STATE_FAULT) {
        return take(ran, 13, SJ_STATE_FAULT_REACTION);
    }
    switch (state) {
    case SJ_STATE_NOT_READY: return take(ran, 1, SJ_STATE_SWITCH_ON_DISABLED);

    case SJ_STATE_SWITCH_ON_DISABLED:
        if (command == SHUTDOWN && in->power) {
            return take(ran, 2, SJ_STATE_READY);
        }
        return state;

    case SJ_STATE_READY:
        switch (command) {
        case DISABLE_VOLTAGE:
        case QUICK_STOP: return take(ran, 7, SJ_STATE_SWITCH_ON_DISABLED);
        case SWITCH_ON: return take(ran, 3, SJ_STATE_SWITCHED_ON);
        case ENABLE_OPERATION:
            (void)take(ran, 3, SJ_STATE_SWITCHED_ON);
            return take(ran, 4, SJ_STATE_OPERATION_ENABLED);
        default: return state;
        }

    case SJ_STATE_SWITCHED_ON:
        switch (command) {
        case DISABLE_VOLTAGE:
        case QUICK_STOP: return take(ran, 10, SJ_STATE_SWITCH_ON_DISABLED);
        case SHUTDOWN: return take(ran, 6, SJ_STATE_READY);
        case ENABLE_OPERATION: return take(ran, 4, SJ_STATE_OPERATION_ENABLED);
        default: return state;
        }

    case SJ_STATE_OPERATION_ENABLED:
        switch (command) {
        case DISABLE_VOLTAGE: return take(ran, 9, SJ_STATE_SWITCH_ON_DISABLED);
        case QUICK_STOP: return take(ran, 11, SJ_STATE_QUICK_STOP);
        case SHUTDOWN: /* with a ramp first, the state changes when the motor stands */
            return in->shutdown_option == 1 && !in->standing ? state : take(ran, 8, SJ_STATE_READY);
        case SWITCH_ON:
            return in->disable_option == 1 && !in->standing ? state
                                                            : take(ran, 5, SJ_STATE_SWITCHED_ON);
        default: return state;
        }

    case SJ_STATE_QUICK_STOP:
        if (command == DISABLE_VOLTAGE) {
            return take(ran, 12, SJ_STATE_SWITCH_ON_DISABLED);
        }
        if (in->quick_stop_option >= 5) {
            return command == ENABLE_OPERATION ? take(ran, 16, SJ_STATE_OPERATION_ENABLED) : state;
        }
        return in->standing || in->quick_stop_option == 0
                   ? take(ran, 12, SJ_STATE_SWITCH_ON_DISABLED)
                   : state;

    case SJ_STATE_FAULT_REACTION: return in->standing ? take(ran, 14, SJ_STATE_FAULT) : state;

    case SJ_STATE_FAULT:
        return reset && !in->cause ? take(ran, 15, SJ_STATE_SWITCH_ON_DISABLED) : state;

    default: return state;
    }
}

uint16_t sj_drive_state_bits(int32_t state)
{
    switch (state) {
    case SJ_STATE_SWITCH_ON_DISABLED: return SJ_SW_DISABLED;
    case SJ_STATE_READY: return SJ_SW_READY | SJ_SW_QUICK_STOP;
    case SJ_STATE_SWITCHED_ON: return SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_QUICK_STOP;
    case SJ_STATE_OPERATION_ENABLED:
        return SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_OPERATION_ENABLED | SJ_SW_QUICK_STOP;
    case SJ_STATE_QUICK_STOP: return SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_OPERATION_ENABLED;
    case SJ_STATE_FAULT_REACTION:
        return SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_OPERATION_ENABLED | SJ_SW_FAULT;
    case SJ_STATE_FAULT: return SJ_SW_FAULT;
    default: return 0;
    }
}
