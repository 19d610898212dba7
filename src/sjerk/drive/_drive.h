/* The CiA 402 drive: config, words, process image, state, motor.
 *
 * The words and objects are CiA 402's (IEC 61800-7-201); four hex digits and 'h' name an object.
 * "pu" is the position user unit of 607Ah: one encoder increment unless 6091h/6092h say otherwise. */
#pragma once
#include <stdint.h>
#include "base/_types.h"

enum {                                  /* states of the device control state machine */
    SJ_STATE_NOT_READY = 0,
    SJ_STATE_SWITCH_ON_DISABLED = 1,
    SJ_STATE_READY = 2,
    SJ_STATE_SWITCHED_ON = 3,
    SJ_STATE_OPERATION_ENABLED = 4,
    SJ_STATE_QUICK_STOP = 5,
    SJ_STATE_FAULT_REACTION = 6,
    SJ_STATE_FAULT = 7
};

enum {                                  /* controlword 6040h */
    SJ_CW_SWITCH_ON = 0x0001,
    SJ_CW_ENABLE_VOLTAGE = 0x0002,
    SJ_CW_QUICK_STOP = 0x0004,          /* 0 stops */
    SJ_CW_ENABLE_OPERATION = 0x0008,
    SJ_CW_MODE_4 = 0x0010,              /* homing: start */
    SJ_CW_MODE_5 = 0x0020,
    SJ_CW_MODE_6 = 0x0040,
    SJ_CW_FAULT_RESET = 0x0080,         /* acts on its rising edge */
    SJ_CW_HALT = 0x0100
};

enum {                                  /* statusword 6041h */
    SJ_SW_READY = 0x0001,
    SJ_SW_SWITCHED_ON = 0x0002,
    SJ_SW_OPERATION_ENABLED = 0x0004,
    SJ_SW_FAULT = 0x0008,
    SJ_SW_VOLTAGE = 0x0010,
    SJ_SW_QUICK_STOP = 0x0020,          /* 0 = quick stop active */
    SJ_SW_DISABLED = 0x0040,
    SJ_SW_WARNING = 0x0080,
    SJ_SW_SYNC = 0x0100,                /* manufacturer's: the period had its SYNC */
    SJ_SW_REMOTE = 0x0200,
    SJ_SW_TARGET_REACHED = 0x0400,
    SJ_SW_LIMIT = 0x0800,
    SJ_SW_FOLLOWS = 0x1000,             /* CSP, CSV, CST: the drive follows; homing: attained */
    SJ_SW_FOLLOWING_ERROR = 0x2000      /* CSP: following error; homing: error */
};

enum {                                  /* modes of operation 6060h */
    SJ_MODE_NONE = 0,
    SJ_MODE_PROFILE_POSITION = 1,
    SJ_MODE_PROFILE_VELOCITY = 3,
    SJ_MODE_HOMING = 6,
    SJ_MODE_CSP = 8,
    SJ_MODE_CSV = 9,
    SJ_MODE_CST = 10
};

enum {                                  /* what a target beyond the jump limit causes */
    SJ_JUMP_FAULT = 0,
    SJ_JUMP_CLAMP = 1,
    SJ_JUMP_OFF = 2
};

enum {                                  /* faults by name; codes and reactions in _cia402.c */
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
    SJ_FAULT_OVER_SPEED = 10,
    SJ_FAULT_FOLLOWING_ERROR = 11,
    SJ_FAULT_REFERENCE_LIMIT = 12,
    SJ_FAULT_SYNC = 13,
    SJ_FAULTS = 14
};

enum {                                  /* phases of homing */
    SJ_HOMING_IDLE = 0,
    SJ_HOMING_SEARCH = 1,               /* for the switch or the index pulse */
    SJ_HOMING_BACK = 2,                 /* off the switch */
    SJ_HOMING_STOPPING = 3
};

enum {                                  /* findings of the verdict on the stream of targets */
    SJ_FINDING_JUMP = 0,                /* further than the jump limit */
    SJ_FINDING_STALE = 1,               /* the same target twice while moving */
    SJ_FINDING_SKIPPED = 2,             /* about twice the way of the cycle before: one is missing */
    SJ_FINDING_STEP = 3,                /* a step in velocity no limit allows */
    SJ_FINDING_ACCELERATION = 4,
    SJ_FINDING_VELOCITY = 5,
    SJ_FINDING_JERK = 6,
    SJ_FINDINGS = 7
};

