/* The contract: every struct, enum and prototype that two rooms share.
 *
 * Read verbatim by the compiler and by cffi (API mode), so: no include guard, no #include, no #if,
 * no static inline, no expression in a #define; enums for constants. Each .c file includes
 * <stdint.h> and <stddef.h> before it. Padding is written out, offsets are asserted in the rooms.
 *
 * Units: the motion core is unit-free and counts time in cycles (velocity per cycle, acceleration
 * per cycle^2, jerk per cycle^3). A drive counts encoder increments. SI units carry a suffix (_s).
 */

/* ---- ground ---------------------------------------------------------------------------------- */

enum {
    SJ_AXES = 64,                       /* most axes of one kernel */
    SJ_PHASES = 40                      /* most phases of one plan */
};
#define SJ_CYCLES_MAX 1125899906842624 /* most cycles of one plan, 2^50 */

typedef struct {
    double hi, lo;                      /* the sum of both, about 106 bits (_exact.h) */
} sj_exact;

typedef struct {
    double position, velocity, acceleration;
} sj_state;

/* Constant jerk over each of `cycles` whole cycles; Eq. (1). */
typedef struct {
    int64_t cycles;
    double jerk;
} sj_phase;

/* A motion in whole cycles, jerks per cycle^3 in the direction of the axis. */
typedef struct {
    int64_t cycles;                     /* sum of the phases' cycles, N */
    int32_t count;                      /* phases used */
    int32_t kind;                       /* enum sj_plan_kind */
    double velocity, acceleration;      /* limits it was made under, or 0: rounding is relative */
    sj_phase phase[SJ_PHASES];
} sj_plan;

/* ---- peers: profile (_profile.c, _length.c) -------------------------------------------------- */

/* Magnitudes, per cycle; the direction of the motion has the first pair, against it the second. */
typedef struct {
    double velocity, acceleration, jerk, deceleration, deceleration_jerk;
} sj_limits;

/* The bound of the work of one plan: steps of any root, lengths tried in any search; and rounds of a
 * synchronisation. No recursion beyond one level, no allocation. */
enum { SJ_ROOT_STEPS = 40, SJ_LENGTH_STEPS = 6, SJ_SYNC_ROUNDS = 10 };

enum sj_plan_status {
    SJ_PLAN_OK = 0,
    SJ_PLAN_INVALID = 1,                /* a number that is none, a limit <= 0, |v1| > velocity */
    SJ_PLAN_TOO_LONG = 2,               /* more than SJ_CYCLES_MAX cycles */
    SJ_PLAN_BLOCKED = 3                 /* none of exactly this length; the plan is the next longer */
};

enum sj_plan_kind {                     /* how it was found */
    SJ_PLAN_WAIT = 0,                   /* nothing to do, or waiting only */
    SJ_PLAN_CRUISE = 1,                 /* ramp, cruise, ramp: seven phases */
    SJ_PLAN_EASE = 2,                   /* braking eased for a while; no zero of the acceleration */
    SJ_PLAN_MIX = 3,                    /* convex mix of a plan too short and one too far */
    SJ_PLAN_STOP = 4,                   /* stop first, then from rest: the last resort */
    SJ_PLAN_RAMP = 5,                   /* change of velocity only */
    SJ_PLAN_RETURN = 8                  /* added: the start was outside its limits */
};

/* From the continuous state (0, v0, a0) to (h, v1, 0), as soon as possible. */
int32_t sj_plan_move(double h, double v0, double a0, double v1, const sj_limits *limits,
                     sj_plan *plan);
/* From (v0, a0) to (v1, 0), as soon as possible, wherever that is. */
int32_t sj_plan_velocity(double v0, double a0, double v1, const sj_limits *limits, sj_plan *plan);
/* Whether whole cycles can keep the velocity limit from (v, a), its acceleration "up". */
int32_t sj_plan_keeps(double v, double a, const sj_limits *limits);
/* As sj_plan_move, in exactly this many cycles. */
int32_t sj_plan_duration(double h, double v0, double a0, double v1, const sj_limits *limits,
                         int64_t cycles, sj_plan *plan);

typedef struct {
    double distance, v0, a0, v1;        /* continuous, per cycle */
} sj_request;

/* n axes, SJ_AXES at most, in the same and fewest cycles, at least `cycles`. */
int32_t sj_plan_together(int32_t n, const sj_request *requests, const sj_limits *limits,
                         int64_t cycles, sj_plan *plans);

/* Requests between samples, for several axes and for many (_planning.c). */
enum sj_synchronization {
    SJ_SYNC_NONE = 0,                   /* each axis as soon as it can */
    SJ_SYNC_TIME = 1,                   /* all axes arrive in the same cycle */
    SJ_SYNC_PHASE = 2                   /* the same phases: rest to rest on a straight line */
};

int32_t sj_plan_axes(int32_t n, const sj_request *request, const sj_limits *limits,
                     int64_t least_cycles, int32_t *synchronization, sj_plan *plans);
/* States and limits as memory of sj_state and sj_limits, since Python passes joined bytes: n starts and
 * n targets; n limits, and what one of each of their numbers is per cycle. */
int32_t sj_plan_samples(int32_t n, double cycle_time_s, const void *states, const void *limits,
                        const void *unit, int64_t least_cycles, int32_t *synchronization,
                        sj_plan *plans);
int32_t sj_plan_sample(double cycle_time_s, const void *from, const void *to, const void *limits,
                       sj_plan *plan);
int32_t sj_plan_sample_velocity(double cycle_time_s, const void *from, double v1,
                                const void *limits, sj_plan *plan, double *end);
/* One of many plans: its phases lie behind those of the plan before it, so that memory is touched
 * once only. */
typedef struct {
    int64_t cycles;
    int64_t first;                      /* index of its first phase */
    int32_t count;                      /* phases used */
    int32_t kind;                       /* enum sj_plan_kind */
} sj_row;

int32_t sj_plan_rows(int64_t n, double cycle_time_s, const double *from, int64_t from_columns,
                     const double *to, int64_t to_columns, const sj_limits *limits,
                     int64_t limits_step, sj_row *rows, sj_phase *phases, int64_t first,
                     int64_t *failed);

/* ---- peers: handshake (_handshake.c) --------------------------------------------------------- */

/* What the payloads are is the business of the wiring; here they are bytes. */
typedef struct {
    uint32_t command_bytes;             /* one command for all axes, > 0 */
    uint32_t feedback_bytes;            /* one feedback frame, > 0 */
    uint32_t record_bytes;              /* one look-ahead record for all axes */
    uint32_t record_capacity;           /* records in the ring: a power of two, or 0 for no ring */
    uint32_t event_bytes;               /* one event */
    uint32_t event_capacity;            /* events kept: a power of two >= 4, or 0 for no events */
    uint64_t abi;                       /* hash of the payload layouts, given by the caller */
} sj_shm_config;

enum { SJ_SHM_MAJOR = 1, SJ_SHM_MINOR = 0, SJ_SHM_PAGE = 4096 };

