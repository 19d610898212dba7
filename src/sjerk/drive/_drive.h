/* The CiA 402 drive: config, state, motor; one SYNC period.
 *
 * "pu" is the position user unit of 607Ah, as in _words.h. */
#pragma once
#include <stdint.h>
#include "base/_types.h"  /* limits and plans of modes 1 and 3 */
#include "drive/_words.h" /* the words and the process image */

/* what a target beyond the jump limit causes */
enum { SJ_JUMP_FAULT = 0, SJ_JUMP_CLAMP = 1, SJ_JUMP_OFF = 2 };

/* 60F2h bits 1, 0: what a relative set-point counts from */
enum {
    SJ_RELATIVE_TARGET = 0, /* the target before */
    SJ_RELATIVE_DEMAND = 1, /* 6062h */
    SJ_RELATIVE_ACTUAL = 2, /* 6064h */
    SJ_RELATIVE_BITS = 3
};

/* 60F2h bits 7, 6: the way to a set-point */
enum {
    SJ_ROTARY_NONE = 0x00, /* linear: as the numbers say */
    SJ_ROTARY_NEGATIVE = 0x40,
    SJ_ROTARY_POSITIVE = 0x80,
    SJ_ROTARY_SHORTEST = 0xC0,
    SJ_ROTARY_BITS = 0xC0
};

/* phases of homing */
enum {
    SJ_HOMING_IDLE = 0,
    SJ_HOMING_SEARCH = 1, /* for the switch or the hard stop */
    SJ_HOMING_INDEX = 2,  /* for the index pulse */
    SJ_HOMING_STOPPING = 3
};

/* inputs that belong to a place of the motor; the first three are the bits of 60FDh */
enum {
    SJ_INPUT_NEGATIVE = 0, /* limit switches */
    SJ_INPUT_POSITIVE = 1,
    SJ_INPUT_HOME = 2,
    SJ_INPUT_PROBE_1 = 3, /* touch probes */
    SJ_INPUT_PROBE_2 = 4,
    SJ_INPUTS = 5
};

/* findings of the verdict on the stream of targets */
enum {
    SJ_FINDING_JUMP = 0,    /* further than the jump limit */
    SJ_FINDING_STALE = 1,   /* the same target twice while moving */
    SJ_FINDING_SKIPPED = 2, /* about twice the distance of the cycle before: one is missing */
    SJ_FINDING_STEP = 3,    /* a step in velocity no limit allows */
    SJ_FINDING_ACCELERATION = 4,
    SJ_FINDING_VELOCITY = 5,
    SJ_FINDING_JERK = 6,
    SJ_FINDING_PERIOD = 7, /* SYNC does not come in the period of 60C2h */
    SJ_FINDINGS = 8
};