/* Config. First the machine, in SI units; then objects, in their own type and unit. */
typedef struct {
    double period_s;                    /* SYNC period, 60C2h */
    double inner_rate_hz;               /* servo loop; rounded up to a whole number per period */
    double position_gain_per_s;         /* Kp */
    double velocity_bandwidth_hz;       /* Kv = 2 pi f J */
    double velocity_integral_s;         /* Ti */
    double velocity_feedforward;        /* 0..1 of the demand velocity */
    double acceleration_feedforward;    /* 0..1 of J times the demand acceleration */
    double torque_time_s;               /* first-order torque loop */
    double velocity_filter_s;           /* first-order filter of the encoder's difference */
    double rated_torque_nm;             /* 6076h */
    double peak_torque_nm;
    double rated_current_a;             /* 6075h */
    double max_speed_rpm;               /* 6080h */
    double inertia_kg_m2;               /* rotor */
    double load_inertia_ratio;          /* load / rotor */
    double friction_nm;                 /* Coulomb */
    double friction_speed_rad_s;        /* w0 of friction w / (|w| + w0) */
    double viscous_nm_s;
    double load_torque_nm;              /* constant, e.g. gravity */
    double brake_torque_nm;             /* 0 = no brake; closed while the power stage is off */
    double stop_timeout_s;              /* a stop counts as done this long after its ramp, at most */
    double jump_factor;                 /* jump limit = speed limit x period x factor */
    double stream_acceleration_rev_s2;  /* limit of the verdict; 0 = peak torque / inertia */
    double stream_jerk_rev_s3;          /* limit of the verdict; 0 = not judged */
    double profile_jerk_rev_s3;         /* of modes 1 and 3 */
    double switch_negative_rev;         /* limit switch closed below; closed never if <= -1e9 */
    double switch_positive_rev;         /* limit switch closed above; closed never if >= 1e9 */
    double switch_home_rev;             /* home switch closed above */

    uint32_t encoder_increments;        /* 608Fh:1 */
    uint32_t encoder_revolutions;       /* 608Fh:2 */
    uint32_t gear_motor;                /* 6091h:1 */
    uint32_t gear_shaft;                /* 6091h:2 */
    uint32_t feed;                      /* 6092h:1 */
    uint32_t feed_shaft;                /* 6092h:2 */
    int32_t range_min;                  /* 607Bh:1 */
    int32_t range_max;                  /* 607Bh:2 */
    int32_t software_min;               /* 607Dh:1; both 0 = off */
    int32_t software_max;               /* 607Dh:2 */
    uint32_t polarity;                  /* 607Eh: bit 7 position, 6 velocity, 5 torque */
    uint32_t following_window;          /* 6065h; FFFFFFFFh = off */
    uint32_t following_time_ms;         /* 6066h */
    uint32_t position_window;           /* 6067h; FFFFFFFFh = off */
    uint32_t position_time_ms;          /* 6068h */
    uint32_t velocity_window;           /* 606Dh, pu/s */
    uint32_t velocity_time_ms;          /* 606Eh */
    uint32_t velocity_threshold;        /* 606Fh, pu/s */
    uint32_t threshold_time_ms;         /* 6070h */
    uint32_t max_profile_velocity;      /* 607Fh, pu/s */
    uint32_t profile_velocity;          /* 6081h, pu/s */
    uint32_t profile_acceleration;      /* 6083h, pu/s^2 */
    uint32_t profile_deceleration;      /* 6084h, pu/s^2 */
    uint32_t quick_stop_deceleration;   /* 6085h, pu/s^2 */
    uint32_t max_acceleration;          /* 60C5h, pu/s^2; FFFFFFFFh = off */
    uint32_t max_deceleration;          /* 60C6h, pu/s^2; FFFFFFFFh = off */
    uint32_t max_torque;                /* 6072h, 0.1 % of rated */
    uint32_t torque_limit_positive;     /* 60E0h */
    uint32_t torque_limit_negative;     /* 60E1h */
    int32_t quick_stop_option;          /* 605Ah 0..8 */
    int32_t shutdown_option;            /* 605Bh 0..1 */
    int32_t disable_option;             /* 605Ch 0..1 */
    int32_t halt_option;                /* 605Dh 1..4 */
    int32_t fault_option;               /* 605Eh 0..4 */
    int32_t abort_option;               /* 6007h 0..3 */
    int32_t jump_option;                /* SJ_JUMP_... */
    int32_t positioning_option;         /* 60F2h: relative to 0 the target, 1 demand, 2 actual */
    uint32_t sync_extrapolation;        /* missed SYNCs in a row bridged by the last velocity */
    uint32_t sync_error_limit;          /* 10F1h:2: +3 per missed, -1 per good; FFFFh = off */
    int32_t home_offset;                /* 607Ch */
    int32_t homing_method;              /* 6098h */
    uint32_t homing_speed_switch;       /* 6099h:1, pu/s */
    uint32_t homing_speed_zero;         /* 6099h:2, pu/s */
    uint32_t homing_acceleration;       /* 609Ah, pu/s^2 */
} sj_drive_config;