enum sj_shm_status {
    SJ_SHM_OK = 0,
    SJ_SHM_NOT_READY = -1,              /* still being created, or its creator died at it */
    SJ_SHM_TRUNCATED = -2,              /* shorter than its header says */
    SJ_SHM_MAGIC = -3,                  /* not a segment of sjerk */
    SJ_SHM_VERSION = -4,                /* another major version of the layout */
    SJ_SHM_ABI = -5,                    /* other payload layouts */
    SJ_SHM_CONFIG = -6,                 /* sizes out of range, or not those of the header */
    SJ_SHM_CORRUPT_HEADER = -7,
    SJ_SHM_CORRUPT_WORD = -8,           /* the command word is none of its twelve values */
    SJ_SHM_CORRUPT_DATA = -9,           /* a checksum fails: a second writer, or a wild one */
    SJ_SHM_CORRUPT_COUNTER = -10,       /* a counter ran backwards or out of its ring */
    SJ_SHM_LAPPED = -11,                /* the reader was overtaken too often; ask again */
    SJ_SHM_KERNEL_RESTARTED = -12       /* the addressed kernel is gone; see sj_shm_address */
};

enum sj_shm_host_state {
    SJ_HOST_ABSENT = 0,                 /* none yet, or the last one left in order */
    SJ_HOST_ALIVE = 1,
    SJ_HOST_SILENT = 2,                 /* asked to be watched and let its time pass */
    SJ_HOST_DEAD = 3                    /* lost its lock without leaving */
};

/* Where the single words lie, for tests and debuggers; the slots follow page by page. */
enum sj_shm_offset {
    SJ_SHM_HEADER = 0,                  /* written once */
    SJ_SHM_HOST = 4096,                 /* written by the host */
    SJ_SHM_COMMAND = 8192,              /* the one word that both sides write */
    SJ_SHM_KERNEL = 12288,              /* written by the kernel */
    SJ_SHM_SLOTS = 16384                /* command, feedback, ring, events; each on its own pages */
};

enum { SJ_SHM_FEEDBACK_SLOTS = 8, SJ_SHM_COLLECT_TRIES = 4, SJ_SHM_READ_TRIES = 64 };

/* The segment. */
uint64_t sj_shm_size(const sj_shm_config *config);   /* bytes; 0 if the config is out of range */
int32_t sj_shm_format(void *base, uint64_t size, const sj_shm_config *config);
int32_t sj_shm_check(const void *base, uint64_t size, const sj_shm_config *config); /* config may be NULL */
int32_t sj_shm_read_config(const void *base, uint64_t size, sj_shm_config *config);
uint32_t sj_shm_read_version(const void *base, uint64_t size);  /* major << 16 | minor, as found */

/* Who lives: epochs, heartbeats, orderly leave. Time is an argument; any monotonic nanoseconds. */
uint64_t sj_shm_begin_kernel(void *base, uint64_t now_ns);  /* the new kernel epoch, >= 1 */
uint64_t sj_shm_begin_host(void *base, uint64_t pid, uint64_t now_ns); /* the new host epoch, >= 1 */
void sj_shm_leave_host(void *base);     /* an orderly end, so that it is not taken for a death */
void sj_shm_leave_kernel(void *base);
int32_t sj_shm_kernel_left(const void *base);        /* 1: the last kernel ended in order */
uint64_t sj_shm_host_left(const void *base);         /* the last host epoch that ended in order */
uint64_t sj_shm_kernel_epoch(const void *base);
uint64_t sj_shm_host_epoch(const void *base);
uint64_t sj_shm_host_pid(const void *base);
uint64_t sj_shm_address(void *base);    /* host: from now on speak to the present kernel; its epoch */
uint64_t sj_shm_addressed(const void *base);
void sj_shm_watch_host(void *base, uint64_t timeout_ns, uint64_t now_ns); /* host: watch me; 0: do not */
void sj_shm_beat_host(void *base, uint64_t now_ns);
void sj_shm_beat_kernel(void *base, uint64_t now_ns);
uint64_t sj_shm_host_beat(const void *base);
uint64_t sj_shm_kernel_beat(const void *base);
void sj_shm_note_host(void *base, uint64_t host_epoch, int32_t lock_held); /* kernel side, outside the cycle */
int32_t sj_shm_host_state(const void *base, uint64_t now_ns);  /* in the cycle: enum sj_shm_host_state */

/* Kernel side, just before a cycle: what its exchanges touch, into the caches. */
void sj_shm_warm(const void *base);

/* Command: host to kernel, latest value. Publish: 0 or < 0. Collect: 1 fresh, 0 none, < 0 corrupt
 * (what `command` points to is then undefined). Neither waits; collect is wait-free. */
int32_t sj_command_publish(void *base, const void *command);
int32_t sj_command_collect(void *base, void *command);
uint64_t sj_command_published(const void *base);     /* commands begun since creation */
uint64_t sj_command_collected(const void *base);     /* number of the newest command the kernel took */

/* Feedback: kernel to many, latest value. Read: 1 a frame and its number, 0 nothing published yet. */
void sj_feedback_publish(void *base, const void *feedback);
int32_t sj_feedback_read(const void *base, void *feedback, uint64_t *sequence);
uint64_t sj_feedback_latest(const void *base);       /* number of the newest frame; cheap to poll */

/* Ring: host to kernel, every record once and in order. Publish: 1 all of them, 0 no room for all,
 * < 0. Take: 1 a record, 0 empty, < 0 corrupt (and stays so until flushed). */
int32_t sj_ring_publish(void *base, const void *records, uint32_t count);
int32_t sj_ring_take(void *base, void *record);
void sj_ring_flush(void *base);         /* host: discard what was published before this call */
uint64_t sj_ring_published(const void *base);        /* records published since creation */
uint64_t sj_ring_taken(const void *base);            /* records taken or discarded since creation */
uint64_t sj_ring_discarded(const void *base);        /* of these, flushed or meant for an earlier kernel */
uint32_t sj_ring_waiting(const void *base);          /* records the kernel can still take */

/* Events: kernel to many, the newest overwrite the oldest. Read: 1 the event after *cursor, 0 none;
 * *missed grows by exactly the events that were overwritten unread. Start with *cursor = 0 or latest. */
void sj_event_publish(void *base, const void *event);
int32_t sj_event_read(const void *base, uint64_t *cursor, void *event, uint64_t *missed);
uint64_t sj_event_latest(const void *base);

/* ---- peers: drive (_cia402.c, _servo.c) ------------------------------------------------------ */

/* The words and objects are CiA 402's (IEC 61800-7-201); four hex digits and 'h' name an object.
 * "pu" is the position user unit of 607Ah: one encoder increment unless 6091h/6092h say otherwise.
 */

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

/* ---- peers: following (_follow.c: the spline, _stretch.c: its times) --------------------------- */

/* A window of way-points, followed by the samples. All memory is the caller's: `rows` of
 * points * sj_follow_row(joints) doubles, `spare` of sj_follow_spare(joints). Cycle units. */
