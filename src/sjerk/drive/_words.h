/* The words of CiA 402 (IEC 61800-7-201): states, controlword, statusword, modes, faults, the process
 * image; the state machine, and the master's side of it. Pure: words in, words out.
 *
 * Four hex digits and 'h' name an object. "pu" is the position user unit of 607Ah: one encoder
 * increment unless 6091h/6092h say otherwise. */
#pragma once
#include <stdint.h>

/* states of the device control state machine */
enum {
    SJ_STATE_NOT_READY = 0,
    SJ_STATE_SWITCH_ON_DISABLED = 1,
    SJ_STATE_READY = 2,
    SJ_STATE_SWITCHED_ON = 3,
    SJ_STATE_OPERATION_ENABLED = 4,
    SJ_STATE_QUICK_STOP = 5,
    SJ_STATE_FAULT_REACTION = 6,
    SJ_STATE_FAULT = 7
};

/* controlword 6040h */
enum {
    SJ_CW_SWITCH_ON = 0x0001,
    SJ_CW_ENABLE_VOLTAGE = 0x0002,
    SJ_CW_QUICK_STOP = 0x0004, /* 0 stops */
    SJ_CW_ENABLE_OPERATION = 0x0008,
    SJ_CW_MODE_4 = 0x0010, /* homing: start; mode 7: enable interpolation */
    SJ_CW_MODE_5 = 0x0020,
    SJ_CW_MODE_6 = 0x0040,
    SJ_CW_FAULT_RESET = 0x0080, /* acts on its rising edge */
    SJ_CW_HALT = 0x0100,
    SJ_CW_MODE_9 = 0x0200 /* mode 1: change on set-point */
};

/* statusword 6041h */
enum {
    SJ_SW_READY = 0x0001,
    SJ_SW_SWITCHED_ON = 0x0002,
    SJ_SW_OPERATION_ENABLED = 0x0004,
    SJ_SW_FAULT = 0x0008,
    SJ_SW_VOLTAGE = 0x0010,
    SJ_SW_QUICK_STOP = 0x0020, /* 0 = quick stop active */
    SJ_SW_DISABLED = 0x0040,
    SJ_SW_WARNING = 0x0080,
    SJ_SW_SYNC = 0x0100, /* manufacturer's: the period had its SYNC */
    SJ_SW_REMOTE = 0x0200,
    SJ_SW_TARGET_REACHED = 0x0400,
    SJ_SW_LIMIT = 0x0800,
    SJ_SW_FOLLOWS = 0x1000,        /* CSP, CSV, CST: the drive follows; homing: attained */
    SJ_SW_FOLLOWING_ERROR = 0x2000 /* CSP: following error; homing: error */
};

/* modes of operation 6060h */
enum {
    SJ_MODE_NONE = 0,
    SJ_MODE_PROFILE_POSITION = 1,
    SJ_MODE_PROFILE_VELOCITY = 3,
    SJ_MODE_PROFILE_TORQUE = 4,
    SJ_MODE_HOMING = 6,
    SJ_MODE_INTERPOLATED = 7,
    SJ_MODE_CSP = 8,
    SJ_MODE_CSV = 9,
    SJ_MODE_CST = 10
};

/* digital inputs 60FDh */
enum {
    SJ_DI_NEGATIVE = 1, /* limit switches */
    SJ_DI_POSITIVE = 2,
    SJ_DI_HOME = 4,
    SJ_DI_INTERLOCK = 8,
    SJ_DI_PROBE_1 = 0x10000, /* from 16 on they are the maker's */
    SJ_DI_PROBE_2 = 0x20000
};

/* faults by name; codes and reactions in _cia402.c */
enum {
    SJ_FAULT_NONE = 0,
    SJ_FAULT_OVER_CURRENT = 1,
    SJ_FAULT_EARTH = 2,
    SJ_FAULT_OVER_VOLTAGE = 3,
    SJ_FAULT_UNDER_VOLTAGE = 4,
    SJ_FAULT_OVER_TEMPERATURE = 5,
    SJ_FAULT_ENCODER = 6,
    SJ_FAULT_SAFE_TORQUE_OFF = 7,
    SJ_FAULT_BRAKE = 8,
    SJ_FAULT_LOST_LINK = 9,
    SJ_FAULT_RPDO_TIMEOUT = 10,
    SJ_FAULT_OVER_SPEED = 11,
    SJ_FAULT_FOLLOWING_ERROR = 12,
    SJ_FAULT_REFERENCE_LIMIT = 13,
    SJ_FAULT_SYNC = 14,
    SJ_FAULTS = 15
};