typedef struct {                        /* what a period brings: the RxPDO */
    uint16_t controlword;               /* 6040h */
    int8_t mode;                        /* 6060h */
    uint8_t sync_missed;                /* 1: no SYNC, or no fresh targets, in this period */
    int32_t target_position;            /* 607Ah */
    int32_t position_offset;            /* 60B0h */
    int32_t velocity_offset;            /* 60B1h */
    int32_t target_velocity;            /* 60FFh */
    int16_t target_torque;              /* 6071h */
    int16_t torque_offset;              /* 60B2h */
    uint32_t digital_outputs;           /* 60FEh:1; bit 0 closes the brake */
    uint32_t output_mask;               /* 60FEh:2; only these bits count */
} sj_drive_rx;

typedef struct {                        /* what the period gives: the TxPDO */
    uint16_t statusword;                /* 6041h */
    int8_t mode_display;                /* 6061h */
    uint8_t error_register;             /* 1001h */
    int32_t position_actual;            /* 6064h */
    int32_t velocity_actual;            /* 606Ch */
    int16_t torque_actual;              /* 6077h */
    uint16_t error_code;                /* 603Fh */
    int32_t following_error;            /* 60F4h = 6062h - 6064h */
    int32_t position_demand;            /* 6062h */
    int32_t velocity_demand;            /* 606Bh */
    int16_t torque_demand;              /* 6074h */
    int16_t current_actual;             /* 6078h */
    int32_t position_internal;          /* 6063h, increments */
    int32_t demand_internal;            /* 60FCh, increments */
    uint32_t digital_inputs;            /* 60FDh */
    uint32_t dc_link_mv;                /* 6079h */
} sj_drive_tx;

typedef struct {                        /* a position in increments and in pu at once */
    int64_t increments;                 /* unwrapped */
    int64_t units;                      /* within 607Bh */
    int64_t remainder;                  /* what the ratio leaves between the two */
} sj_drive_point;

typedef struct {                        /* what the state machine decides upon */
    uint16_t controlword;
    uint16_t previous;                  /* controlword of the step before: bit 7 acts on its edge */
    int16_t quick_stop_option;
    int16_t shutdown_option;
    int16_t disable_option;
    uint8_t power;                      /* bus voltage present, no safe torque off */
    uint8_t fault;                      /* a fault came up */
    uint8_t cause;                      /* the cause of a fault is still there */
    uint8_t standing;                   /* the motor stands, a stop has ended */
} sj_drive_input;

enum {                                  /* what a drive in mode 1 or 3 wants planned */
    SJ_REQUEST_NONE = 0,
    SJ_REQUEST_MOVE = 1,
    SJ_REQUEST_VELOCITY = 2
};

typedef struct {                        /* from the demand at hand; increments and periods */
    int32_t kind;                       /* SJ_REQUEST_... */
    int32_t pad;
    double distance;                    /* of a move that ends at rest */
    double goal;                        /* velocity */
    double velocity;                    /* at the start */
    double acceleration;
    sj_limits limits;
} sj_drive_request;