enum sj_follow_status {
    SJ_FOLLOW_OK = 0,
    SJ_FOLLOW_INVALID = 1,              /* no segment, or a number that is none */
    SJ_FOLLOW_TOO_LONG = 2,             /* more than SJ_CYCLES_MAX cycles */
    SJ_FOLLOW_STUCK = 3                 /* stretching found no end: the start state leads nowhere */
};

typedef struct {
    int64_t points;                     /* way-points; the last is a stop */
    int32_t joints;
    int32_t shorter;                    /* a neighbour so many times shorter is stretched instead */
    const double *position;             /* (points, joints) */
    const double *velocity;             /* (points, joints) to be had at the way-points, or NULL */
    const int64_t *least;               /* cycles asked for the segment that ends at point i */
    int64_t *cycles;                    /* cycles it takes; in: where to begin */
    const double *limits;               /* (joints, 3): velocity, acceleration, jerk */
    double *rows;
    double *spare;
} sj_follow;

int64_t sj_follow_row(int32_t joints);
int64_t sj_follow_spare(int32_t joints);
int64_t sj_follow_least(const sj_follow *s, int64_t i);
void    sj_follow_begin(const sj_follow *s, const double *velocity, const double *acceleration,
                        const double *last_jerk);
int32_t sj_follow_plan(const sj_follow *s);
int32_t sj_follow_could_lose(const sj_follow *s, int64_t i);
/* Solve for the cycles as they are; share (points): the largest use of any limit per segment. */
void    sj_follow_shares(const sj_follow *s, double *share);
void    sj_follow_read(const sj_follow *s, int64_t count, int64_t *length, double *jerk,
                       double *velocity, double *acceleration, double *last_jerk);
/* The samples of `count` segments as read, without the first knot's; the number of rows. */
typedef struct {
    double *position, *velocity, *acceleration, *jerk;  /* (rows, joints), per cycle */
} sj_follow_samples;

int64_t sj_follow_sample(int64_t count, int64_t joints, const double *position,
                         const double *velocity, const double *acceleration,
                         const double *last_jerk, const int64_t *length, const double *jerk,
                         const sj_follow_samples *out);

/* ---- peers: quadratic programmes of splines (_arrow.c) ------------------------------------------ */

enum sj_arrow_status {
    SJ_ARROW_OK = 0,
    SJ_ARROW_MOST = 1,                  /* not there after `most` steps; x is how far it came */
    SJ_ARROW_LOST = 2                   /* a number that is none */
};

/* Minimise gradient'x + 1/2 sum of weight (a'x - target)^2, low <= a'x <= high for every row a.
 * `unknowns` in a band, then `border` ones that every row may have. All memory is the caller's,
 * `spare` of sj_arrow_spare() doubles. */
typedef struct {
    int64_t unknowns;
    int64_t rows;
    int32_t band;                       /* how far apart the unknowns of a row are at most */
    int32_t border;
    int32_t width;                      /* coefficients per row, unused ones 0 at any place of it */
    int32_t most;                       /* steps */
    const int32_t *at;                  /* (rows, width), not falling */
    const double *value;                /* (rows, width) */
    const double *across;               /* (rows, border) */
    const double *low;                  /* (rows): -inf for none */
    const double *high;
    const double *weight;               /* (rows): 0 for none */
    const double *target;
    const double *gradient;             /* (unknowns + border) */
    double begin;                       /* slack times multiplier to begin with */
    double near;                        /* by how much rows may be missed */
    double gap;                         /* and the objective */
    double *x;                          /* in: where to begin */
    double *spare;
    double *told;                       /* (4): steps, misses, gap, gradient */
} sj_arrow;

int64_t sj_arrow_spare(int64_t unknowns, int32_t band, int32_t border, int64_t rows);
int32_t sj_arrow_solve(const sj_arrow *problem);

/* ---- peers: a path in play (_track.c: where, _pace.c: when) ------------------------------------ */

enum { SJ_TRACK_NUMBERS = 131072, SJ_TRACK_SEGMENTS = 2048 };

enum sj_track_status {
    SJ_TRACK_OK = 0,
    SJ_TRACK_FULL = 1,                  /* wait: nothing was taken */
    SJ_TRACK_ORDER = 2,                 /* not the segment that comes next */
    SJ_TRACK_LENGTH = 3,                /* phases out of range, or no rest at the end */
    SJ_TRACK_NUMBER = 4,                /* a number that is none */
    SJ_TRACK_BROKEN = 5,                /* does not go on where the segment before ends */
    SJ_TRACK_LIMIT = 6,                 /* velocity, acceleration or jerk beyond the axis' own */
    SJ_TRACK_POSITION = 7               /* leaves the position limits */
};

/* A segment for one axis: the way-point at its end, the continuous state at its first knot, the jerk
 * of the cycle before that, and one per phase. Per cycle, as `Followed` has them. */
typedef struct {
    double position, velocity, acceleration, last_jerk;
    double jerk[4];
} sj_track_axis;

typedef struct {
    int64_t begin;                      /* path cycle of its first knot */
    int64_t number;                     /* of the way-point at its end */
    int64_t cycles[4];
} sj_track_segment;

/* What an axis allows; the last two where its velocity becomes less. */
typedef struct {
    double velocity, acceleration, jerk, position_min, position_max;
    double deceleration, deceleration_jerk;
} sj_track_limits;

/* The window of a path: segments first .. first + count - 1, each in slot (index % capacity). */
typedef struct {
    int32_t axes, capacity;
    int64_t first, count;
    int64_t end;                        /* path cycle where what is known ends */
    int64_t number;                     /* of the way-point there */
    int32_t whole;                      /* 1: the path ends there */
    int32_t axis;                       /* that the last refusal was about */
    sj_track_limits limits[64];
    double way_point[64], velocity[64], acceleration[64], last_jerk[64]; /* there */
    sj_track_segment segment[2048];
    double row[131072];                 /* per segment nine columns of all axes */
} sj_track;

/* The phase that a place of the path lies in. */
typedef struct {
    int64_t segment, begin, end;        /* path cycles of the phase */
    int32_t phase, reserved;
    double P[64], V[64], A[64];         /* continuous at its begin; P from the segment's first way-point */
} sj_cursor;

void    sj_track_begin(sj_track *track, int32_t axes, const double *position,
                       const sj_track_limits *limits);
int32_t sj_track_add(sj_track *track, int64_t number, const int64_t *cycles, int32_t last,
                     const sj_track_axis *axis);
/* The same of a segment that needs no check; SJ_TRACK_OK or SJ_TRACK_FULL. */
int32_t sj_track_put(sj_track *track, int64_t number, const int64_t *cycles, int32_t last,
                     const sj_track_axis *axis);
/* Forget the segments whose way-point has this number or a later one. cycles > 0: so many of the first
 * of them stay, as the way to a way-point of that number. */