/* Config. First the machine, in SI units; then objects, in their own type and unit. */
typedef struct {
    double period_s;                 /* SYNC period, 60C2h */
    double inner_rate_hz;            /* servo loop; rounded up to a whole number per period */
    double position_gain_per_s;      /* Kp */
    double velocity_bandwidth_hz;    /* Kv = 2 pi f J */
    double velocity_integral_s;      /* Ti */
    double velocity_feedforward;     /* 0..1 of the demand velocity */
    double acceleration_feedforward; /* 0..1 of J times the demand acceleration */
    double torque_time_s;            /* first-order torque loop */
    double velocity_filter_s;        /* first-order filter of the encoder's difference */
    double rated_torque_nm;          /* 6076h */
    double peak_torque_nm;
    double rated_current_a;      /* 6075h */
    double max_speed_rpm;        /* 6080h */
    double inertia_kg_m2;        /* rotor */
    double load_inertia_ratio;   /* load / rotor */
    double friction_nm;          /* Coulomb */
    double friction_speed_rad_s; /* w0 of friction w / (|w| + w0) */
    double viscous_nm_s;
    double load_torque_nm;             /* constant, e.g. gravity */
    double brake_torque_nm;            /* 0 = no brake; closed while the power stage is off */
    double stop_timeout_s;             /* a stop counts as done this long after its ramp, at most */
    double jump_factor;                /* jump limit = speed limit x period x factor */
    double stream_acceleration_rev_s2; /* limit of the verdict; 0 = peak torque / inertia */
    double stream_jerk_rev_s3;         /* limit of the verdict; 0 = not judged */
    double profile_jerk_rev_s3;        /* of modes 1 and 3 */
    double switch_negative_rev;        /* limit switch closed below; closed never if <= -1e9 */
    double switch_positive_rev;        /* limit switch closed above; closed never if >= 1e9 */
    double switch_home_rev;            /* home switch closed from here; closed never if >= 1e9 */
    double switch_home_end_rev;        /* to here */
    double probe_1_rev;                /* touch probe 1 closed from here; never if >= 1e9 */
    double probe_1_end_rev;            /* to here */
    double probe_2_rev;                /* touch probe 2 likewise */
    double probe_2_end_rev;
    double hard_stop_negative_rev; /* the axis cannot turn below; none if <= -1e9 */
    double hard_stop_positive_rev; /* nor above; none if >= 1e9 */

    uint32_t encoder_increments;      /* 608Fh:1 */
    uint32_t encoder_revolutions;     /* 608Fh:2 */
    uint32_t gear_motor;              /* 6091h:1 */
    uint32_t gear_shaft;              /* 6091h:2 */
    uint32_t feed;                    /* 6092h:1 */
    uint32_t feed_shaft;              /* 6092h:2 */
    int32_t range_min;                /* 607Bh:1 */
    int32_t range_max;                /* 607Bh:2; not above sub 1: the range is INT32 */
    int32_t software_min;             /* 607Dh:1 */
    int32_t software_max;             /* 607Dh:2; not above sub 1: no limits */
    uint32_t polarity;                /* 607Eh: bit 7 position, 6 velocity, 5 torque */
    uint32_t following_window;        /* 6065h; FFFFFFFFh = off */
    uint32_t following_time_ms;       /* 6066h */
    uint32_t position_window;         /* 6067h; FFFFFFFFh = off */
    uint32_t position_time_ms;        /* 6068h */
    uint32_t velocity_window;         /* 606Dh, pu/s */
    uint32_t velocity_time_ms;        /* 606Eh */
    uint32_t velocity_threshold;      /* 606Fh, pu/s */
    uint32_t threshold_time_ms;       /* 6070h */
    uint32_t max_profile_velocity;    /* 607Fh, pu/s */
    uint32_t profile_velocity;        /* 6081h, pu/s */
    uint32_t profile_acceleration;    /* 6083h, pu/s^2 */
    uint32_t profile_deceleration;    /* 6084h, pu/s^2 */
    uint32_t quick_stop_deceleration; /* 6085h, pu/s^2 */
    uint32_t max_acceleration;        /* 60C5h, pu/s^2; FFFFFFFFh = off */
    uint32_t max_deceleration;        /* 60C6h, pu/s^2; FFFFFFFFh = off */
    uint32_t max_torque;              /* 6072h, 0.1 % of rated */
    uint32_t torque_slope;            /* 6087h, 0.1 % of rated per second */
    uint32_t torque_limit_positive;   /* 60E0h */
    uint32_t torque_limit_negative;   /* 60E1h */
    int32_t quick_stop_option;        /* 605Ah 0..8 */
    int32_t shutdown_option;          /* 605Bh 0..1 */
    int32_t disable_option;           /* 605Ch 0..1 */
    int32_t halt_option;              /* 605Dh 1..4 */
    int32_t fault_option;             /* 605Eh 0..4 */
    int32_t abort_option;             /* 6007h 0..3 */
    int32_t jump_option;              /* SJ_JUMP_... */
    int32_t positioning_option;       /* 60F2h: SJ_RELATIVE_..., SJ_ROTARY_... */
    uint32_t sync_extrapolation;      /* missed SYNCs in a row bridged by the last velocity */
    uint32_t sync_error_limit;        /* 10F1h:2: +3 per missed, -1 per good; FFFFh = off */
    uint32_t software_from_home;  /* 1: 607Dh less 607Ch counts, as the text of CiA 402 has it */
    int32_t home_offset;          /* 607Ch */
    int32_t homing_method;        /* 6098h */
    uint32_t homing_speed_switch; /* 6099h:1, pu/s */
    uint32_t homing_speed_zero;   /* 6099h:2, pu/s */
    uint32_t homing_acceleration; /* 609Ah, pu/s^2 */
    uint32_t hard_stop_torque;    /* 2100h:9, 0.1 % of rated: with which a hard stop is sought */
    uint32_t hard_stop_time_ms;   /* 2100h:10: so long at that torque without turning */
} sj_drive_config;

/* a position in increments and in pu at once */
typedef struct {
    int64_t increments; /* unwrapped */
    int64_t units;      /* within 607Bh */
    int64_t travel;     /* units unwrapped: differences of two points are true ways */
    int64_t remainder;  /* what the ratio leaves between increments and units */
} sj_drive_point;

/* what a drive in mode 1 or 3 wants planned */
enum { SJ_REQUEST_NONE = 0, SJ_REQUEST_MOVE = 1, SJ_REQUEST_VELOCITY = 2 };

/* from the demand at hand; increments and periods */
typedef struct {
    int32_t kind;      /* SJ_REQUEST_... */
    int32_t direction; /* of a rotary move that may not turn back: 1, -1; 0: either */
    double distance;   /* of a move */
    double turn;       /* one range of 607Bh */
    double goal;       /* velocity; of a move: with which it passes its end, if it can */
    double velocity;   /* at the start */
    double acceleration;
    sj_limits limits;
} sj_drive_request;