enum {                                  /* what a servo period is to control */
    SJ_SERVO_OFF = 0,
    SJ_SERVO_POSITION = 1,
    SJ_SERVO_VELOCITY = 2,
    SJ_SERVO_TORQUE = 3
};

typedef struct {                        /* one period of command to the servo, motor units */
    int32_t control;                    /* SJ_SERVO_... */
    int32_t brake;                      /* 1 = closed */
    int64_t demand;                     /* increments at the period's start */
    double fraction;                    /* of an increment, added to demand */
    double advance;                     /* increments over the period */
    double velocity_start_rad_s;        /* velocity command or feed-forward, start and end */
    double velocity_end_rad_s;
    double velocity_offset_rad_s;       /* 60B1h */
    double torque_nm;                   /* torque command or feed-forward, 60B2h included */
    double torque_max_nm;
    double torque_min_nm;
    double speed_max_rad_s;
} sj_servo_command;

typedef struct {                        /* motor and loops */
    int64_t encoder;                    /* increments */
    double fraction;                    /* of an increment, 0..1 */
    double velocity_rad_s;              /* of the motor */
    double measured_rad_s;              /* from the encoder, filtered */
    double torque_nm;                   /* of the motor */
    double command_nm;                  /* asked of the torque loop */
    double integral_nm;
    int32_t torque_limited;             /* in any inner step of the period */
    int32_t speed_limited;
} sj_servo;

typedef struct {                        /* constants of the servo, made from a config */
    int32_t steps;                      /* inner steps per period */
    int32_t pad;
    double step_s;
    double steps_inverse;
    double increments_per_rad;
    double position_gain;               /* rad/s per increment */
    double velocity_feedforward;
    double velocity_gain;               /* Nm s/rad */
    double integral_gain;               /* per inner step */
    double torque_gain;                 /* of the first-order torque loop, per inner step */
    double filter_gain;                 /* of the velocity filter, per inner step */
    double friction_nm;
    double friction_speed_rad_s;
    double viscous_nm_s;
    double load_torque_nm;
    double brake_torque_nm;
    double inertia_kg_m2;
    double inertia_inverse;
    double speed_bound_rad_s;           /* the motor never turns faster, whatever happens */
} sj_servo_constants;

typedef struct {                        /* the verdict on the stream of targets */
    uint64_t samples;                   /* targets followed */
    uint64_t missed_syncs;
    uint64_t first[7];                  /* drive cycle of the first finding of each kind */
    uint32_t counts[7];                 /* SJ_FINDING_... */
    uint32_t following_max;             /* largest |60F4h| while following, pu */
    double velocity_max_rev_s;          /* largest seen, rounding of the targets subtracted */
    double acceleration_max_rev_s2;
    double jerk_max_rev_s3;
    double last_step;                   /* history, pu per period */
    double last_change;
    int32_t history;
    int32_t last_finding;               /* of the cycle at hand, -1 none */
} sj_drive_verdict;