void    sj_track_cut(sj_track *track, int64_t number, int64_t cycles);
/* Segments before this one are not needed any more. */
void    sj_track_pass(sj_track *track, int64_t segment);
/* The phase of path cycle `cell`, the one from cell to cell + 1; 0, or -1: not known. */
int32_t sj_cursor_seek(const sj_track *track, int64_t cell, sj_cursor *cursor);
/* Positions so many cycles after the phase's begin; they are the samples where the path is run at
 * its speed. */
void    sj_cursor_position(const sj_track *track, const sj_cursor *cursor, double cycles,
                           double *position);
/* The sample after the phase's c-th cycle, bit for bit that of sj_follow_sample. */
void    sj_cursor_sample(const sj_track *track, const sj_cursor *cursor, int64_t c,
                         const sj_follow_samples *out);

/* ---- peers: states of an axis (_states.c) ---------------------------------------------------- */

enum {                                  /* PLCopen, motion control part 1: the state diagram */
    SJ_AXIS_DISABLED = 0,
    SJ_AXIS_STANDSTILL = 1,
    SJ_AXIS_DISCRETE = 2,               /* a motion that ends at rest */
    SJ_AXIS_CONTINUOUS = 3,
    SJ_AXIS_SYNCHRONIZED = 4,
    SJ_AXIS_HOMING = 5,
    SJ_AXIS_STOPPING = 6,
    SJ_AXIS_ERROR_STOP = 7,
    SJ_AXIS_STATES = 8
};

enum {                                  /* what leads from one to the next */
    SJ_TRIGGER_POWER_ON = 0,            /* the drive follows */
    SJ_TRIGGER_POWER_OFF = 1,
    SJ_TRIGGER_FAULT = 2,
    SJ_TRIGGER_RESET = 3,               /* the fault is gone */
    SJ_TRIGGER_MOVE = 4,
    SJ_TRIGGER_JOG = 5,
    SJ_TRIGGER_SYNCHRONIZE = 6,
    SJ_TRIGGER_HOME = 7,
    SJ_TRIGGER_HALT = 8,
    SJ_TRIGGER_QUICK_STOP = 9,
    SJ_TRIGGER_DONE = 10,               /* at rest */
    SJ_TRIGGERS = 11
};

/* The next state, or -1: refused in this state. */
int32_t sj_axis_next(int32_t state, int32_t trigger);

/* ---- wiring: interpolator (_kernel.c) ------------------------------------------------------- */

enum sj_load_status {
    SJ_LOAD_OK = 0,
    SJ_LOAD_PHASES = 1,                 /* a phase count or length out of range */
    SJ_LOAD_MISSES = 2                  /* the phases do not lead to the goal */
};

/* A phase as it is integrated: its jerk is the difference of two acceleration levels over its
 * length, so that an acceleration that is planned as zero is exactly zero. */
typedef struct {
    int64_t cycles;
    sj_exact jerk;
} sj_leg;

/* The bilinear integrator, Eqs. (15)-(17), in cycle units, and the legs ahead of it. */
typedef struct {
    sj_exact q, v, a, j;                /* the sample of this cycle */
    sj_exact spread_v, spread_q;        /* per cycle: what rounding the plan to doubles costs */
    double goal, goal_velocity;         /* the settled end, cycle N + 1 */
    int64_t left;                       /* cycles left of the present leg */
    int64_t ahead;                      /* cycles until settled; 0 = settled */
    int32_t leg, count;
    int32_t goal_free;                  /* 1: a change of velocity, the end position is open */
    int32_t reserved;
    sj_leg legs[SJ_PHASES];
} sj_interpolator;

/* Rows of a sampled motion; every column has room for `rows`. */
typedef struct {
    int64_t rows;
    double *time, *position, *velocity, *acceleration, *jerk;
} sj_table;

void    sj_interpolator_start(sj_interpolator *ip, const sj_state *sample);
int32_t sj_interpolator_load(sj_interpolator *ip, const sj_plan *plan, double goal,
                             double goal_velocity, int32_t goal_free);
int32_t sj_interpolator_step(sj_interpolator *ip);
void    sj_interpolator_fill(sj_interpolator *ip, double cycle_time_s, int64_t first_row,
                             const sj_table *out);
int32_t sj_sample(const sj_plan *plan, const void *start, const void *end,
                  double cycle_time_s, const sj_table *out);
void    sj_lemma_plan(const sj_state *sample, double jerk, sj_state *plan);
void    sj_lemma_sample(const sj_state *plan, double jerk, sj_state *sample);

/* ---- wiring: the pace of a path in play (_pace.c) -------------------------------------------- */

/* Axis-samples that one cycle checks at most, and what a plan counts as. */
enum { SJ_PACE_CHECKS = 1024, SJ_PACE_PLAN = 128, SJ_PACE_SEEN = 4 };

enum sj_pace_status {
    SJ_PACE_RUNS = 0,
    SJ_PACE_RESTS = 1,                  /* on the path, as it was told */
    SJ_PACE_STARVES = 2,                /* rests, or comes to rest, for want of segments */
    SJ_PACE_DONE = 3,                   /* on the last way-point */
    SJ_PACE_LOST = 4                    /* no place to go: what was known is over, in motion */
};

/* Path cycles passed, a motion of its own: speed 1 is the path as it was planned. */
typedef struct {
    sj_interpolator s;                  /* beyond `origin` */
    int64_t origin;
} sj_pace;

/* A pace on its track, cycle by cycle. */
typedef struct {
    sj_pace pace;
    sj_cursor cursor;
    double past[4][64];                 /* positions of the last four cycles, the newest first */
} sj_run;

enum sj_search_kind {
    SJ_SEARCH_NONE = 0,
    SJ_SEARCH_CHANGE = 1,               /* to another speed, as soon as possible */
    SJ_SEARCH_STOP = 2,                 /* at the end of what is known, as late as possible */
    SJ_SEARCH_AWAY = 3,                 /* above speed 1 for a while, and back */
    SJ_SEARCH_STAY = 4,                 /* there for longer */
    SJ_SEARCH_SOONER = 5                /* a change that is under way, harder */
};

/* The candidate that is being checked against the limits, over its whole way. */
typedef struct {
    int32_t kind;                       /* enum sj_search_kind */
    int32_t rung, share;                /* how hard, how much of what is wanted */
    int32_t stage;                      /* 0: none is under way */
    int32_t left;                       /* cycles of this stage */
    int32_t spent;                      /* 1: nothing found, and nothing has changed since */
    double to;
    int64_t known;                      /* end of the track it was made for */
    int64_t delay;                      /* cycles until it begins */
    int64_t cycle;                      /* of the run */
    int64_t begin, second_at;           /* cycles in which its plans begin; second: -1 none */
    int64_t again;                      /* cycle from which to look again */
    int64_t reach;                      /* path cycles that it counts on, but for a stop */
    sj_run run;
    sj_pace first, second;
} sj_search;