/* what a servo period is to control */
enum { SJ_SERVO_OFF = 0, SJ_SERVO_POSITION = 1, SJ_SERVO_VELOCITY = 2, SJ_SERVO_TORQUE = 3 };

/* one period of command to the servo, motor units */
typedef struct {
    int32_t control;             /* SJ_SERVO_... */
    int32_t brake;               /* 1 = closed */
    int64_t demand;              /* increments at the period's start */
    double fraction;             /* of an increment, added to demand */
    double advance;              /* increments over the period */
    double velocity_start_rad_s; /* velocity command or feed-forward, start and end */
    double velocity_end_rad_s;
    double velocity_offset_rad_s; /* 60B1h */
    double torque_nm;             /* torque command or feed-forward, 60B2h included */
    double torque_max_nm;
    double torque_min_nm;
    double speed_max_rad_s;
} sj_servo_command;

/* an input is closed where closes <= encoder < opens; INT64_MIN, INT64_MAX: no such edge */
typedef struct {
    int64_t closes;
    int64_t opens;
} sj_drive_signal;

/* motor and loops */
typedef struct {
    int64_t encoder;       /* increments */
    double fraction;       /* of an increment, 0..1 */
    double velocity_rad_s; /* of the motor */
    double measured_rad_s; /* from the encoder, filtered */
    double torque_nm;      /* of the motor */
    double command_nm;     /* asked of the torque loop */
    double integral_nm;
    int32_t torque_limited; /* in any inner step of the period */
    int32_t speed_limited;
} sj_servo;

/* constants of the servo, made from a config */
typedef struct {
    int32_t steps; /* inner steps per period */
    int32_t pad;
    double step_s;
    double steps_inverse;
    double increments_per_rad;
    double position_gain; /* rad/s per increment */
    double velocity_feedforward;
    double velocity_gain; /* Nm s/rad */
    double integral_gain; /* per inner step */
    double torque_gain;   /* of the first-order torque loop, per inner step */
    double filter_gain;   /* of the velocity filter, per inner step */
    double friction_nm;
    double friction_speed_rad_s;
    double viscous_nm_s;
    double load_torque_nm;
    double brake_torque_nm;
    double inertia_kg_m2;
    double inertia_inverse;
    double speed_bound_rad_s; /* the motor never turns faster, whatever happens */
    int64_t stop_low;         /* the motor never turns below, increments */
    int64_t stop_high;        /* nor above */
} sj_servo_constants;

/* the verdict on the stream of targets */
typedef struct {
    uint64_t samples; /* targets followed */
    uint64_t missed_syncs;
    uint64_t first[8];         /* drive cycle of the first finding of each kind */
    uint32_t counts[8];        /* SJ_FINDING_... */
    uint32_t following_max;    /* largest |60F4h| while following, pu */
    double velocity_max_rev_s; /* largest seen, rounding of the targets subtracted */
    double acceleration_max_rev_s2;
    double jerk_max_rev_s3;
    double last_step; /* history, pu per period */
    double last_change;
    int32_t history;
    int32_t last_finding; /* of the cycle at hand, -1 none */
} sj_drive_verdict;

/* positions in two units, made from a config */
typedef struct {
    int64_t units;            /* pu per `increments` */
    int64_t increments;       /* per `units`, reduced */
    int64_t range_min;        /* pu, where the range of 607Bh begins */
    int64_t range;            /* pu in one wrap of 607Bh */
    int64_t jump_limit;       /* pu per period */
    double speed_limit;       /* increments per period, of 6080h or 607Fh */
    sj_drive_signal input[5]; /* SJ_INPUT_... */
} sj_drive_scale;

/* where the axis is to be, at the end of the period */
typedef struct {
    sj_drive_point point;
    double fraction;     /* of an increment, left by ramps */
    double velocity;     /* increments per period */
    double acceleration; /* increments per period^2, of a plan */
    double torque_nm;    /* CST, mode 4 */
} sj_drive_demand;

/* a set-point of mode 1 */
typedef struct {
    int64_t travel;    /* where it is, as in sj_drive_point */
    int32_t direction; /* of the motor, for which 60F2h asks; 0: either */
    int32_t limited;   /* held at 607Dh */
} sj_drive_set_point;