typedef struct {
    sj_drive_config config;
    sj_servo_constants constants;
    sj_servo servo;
    sj_drive_verdict verdict;
    sj_drive_point actual;
    sj_drive_point demand;
    double demand_fraction;             /* of an increment, left by ramps */
    double demand_velocity;             /* increments per period at its end */
    double demand_acceleration;         /* increments per period^2, of a plan */
    double torque_demand_nm;
    sj_drive_request request;
    sj_plan plan;                       /* being executed in modes 1 and 3 */
    int64_t plan_left;                  /* periods of its present phase */
    int64_t goal_units;                 /* 607Ah of the set-point, within 607Bh */
    double goal_velocity;               /* increments per period */
    int64_t ratio_units;                /* pu = increments * ratio_units / ratio_increments */
    int64_t ratio_increments;
    int64_t range;                      /* pu in one wrap of 607Bh */
    int64_t jump_limit;                 /* pu per period */
    int64_t homing_turn;                /* index pulses counted when the search began */
    uint64_t cycles;
    uint32_t causes;                    /* bit n = fault n injected and still there */
    uint32_t transitions;               /* bit n = transition n ran in this cycle */
    int32_t state;                      /* SJ_STATE_... */
    int32_t mode;                       /* 6061h */
    int32_t fault;                      /* SJ_FAULT_... that led to the present reaction */
    int32_t follows;
    int32_t limited;                    /* statusword bit 11 of this cycle */
    int32_t missed_in_row;
    int32_t sync_errors;
    int32_t plan_phase;                 /* -1: none */
    int32_t goal_set;                   /* a goal exists: 1 position, 2 velocity */
    int32_t goal_waits;                 /* a second set-point until the first is reached */
    int32_t acknowledged;               /* statusword bit 12 of mode 1 */
    int64_t waiting_units;
    int32_t homing;                     /* SJ_HOMING_... */
    int32_t homed;                      /* a reference exists */
    int32_t homing_error;
    int32_t resync;                     /* adopt the actual position before following again */
    int32_t warning;                    /* statusword bit 7 */
    int32_t pad32;
    int32_t local;                      /* 1: the controlword is not obeyed */
    uint32_t following_cycles;          /* spent outside the following window */
    uint32_t window_cycles;             /* spent inside the position window */
    uint32_t velocity_cycles;           /* spent inside the velocity window */
    uint32_t moving_cycles;             /* spent above the velocity threshold */
    uint32_t stop_cycles;               /* since the end of a stop's ramp */
    uint16_t controlword;               /* the one that counts in this cycle */
    uint16_t controlword_before;
    uint16_t error_code;                /* 603Fh */
    uint8_t following_error;            /* statusword bit 13 */
    uint8_t standing;
} sj_drive;

void sj_drive_config_default(sj_drive_config *config);          /* SGM7J-04A at 1 ms */

/* 0, or n for the n-th field of sj_drive_config: it lies outside its range, or the fields that
 * end there do not fit each other. */
int32_t sj_drive_config_check(const sj_drive_config *config);
const char *sj_drive_config_field(int32_t field, double *low, double *high);

int32_t sj_drive_init(sj_drive *drive, const sj_drive_config *config);      /* as the check */
int32_t sj_drive_configure(sj_drive *drive, const sj_drive_config *config); /* keeps the motion */
void sj_drive_rescale(sj_drive *drive);      /* positions in pu anew from the encoder's increments */
void sj_drive_cycle(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx);
/* The same for several, bit for bit, their motors side by side. */
void sj_drive_cycles(sj_drive *const *drives, const sj_drive_rx *const *rx, sj_drive_tx *const *tx,
                     int32_t count);
/* The same with modes 1 and 3: what the drive asks for is planned at the period's end. */
void sj_drive_cycle_planned(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx);
void sj_drive_inject(sj_drive *drive, int32_t fault, int32_t present);
uint16_t sj_drive_fault_code(int32_t fault);                    /* 603Fh of a named fault */

/* The bare state machine: next state; bit n of *transitions is set when transition n ran. */
int32_t sj_drive_next(int32_t state, const sj_drive_input *input, uint32_t *transitions);
uint16_t sj_drive_state_bits(int32_t state);                    /* statusword bits 0-3, 5, 6 */

/* The master's side of the words. */
uint16_t sj_master_controlword(uint16_t statusword, int32_t enable, int32_t reset);
int32_t sj_master_enabled(uint16_t statusword);                 /* OPERATION ENABLED */
int32_t sj_master_follows(uint16_t statusword);                 /* enabled and following, bit 12 */
int32_t sj_master_fault(uint16_t statusword);                   /* FAULT or its reaction */
int32_t sj_master_lost(uint16_t error_code);                    /* 603Fh: link or SYNC lost */
int32_t sj_master_stopping(uint16_t statusword);                /* QUICK STOP ACTIVE */
int32_t sj_master_follows_position(const sj_drive_tx *tx);      /* follows, in mode CSP */
int32_t sj_master_homing(const sj_drive_tx *tx);                /* mode 6: 1 attained, -1 error, 0 */

void sj_verdict_clear(sj_drive_verdict *verdict);

void     sj_ideal_cycle(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx);