typedef struct {
    sj_track track;
    sj_run run;
    double velocity[64], acceleration[64], jerk[64];    /* of run.past[0] */
    double wish;                        /* speed, 0 .. 2 */
    double hardest_a, hardest_j;        /* of changes of speed */
    double below;                       /* the highest constant speed below 1 */
    double away;                        /* the wish that led above 1 */
    int64_t cycle;
    int64_t plain;                      /* cycles that were the path's own samples, in a row */
    sj_pace next, after;                /* checked: taken over in their cycles, one after the other */
    int64_t next_at, after_at;          /* after: -1 there is none */
    int64_t next_known;
    int32_t next_kind;                  /* enum sj_search_kind; NONE: there is none */
    int32_t begun, starves;
    int32_t rung, next_rung;            /* of the present motion, of the next */
    int32_t rests;                      /* cycles at rest in a row, or TAIL: differences are 0 */
    int64_t checked;                    /* path cycles that checked motions count on */
    sj_search search;
} sj_player;

/* Needs a begun track. */
void    sj_player_begin(sj_player *player);
/* In motion already, at speed 1 at the track's begin; the wish must stay 1 until four positions are
 * known, SJ_PACE_SEEN cycles. */
void    sj_player_enter(sj_player *player);
/* The positions of the next cycle, in run.past[0]; enum sj_pace_status. */
int32_t sj_player_step(sj_player *player);
double  sj_player_speed(const sj_player *player);
/* Whole path cycles passed, and the rest. */
int64_t sj_player_place(const sj_player *player, double *rest);
/* Drop the segments from this way-point on, but for so many cycles of the first one; -1: the place is
 * passed or not known, or a checked motion counts on what would go. Nothing has changed then. */
int32_t sj_player_cut(sj_player *player, int64_t number, int64_t cycles);
/* The state of an axis from which an interpolator goes on within the limits of its jerk. */
void    sj_player_hand_over(const sj_player *player, int32_t axis, sj_state *sample, double *jerk);

/* ---- wiring: commands and feedback of the cycle (_cycle.c) ------------------------------------ */

/* One cycle. Command and feedback are what the dual-port RAM carries; its layouts are hashed by
 * the host (field names, types and offsets). Positions in axis units, time in cycles. */
enum sj_result {                        /* what became of a goal */
    SJ_RESULT_NONE = 0,
    SJ_RESULT_ACCEPTED = 1,
    SJ_RESULT_NOT_FOLLOWING = 2,        /* refused: the drive does not follow (bit 12 = 0) */
    SJ_RESULT_PLAN = 3,                 /* refused: a number or limit that cannot be planned */
    SJ_RESULT_RANGE = 4,                /* refused: not a number, or beyond the drive's counter */
    SJ_RESULT_STOPPED = 5,              /* refused: came with a stop, or the kernel is ending */
    SJ_RESULT_LIMITS = 6,               /* refused: limits above those of the axis */
    SJ_RESULT_STATE = 7,                /* refused: the axis stops, homes, or has an error */
    SJ_RESULT_LIMIT = 8,                /* refused: it would leave the axis' position limits */
    SJ_RESULT_SPEED = 9,                /* refused: faster than the drive follows */
    SJ_RESULT_SUPERSEDED = 10,          /* never begun: cancelled, or a newer goal came */
    SJ_RESULT_KIND = 11,                /* refused: a record of no known kind, or out of place */
    SJ_RESULT_START = 12,               /* refused: the path does not begin where the axes are */
    SJ_RESULT_SEGMENT = 13,             /* refused: a segment is none, or does not go on from the last */
    SJ_RESULT_BEGUN = 14,               /* refused: what is to be replaced has begun */
    SJ_RESULTS = 15
};

enum sj_goal_kind {
    SJ_GOAL_NONE = 0,
    SJ_GOAL_ABSOLUTE = 1,
    SJ_GOAL_RELATIVE = 2,               /* `goal` is a distance from the commanded position */
    SJ_GOAL_JOG = 3,                    /* to goal_velocity, and to rest at a position limit */
    SJ_GOAL_HOME = 4                    /* the drive's own homing */
};

enum sj_event_kind {
    SJ_EVENT_GOAL = 0,                  /* code: enum sj_result of goal_id */
    SJ_EVENT_STATE = 1,                 /* code: new state of the axis, value: the one before */
    SJ_EVENT_HOST = 2,                  /* code: enum sj_shm_host_state */
    SJ_EVENT_SPOILT = 3,                /* a command or record that a wild writer had spoilt */
    SJ_EVENT_FAULT = 4,                 /* code: 603Fh of the axis' drive */
    SJ_EVENT_FOLLOWING = 5,             /* value: the following error, axis unit */
    SJ_EVENT_LATE = 6,                  /* value: cycles of the clock that were skipped */
    SJ_EVENT_ANCHOR = 7,                /* the drive left; the command is the actual position */
    SJ_EVENT_LIMITS = 8,                /* code: enum sj_result of new limits */
    SJ_EVENT_PATH = 9,                  /* code: new enum sj_path_state, value: way-point ahead */
    SJ_EVENT_REACHED = 10,              /* all axes are on the goal of goal_id, in this frame */
    SJ_EVENT_SYNC = 11,                 /* the axis lost its master; code: 603Fh, 0: its image is stale */
    SJ_EVENTS = 12
};

enum sj_cause {                         /* what a kernel can react to */
    SJ_CAUSE_HOST_DEATH = 0,
    SJ_CAUSE_HOST_SILENCE = 1,          /* only of a host that asked to be watched */
    SJ_CAUSE_DRIVE_FAULT = 2,           /* the other axes; the faulted one is its drive's */
    SJ_CAUSE_FOLLOWING_ERROR = 3,
    SJ_CAUSE_OVERRUN = 4,
    SJ_CAUSE_SPOILT = 5,
    SJ_CAUSE_SYNC_LOST = 6,             /* the other axes, as after a fault */
    SJ_CAUSES = 7
};

enum sj_reaction { SJ_REACT_NONE = 0, SJ_REACT_HALT = 1, SJ_REACT_QUICK_STOP = 2 };

typedef struct {
    uint64_t cycle, time_ns;            /* of the frame it happened in */
    uint64_t goal_id;
    double value;
    int32_t kind, axis, code, reserved; /* axis: -1 = all */
} sj_kernel_event;

typedef struct {
    double goal, goal_velocity;
    sj_limits limits;
    int32_t kind;                       /* enum sj_goal_kind; NONE: not for this axis */
    int32_t reserved;
} sj_axis_goal;

/* Levels for one path, by the goal id with which it was opened, whatever took over from it since;
 * another one runs at speed 1. */
typedef struct {
    uint64_t goal_id;
    double speed;                       /* 0 .. 2, times the override */
    int32_t pause, cancel;              /* 1: come to rest on the path; and forget it */
} sj_path_command;

/* Levels, and edges as counters: a new number is one edge, whatever was overwritten in between. */
typedef struct {
    sj_axis_goal goal;
    sj_limits limits;                   /* of the axis, taken when limit_sets is new */
    int32_t enable;
    uint32_t halts, quick_stops, resets, limit_sets;
    int32_t together;                   /* 1: this quick stop lasts as long as the longest with it */
} sj_axis_command;