/* of modes 1 and 3 */
typedef struct {
    sj_drive_request request;
    sj_plan plan;            /* being executed */
    int64_t plan_left;       /* periods of its present phase */
    int32_t plan_phase;      /* -1: none */
    int32_t kind;            /* a goal exists: 1 position, 2 velocity */
    int32_t waits;           /* a second set-point until the first is reached */
    int32_t passes;          /* the first is passed and not stopped at */
    int32_t acknowledged;    /* statusword bit 12 of mode 1 */
    int32_t through;         /* the plan does so */
    int32_t fresh;           /* a plan is to be asked for */
    sj_drive_set_point now;  /* of mode 1 */
    sj_drive_set_point next; /* that waits */
    double velocity;         /* increments per period, of mode 3 */
    double torque_nm;        /* of mode 4 */
} sj_drive_goal;

typedef struct {
    int64_t from;      /* the encoder one period ago */
    int64_t pulse;     /* the index pulse that is home */
    int32_t phase;     /* SJ_HOMING_... */
    int32_t homed;     /* a reference exists */
    int32_t error;     /* the search has failed */
    int32_t direction; /* of the search, of the motor: 1, -1 */
    int32_t seen;      /* the switch has changed */
    int32_t turned;    /* a limit switch has turned the search */
    uint32_t blocked;  /* periods since the torque that is allowed got the motor no further */
    int64_t furthest;  /* increments, in the direction of a hard stop */
    int32_t method;    /* 6098h when it began */
} sj_drive_homing;

/* touch probes: what was latched */
typedef struct {
    int32_t position[4]; /* 60BAh to 60BDh: 1 positive, 1 negative, 2 positive, 2 negative edge */
    uint16_t status;     /* 60B9h */
    uint16_t pad;
} sj_drive_probes;

/* periods in a row, but for sync_errors */
typedef struct {
    int32_t missed_in_row; /* without SYNC */
    int32_t sync_errors;   /* 10F1h:2 */
    uint32_t following;    /* outside the following window */
    uint32_t window;       /* inside the position window */
    uint32_t velocity;     /* inside the velocity window */
    uint32_t moving;       /* above the velocity threshold */
    uint32_t stop;         /* since the end of a stop's ramp */
    uint32_t pad;
} sj_drive_counts;

typedef struct {
    /* from the config */
    sj_drive_config config;
    sj_servo_constants constants;
    sj_drive_scale scale;
    /* the motor, what it does and what it is to do */
    sj_servo servo;
    sj_drive_point actual;
    sj_drive_demand demand;
    sj_drive_goal goal;
    sj_drive_homing homing;
    sj_drive_probes probes;
    /* device control */
    uint64_t cycles;
    uint32_t causes;      /* bit n = fault n injected and still there */
    uint32_t transitions; /* bit n = transition n ran in this cycle */
    int32_t state;        /* SJ_STATE_... */
    int32_t mode;         /* 6061h */
    int32_t fault;        /* SJ_FAULT_... that led to the present reaction */
    int32_t follows;
    int32_t limited;      /* statusword bit 11 of this cycle */
    int32_t stop;         /* 605Ah..605Eh, 1..4, of a stop that has begun; 0: none */
    int32_t resync;       /* adopt the actual position before following again */
    int32_t warning;      /* statusword bit 7 */
    int32_t local;        /* 1: the controlword is not obeyed */
    uint16_t controlword; /* the one that counts in this cycle */
    uint16_t controlword_before;
    uint16_t error_code;     /* 603Fh */
    uint8_t following_error; /* statusword bit 13 */
    uint8_t standing;
    /* supervision */
    sj_drive_counts counts;
    sj_drive_verdict verdict;
} sj_drive;

/* 0, or n for the n-th field of sj_drive_config: it lies outside its range, or the fields that
 * end there do not fit each other. */
int32_t sj_drive_config_check(const sj_drive_config *config);
const char *sj_drive_config_field(int32_t field, double *low, double *high);

int32_t sj_drive_init(sj_drive *drive, const sj_drive_config *config); /* as the check */
void sj_drive_place(sj_drive *drive, int64_t word); /* a new one: it stands at this word of 6064h */
int32_t sj_drive_configure(sj_drive *drive, const sj_drive_config *config); /* keeps the motion */
void sj_drive_rescale(sj_drive *drive); /* positions in pu anew from the encoder's increments */
void sj_drive_cycle(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx);
/* The same for several, bit for bit, their motors side by side. */
void sj_drive_cycles(sj_drive *const *drives, const sj_drive_rx *const *rx, sj_drive_tx *const *tx,
                     int32_t count);
/* The same with modes 1 and 3: what the drive asks for is planned at the period's end. */
void sj_drive_cycle_planned(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx);
void sj_drive_inject(sj_drive *drive, int32_t fault, int32_t present);

void sj_verdict_clear(sj_drive_verdict *verdict);
/* SYNC was seen to come in this period: a warning and a finding where it is not that of 60C2h. */
void sj_verdict_period(sj_drive *drive, double seen_s);

/* For C only. */

/* A drive that is at its target at once: no motor, no fault, CSP only. */
void sj_ideal_cycle(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx);