/* what a period brings: the RxPDO */
typedef struct {
    uint16_t controlword;          /* 6040h */
    int8_t mode;                   /* 6060h */
    uint8_t sync_missed;           /* 1: no SYNC, or no fresh targets, in this period */
    int32_t target_position;       /* 607Ah */
    int32_t position_offset;       /* 60B0h */
    int32_t velocity_offset;       /* 60B1h */
    int32_t target_velocity;       /* 60FFh */
    int16_t target_torque;         /* 6071h */
    int16_t torque_offset;         /* 60B2h */
    uint32_t digital_outputs;      /* 60FEh:1; bit 0 closes the brake */
    uint32_t output_mask;          /* 60FEh:2; only these bits count */
    int32_t interpolated_position; /* 60C1h:1 */
    uint16_t probe_function;       /* 60B8h */
    uint16_t pad;
} sj_drive_rx;

/* what the period gives: the TxPDO */
typedef struct {
    uint16_t statusword;       /* 6041h */
    int8_t mode_display;       /* 6061h */
    uint8_t error_register;    /* 1001h */
    int32_t position_actual;   /* 6064h */
    int32_t velocity_actual;   /* 606Ch */
    int16_t torque_actual;     /* 6077h */
    uint16_t error_code;       /* 603Fh */
    int32_t following_error;   /* 60F4h = 6062h - 6064h */
    int32_t position_demand;   /* 6062h */
    int32_t velocity_demand;   /* 606Bh */
    int16_t torque_demand;     /* 6074h */
    int16_t current_actual;    /* 6078h */
    int32_t position_internal; /* 6063h, increments */
    int32_t demand_internal;   /* 60FCh, increments */
    uint32_t digital_inputs;   /* 60FDh */
    uint32_t dc_link_mv;       /* 6079h */
    int32_t probe_1_positive;  /* 60BAh */
    int32_t probe_1_negative;  /* 60BBh */
    int32_t probe_2_positive;  /* 60BCh */
    int32_t probe_2_negative;  /* 60BDh */
    uint16_t probe_status;     /* 60B9h */
    uint16_t pad;
} sj_drive_tx;

/* what the state machine decides upon */
typedef struct {
    uint16_t controlword;
    uint16_t previous; /* controlword of the step before: bit 7 acts on its edge */
    int16_t quick_stop_option;
    int16_t shutdown_option;
    int16_t disable_option;
    uint8_t power;    /* bus voltage present, no safe torque off */
    uint8_t fault;    /* a fault came up */
    uint8_t cause;    /* the cause of a fault is still there */
    uint8_t standing; /* the motor stands, a stop has ended */
} sj_drive_input;

/* The bare state machine: next state; bit n of *transitions is set when transition n ran. */
int32_t sj_drive_next(int32_t state, const sj_drive_input *input, uint32_t *transitions);
uint16_t sj_drive_state_bits(int32_t state); /* statusword bits 0-3, 5, 6 */

uint16_t sj_drive_fault_code(int32_t fault); /* 603Fh of a named fault */

/* The master's side: the controlword that leads a drive to OPERATION ENABLED, or out of it. */
uint16_t sj_master_controlword(uint16_t statusword, int32_t enable, int32_t reset);

/* For C only. */

int32_t sj_master_enabled(uint16_t statusword);            /* OPERATION ENABLED */
int32_t sj_master_fault(uint16_t statusword);              /* FAULT or its reaction */
int32_t sj_master_lost(uint16_t error_code);               /* 603Fh: link or SYNC lost */
int32_t sj_master_stopping(uint16_t statusword);           /* QUICK STOP ACTIVE */
int32_t sj_master_follows_position(const sj_drive_tx *tx); /* enabled and following, bit 12; CSP */
int32_t
sj_master_bridging(const sj_drive_tx *tx); /* CSP, enabled; no limit keeps it from following */
uint32_t
sj_master_switches(const sj_drive_tx *tx);       /* closed limit switches: 1 negative, 2 positive */
int32_t sj_master_homing(const sj_drive_tx *tx); /* mode 6: 1 attained, -1 error, 0 */