typedef struct {
    uint64_t sequence;                  /* of this command; echoed */
    uint64_t goal_id;                   /* a new number is a new goal */
    int64_t least_cycles;               /* of this goal */
    int32_t synchronization;            /* of this goal: enum sj_synchronization */
    int32_t hold;                       /* 1: wait on the path */
    double override;                    /* of velocities, 0 .. 2 */
    uint64_t goal_records;              /* records published before this goal: it replaces them */
    uint64_t stop_records;              /* before the newest halt, quick stop or disable */
    uint64_t cancel_from, cancel_to;    /* records that are not to be begun, by number */
    uint64_t cancel_axes;               /* bit n: on axis n; taken when cancels is new */
    uint32_t cancels;
    int32_t reserved;
    sj_path_command path;
    sj_axis_command axis[64];
} sj_command;

/* A record of the look-ahead ring; one ring for queued moves and paths, in one order. Its number is
 * that of the ring, from 1. Goal ids of direct goals, moves and paths are one rising sequence. */
enum sj_record_kind {
    SJ_RECORD_MOVE = 1,                 /* a goal that waits for the one before */
    SJ_RECORD_PATH = 2,                 /* opens a path: its axes, its goal id */
    SJ_RECORD_SEGMENT = 3               /* a piece of it */
};

enum sj_buffer_mode {                   /* PLCopen: how a move follows the one before */
    SJ_BUFFER_ABORTING = 0,             /* at once; no record, a direct goal */
    SJ_BUFFER_BUFFERED = 1,             /* when it is done */
    SJ_BUFFER_LOW = 2,                  /* passes its goal at the lower of both velocities, */
    SJ_BUFFER_PREVIOUS = 3,             /* at the velocity of the one before, */
    SJ_BUFFER_NEXT = 4,                 /* of the next, */
    SJ_BUFFER_HIGH = 5                  /* at the higher */
};

typedef struct {
    sj_axis_goal goal;                  /* MOVE; of every kind: NONE = not for this axis */
    double position;                    /* SEGMENT: way-point at its end; PATH: the first one */
    double velocity, acceleration, last_jerk;   /* continuous state at its first knot, per cycle */
    double jerk[4];                     /* of its phases */
} sj_axis_record;

typedef struct {
    uint64_t goal_id;
    uint64_t number;                    /* SEGMENT: of the way-point at its end; PATH: 0, or the one
                                           from which it replaces the path that runs */
    int64_t cycles[4];                  /* SEGMENT: its phases; PATH: the first, so many cycles after
                                           the way-point before that one */
    int64_t least_cycles;               /* MOVE */
    int32_t kind;                       /* enum sj_record_kind */
    int32_t mode;                       /* MOVE: enum sj_buffer_mode */
    int32_t synchronization;            /* MOVE: enum sj_synchronization */
    int32_t last;                       /* SEGMENT: 1 = the path ends with it */
    sj_axis_record axis[64];            /* as many as the kernel has */
} sj_record;

typedef struct {
    double position, velocity, acceleration, jerk;      /* commanded sample */
    double actual_position, actual_velocity;            /* of the encoder; unit and unit/cycle */
    double peak_velocity, peak_acceleration, peak_jerk; /* of the command since the goal came */
    double goal;
    uint64_t goal_id;                   /* goal in execution or done */
    int64_t target_counts, actual_counts;               /* unwrapped, encoder increments */
    int32_t following_error;            /* 60F4h */
    uint16_t statusword, error_code;
    int32_t moving, settled;            /* settled: on the goal, or past it at its velocity */
    int32_t follows, enabled, fault;
    int32_t state;                      /* SJ_AXIS_... */
    int32_t enable;                     /* levels and counters of the command, as taken */
    uint32_t halts, quick_stops, resets, limit_sets;
    int32_t external;                   /* its drive is outside the kernel */
    sj_limits limits;                   /* in force */
    double position_min, position_max;
    double counts_per_unit, wrap;       /* wrap: axis units per turn, 0 = none */
    char unit[16];
} sj_axis_feedback;

enum sj_path_state {
    SJ_PATH_NONE = 0,                   /* there was none yet */
    SJ_PATH_RUNS = 1,
    SJ_PATH_PAUSED = 2,                 /* at rest on it: pause, hold, speed 0 */
    SJ_PATH_STARVES = 3,                /* stops or rests on it for want of segments */
    SJ_PATH_STOPS = 4,                  /* on it, to be forgotten */
    SJ_PATH_DONE = 5,                   /* on its last way-point */
    SJ_PATH_STOPPED = 6,                /* at rest on it, and forgotten */
    SJ_PATH_LEFT = 7                    /* by a quick stop, a goal, or for want of segments */
};

/* The path in play, or the last one. */
typedef struct {
    uint64_t goal_id, axes;             /* bit n: axis n */
    int64_t number;                     /* of the way-point ahead */
    int64_t known;                      /* of the last one taken */
    double cycle;                       /* passed since the way-point before, path cycles */
    double speed;                       /* 1 = as planned */
    int32_t state;                      /* enum sj_path_state */
    int32_t result;                     /* enum sj_result of its segments */
} sj_path_feedback;

enum { SJ_HISTOGRAM_BUCKETS = 400 };

/* Durations in ns: 16 buckets per octave from 64 ns on; `late` counts deadlines that passed. */
typedef struct {
    uint64_t count, worst_ns;
    uint32_t bucket[400];
} sj_histogram;

enum sj_grant {                         /* or an errno, negative: asked, refused, and why */
    SJ_GRANT_NOT_ASKED = 0,
    SJ_GRANT_FULL = 1,
    SJ_GRANT_PART = 2                   /* memory: what the cycle touches, not the whole process */
};

typedef struct {
    uint64_t period_ns;
    uint64_t spin_ns;                   /* busy wait before each deadline, at most; 0 = sleep only */
    int32_t priority;                   /* SCHED_FIFO 1..99; 0 = not asked */
    int32_t cpu;                        /* pin to this processor; -1 = not asked */
    int32_t lock_memory;                /* 1: lock and touch all memory of the cycle */
    int32_t reserved;
} sj_clock_options;

typedef struct {
    sj_clock_options asked;
    int32_t priority, cpu, memory;      /* enum sj_grant */
    int32_t capped;                     /* 1: the busy wait is shorter than asked */
    double share;                       /* of the processor that a real-time thread may use, or 1 */
    uint64_t spin_ns;                   /* busy wait of an idle cycle */
} sj_clock_report;

/* Times first: a kernel in a caller's own loop has none and publishes from `cycle` on. */
typedef struct {
    sj_histogram latency, period, computing;
    sj_clock_report clock;
    uint64_t cycle;                     /* cycles since start */
    uint64_t time_ns;                   /* CLOCK_MONOTONIC at its begin, 0 in a caller's own loop */
    uint64_t sequence;                  /* newest command taken */
    uint64_t result_goal_id;            /* goal that `result` is about */
    uint64_t late;                      /* cycles of the clock that were skipped */
    uint64_t corrupt;                   /* commands that a wild writer had spoilt */
    uint64_t kernel_epoch;              /* which kernel this frame is of */
    double cycle_time_s, override;
    int32_t result, result_axis;        /* enum sj_result; axis that refused, or -1 */
    uint64_t paced;                     /* bit n: axis n is on the way of its move at another pace */
    int32_t axes, ending, hold;
    int32_t ring_spoilt;                /* 1: no record is taken until the host flushes the ring */
    sj_path_feedback path;
    sj_axis_feedback axis[64];
} sj_feedback;

typedef struct {
    sj_limits limits, stop_limits;      /* per cycle; of halts, of quick stops */
    double position_min, position_max;  /* axis unit; -inf and inf: none */
    double counts_per_unit;
    double following_limit;             /* axis unit; inf: not watched */
    double velocity_max;                /* per cycle: what the drive follows; inf: unknown */
    double wrap;
    int32_t external;                   /* 1: rx and tx are exchanged by the caller */
    int32_t ideal;                      /* 1: a drive without mechanics, always on its target */
    char unit[16];
} sj_axis_config;

/* The trace: what each cycle took from outside and what it gave, in the order of the cycle. An item
 * is one event of a segment of its own (sj_event_publish); a cycle's items end with its frame. With
 * the inputs alone the same cycle gives the same frames, bit for bit. */
enum sj_trace_kind {
    SJ_TRACE_FRAME = 0,                 /* sj_trace_frame */
    SJ_TRACE_COMMAND = 1,               /* a command as it was taken */
    SJ_TRACE_EVENT = 2,                 /* sj_kernel_event */
    SJ_TRACE_RECORD = 3                 /* a record of the ring as it was taken */
};

enum sj_trace_flag {
    SJ_TRACE_MOVING = 1,
    SJ_TRACE_SETTLED = 2,
    SJ_TRACE_FOLLOWS = 4,
    SJ_TRACE_PARKED = 8,
    SJ_TRACE_DRIVE_STOP = 16,
    SJ_TRACE_LED = 32,                  /* by a path */
    SJ_TRACE_STALE = 64,
    SJ_TRACE_PACED = 128                /* on the way of its move, at another pace */
};

typedef struct {
    uint64_t cycle;
    uint64_t number;                    /* of a record in its ring */
    int32_t kind;                       /* enum sj_trace_kind */
    int32_t reserved;
} sj_trace_head;

typedef struct {
    double position, velocity, acceleration, jerk;      /* commanded sample, per cycle */
    double goal;
    sj_limits limits;                   /* of the axis, in force */
    uint64_t goal_id;
    int64_t target_counts, actual_counts;               /* unwrapped, encoder increments */
    int32_t velocity_actual, following_error;           /* 606Ch, 60F4h */
    uint16_t statusword, error_code;                    /* 6041h, 603Fh */
    int16_t torque_actual;                              /* 6077h */
    int8_t mode_display;                                /* 6061h */
    uint8_t state;                                      /* SJ_AXIS_... */
    uint32_t flags;                                     /* enum sj_trace_flag */
    uint32_t reserved;
} sj_axis_trace;

typedef struct {
    sj_trace_head head;
    uint64_t time_ns;                   /* of the cycle's begin, as it was given */
    uint64_t late;                      /* inputs: cycles skipped so far, */
    uint64_t ring_seen;                 /* records published at the begin, */
    uint64_t ring_published;            /* and once the command was collected, */
    uint64_t ring_taken;                /* taken or discarded at the end, */
    int32_t host_state, ending;         /* the host as seen, the order to end, */
    int32_t collected;                  /* what the collection of the command said, */
    int32_t ring_status;                /* and the last taking of a record where it was none */
    uint64_t sequence;                  /* newest command taken */
    double override;
    int32_t hold, reserved;
    sj_axis_trace axis[64];
} sj_trace_frame;

typedef struct {
    sj_trace_head head;
    uint64_t payload[1100];             /* command, record or event, as its bytes */
} sj_trace_message;

typedef union {
    sj_trace_frame frame;
    sj_trace_message message;
} sj_trace_item;

/* Rows of cycle, number (both 64 bits) and payload. */
typedef struct {
    const uint8_t *at;
    int64_t count;
} sj_trace_rows;

/* What a cycle of a replay is given instead of the segment; then its frame must come out. */
typedef struct {
    const sj_trace_frame *frame;        /* as recorded, or NULL: no replay */
    sj_trace_rows commands, records;    /* to come */
} sj_trace_given;

typedef struct {
    sj_interpolator interpolator;
    sj_drive drive;
    sj_axis_config config;
    sj_axis_goal goal;                  /* in execution, or reached; absolute */
    sj_limits ceiling;                  /* the largest of the axis since it last was at rest */
    double start;                       /* where the goal's motion began */
    double line;                        /* its share of a straight line, 0: not on one */
    int64_t actual_counts;              /* 6064h unwrapped */
    int64_t target_counts;              /* sent last */
    int64_t least_cycles;
    uint64_t goal_id, goal_axes;        /* goal_axes: bit n = axis n */
    int32_t synchronization;
    int32_t state;                      /* SJ_AXIS_... */
    int32_t following;                  /* the command leads, the drive follows */
    int32_t parked;                     /* held on its way to the goal */
    int32_t reached;                    /* has been on the goal */
    int32_t onward;                     /* passes its goal; a queued move takes over there */
    int32_t error;                      /* stopped by the kernel; until reset */
    int32_t enable;
    int32_t reset;                      /* cycles left of a fault reset's edge */
    int32_t homing;                     /* cycles since the order, 0 = none */
    int32_t resting, still;             /* cycles since the command, the motor came to rest */
    int32_t reserved;
    int32_t drive_stop;                 /* 1: the drive's own quick stop; the planner could not */
    uint32_t halts, quick_stops, resets, limit_sets;
} sj_axis;

/* ---- wiring: look-ahead (_ahead.c) ----------------------------------------------------------- */

enum {
    SJ_AHEAD = 32,                      /* most records that are taken and wait for their turn */
    SJ_AHEAD_TAKES = 4,                 /* most that one cycle takes, */
    SJ_AHEAD_PASSES = 32,               /* beside those that are not to be begun */
    SJ_AHEAD_DROPS = 4                  /* most orders to drop that are remembered */
};

typedef struct {
    sj_record record;
    uint64_t number;                    /* of the ring */
    uint64_t axes;                      /* bit n: axis n */
    uint64_t passing;                   /* axes of the move before that pass their goal for it */
    double share;                       /* of the velocity to pass with; what is tried next */
    int32_t spent;                      /* has its answer; begun only to come to rest */
    int32_t refused;                    /* the axis that a refusal is about, or -1 */
} sj_held;

/* Records first .. last of these axes are not begun. */
typedef struct {
    uint64_t first, last, axes;
    int32_t result;                     /* their answer */
    int32_t reserved;
} sj_drop;

typedef struct {
    uint64_t seen;                      /* records published before this cycle's command was taken */
    uint64_t stop;                      /* of these a stop in this cycle means the ones up to here */
    int32_t count;                      /* records that wait: held[order[0 .. count - 1]] */
    int32_t drops;
    int32_t order[32];                  /* a permutation; the rest are free */
    sj_drop drop[4];
    sj_held held[32];
} sj_ahead;

uint64_t sj_record_bytes(int32_t axes);

/* ---- wiring: the path in play (_path.c) ------------------------------------------------------ */

typedef struct {
    uint64_t goal_id, newest;           /* newest: highest id a record of a path had */
    uint64_t root;                      /* of the path that was opened; others took over from it */
    uint64_t led;                       /* bit n: axis n is led by it; 0: none is in play */
    int32_t count;                      /* of its axes */
    int32_t cancelled;
    int32_t axis[64];                   /* of the kernel, by axis of the track */
    sj_player player;
} sj_path;

/* ---- wiring: moves that are held on their way (_paced.c) -------------------------------------- */

/* Axes of synchronised moves, one pace for all of them. */
typedef struct {
    uint64_t axes;                      /* bit n: axis n is led by it; 0: none is */
    double override;                    /* under which they were planned */
    int64_t at;                         /* cycles that `way` has gone */
    int32_t count, reserved;
    int32_t axis[64];                   /* of the kernel, by axis of the track */
    sj_interpolator way[64];            /* the moves as planned */
    sj_player player;
} sj_paced;

typedef struct {
    void *segment;
    int32_t axes;
    int32_t ending;                     /* 1: stop, disable, refuse goals */
    int32_t ended;                      /* the end has been seen */
    int32_t host_state;
    int32_t hold;
    uint32_t cancels;
    int32_t collected;                  /* status of this cycle's collection of the command */
    int32_t quiet;                      /* 1: nobody reads the feedback of this cycle (_virtual.c) */
    int32_t own_loop;                   /* 1: nothing clocks it; frames are without times */
    int32_t pad;
    double override;
    uint64_t goal_id, late;
    uint64_t host_epoch;                /* of the host seen last */
    uint64_t ring_seen, ring_published, ring_taken;     /* of this cycle */
    int32_t ring_status;
    int32_t reserved;
    void *trace;                        /* segment of the trace, or NULL */
    sj_trace_frame *frame_out;          /* where this cycle's frame goes too, or NULL */
    sj_trace_given given;
    sj_trace_item item;                 /* of the trace, under the pen */
    int32_t reaction[8];                /* enum sj_reaction by enum sj_cause */
    sj_command incoming;                /* what collect fills; spoilt where it fails */
    sj_command command;
    sj_feedback feedback;
    sj_plan plan[64];                   /* room for planning a goal */
    sj_interpolator trial[64];
    sj_ahead ahead;
    sj_path path;
    sj_paced paced;
    sj_drive_rx rx[64];                 /* process image: to the drives, from the drives */
    sj_drive_tx tx[64];
    int32_t stale[64];                  /* caller: 1, nothing of this drive came in time */
    sj_axis axis[64];
} sj_kernel;

uint64_t sj_command_bytes(int32_t axes);
uint64_t sj_feedback_bytes(int32_t axes);
uint64_t sj_feedback_times(void);       /* bytes before `cycle` */
int32_t  sj_kernel_init(sj_kernel *kernel, void *segment, int32_t axes, double cycle_time_s);
int32_t  sj_kernel_axis(sj_kernel *kernel, int32_t axis, const sj_drive_config *drive,
                        const sj_axis_config *config);
void     sj_kernel_cycle(sj_kernel *kernel, uint64_t now_ns);
void     sj_kernel_cycles(sj_kernel *kernel, int64_t cycles); /* in a caller's own loop */
void     sj_kernel_step(sj_kernel *kernel);                   /* the same, one */
/* Between cycles: a plan that nothing uses, so that the planner is in the caches when it is needed. */
void     sj_goal_rehearse(sj_kernel *kernel);
/* Before a cycle, while there is time: it runs on a copy, so that code and data are in the caches. The
 * copy: of as many axes, with a segment of its own. */
void     sj_kernel_rehearse(const sj_kernel *kernel, sj_kernel *copy);
int32_t  sj_kernel_at_rest(const sj_kernel *kernel);    /* nothing moves, no drive is enabled */

/* ---- wiring: trace (_trace.c) and virtual time (_virtual.c) ---------------------------------- */

uint64_t sj_trace_frame_bytes(int32_t axes);
uint64_t sj_trace_item_bytes(int32_t axes);             /* of one event of the trace's segment */
/* As sj_shm_host_state; DEAD for one cycle too where the next host came before it was noticed. */
int32_t  sj_trace_host(sj_kernel *kernel, uint64_t now_ns);
void     sj_trace_see(sj_kernel *kernel);               /* the ring's counters, at the begin */
int32_t  sj_trace_collect(sj_kernel *kernel);           /* as sj_command_collect, into incoming */
int32_t  sj_trace_take(sj_kernel *kernel, sj_record *record);   /* as sj_ring_take */
void     sj_trace_event(sj_kernel *kernel, const sj_kernel_event *event);
void     sj_trace_close(sj_kernel *kernel);             /* the frame of this cycle */
/* Items after *cursor, at most `room`, back to back; how many. Any process, at any time. */
int64_t  sj_trace_drain(const void *segment, uint64_t *cursor, uint64_t *missed, int64_t room,
                        void *items);

/* Cycles in virtual time from now_ns on; `frames` (one each, back to back) may be NULL. */
void     sj_virtual_run(sj_kernel *kernel, int64_t cycles, uint64_t now_ns, uint64_t period_ns,
                        void *frames);
/* Recorded cycles again. Returns how many came out the same, bit for bit; where one did not, its
 * frame is in kernel->item. */
int64_t  sj_virtual_replay(sj_kernel *kernel, int64_t cycles, const void *frames,
                           int64_t command_count, const void *commands, int64_t record_count,
                           const void *records);
/* A drive without mechanics: its state machine by the words, its position the target's. */
void     sj_ideal_cycle(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx);

/* ---- wiring: the clock (_clock.c) ------------------------------------------------------------ */

/* Ask the system for what `options` says, for the calling thread; `report` tells what it gave. */
void     sj_clock_prepare(const sj_kernel *kernel, uint64_t bytes, const sj_clock_options *options,
                          sj_clock_report *report);
/* copy: for rehearsals, or NULL for none. */
void     sj_clock_run(sj_kernel *kernel, sj_kernel *copy, const sj_clock_options *options,
                      int32_t *end);
/* Longest busy wait of one cycle that keeps this share of the processor, computing included. */
uint64_t sj_clock_spin_ns(const sj_clock_options *options, double share, uint64_t computing_ns);
void     sj_clock_end(int32_t *end);
uint64_t sj_clock_now_ns(void);
void     sj_histogram_add(sj_histogram *histogram, uint64_t ns);
