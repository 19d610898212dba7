/* What the dual-port RAM carries: commands, records, feedback, events. */
#pragma once
#include <stdint.h>
#include "base/_types.h"

/* One cycle. Command and feedback are what the dual-port RAM carries; its layouts are hashed by
 * the host (field names, types and offsets). Positions in axis units, time in cycles. */
/* what became of a goal */
enum sj_result {
    SJ_RESULT_NONE = 0,
    SJ_RESULT_ACCEPTED = 1,
    SJ_RESULT_NOT_FOLLOWING = 2, /* refused: the drive does not follow (bit 12 = 0) */
    SJ_RESULT_PLAN = 3,          /* refused: a number or limit that cannot be planned */
    SJ_RESULT_RANGE = 4,         /* refused: not a number, or beyond the drive's counter */
    SJ_RESULT_STOPPED = 5,       /* refused: came with a stop, or the kernel is ending */
    SJ_RESULT_LIMITS = 6,        /* refused: limits above those of the axis */
    SJ_RESULT_STATE = 7,         /* refused: the axis stops, homes, or has an error */
    SJ_RESULT_LIMIT = 8,         /* refused: it would leave the axis' position limits */
    SJ_RESULT_SPEED = 9,         /* refused: faster than the drive follows */
    SJ_RESULT_SUPERSEDED = 10,   /* never begun: cancelled, or a newer goal came */
    SJ_RESULT_KIND = 11,         /* refused: a record of no known kind, or out of place */
    SJ_RESULT_START = 12,        /* refused: the path does not begin where the axes are */
    SJ_RESULT_SEGMENT = 13,      /* refused: a segment is none, or does not go on from the last */
    SJ_RESULT_BEGUN = 14,        /* refused: what is to be replaced has begun */
    SJ_RESULTS = 15
};

enum sj_goal_kind {
    SJ_GOAL_NONE = 0,
    SJ_GOAL_ABSOLUTE = 1,
    SJ_GOAL_RELATIVE = 2, /* `goal` is a distance from the commanded position */
    SJ_GOAL_JOG = 3,      /* to goal_velocity, and to rest at a position limit */
    SJ_GOAL_HOME = 4      /* the drive's own homing */
};

enum sj_event_kind {
    SJ_EVENT_GOAL = 0,      /* code: enum sj_result of goal_id */
    SJ_EVENT_STATE = 1,     /* code: new state of the axis, value: the one before */
    SJ_EVENT_HOST = 2,      /* code: enum sj_shm_host_state */
    SJ_EVENT_CORRUPT = 3,   /* a command or record that a wild writer made corrupt */
    SJ_EVENT_FAULT = 4,     /* code: 603Fh of the axis' drive */
    SJ_EVENT_FOLLOWING = 5, /* value: the following error, axis unit */
    SJ_EVENT_LATE = 6,      /* value: cycles of the clock that were skipped */
    SJ_EVENT_ANCHOR = 7,    /* the drive left; the command is the actual position */
    SJ_EVENT_LIMITS = 8,    /* code: enum sj_result of new limits */
    SJ_EVENT_PATH = 9,      /* code: new enum sj_path_state, value: next way-point */
    SJ_EVENT_REACHED = 10,  /* all axes are on the goal of goal_id, in this frame */
    SJ_EVENT_SYNC = 11,     /* the axis lost its master; code: 603Fh, 0: its image is stale */
    SJ_EVENT_STOP = 12,     /* asked beside the host; code: enum sj_reaction, value: the
                                           process that asked, 0: not known */
    SJ_EVENT_SWITCH = 13,   /* a limit switch closed or opened; code: 60FDh bits 0 (negative)
                                           and 1 (positive), value: these before */
    SJ_EVENTS = 14
};

/* what a kernel can react to */
enum sj_cause {
    SJ_CAUSE_HOST_DEATH = 0,
    SJ_CAUSE_HOST_SILENCE = 1, /* only of a host that asked to be watched */
    SJ_CAUSE_DRIVE_FAULT = 2,  /* the other axes; the faulted one is its drive's */
    SJ_CAUSE_FOLLOWING_ERROR = 3,
    SJ_CAUSE_OVERRUN = 4,
    SJ_CAUSE_CORRUPT = 5,
    SJ_CAUSE_SYNC_LOST = 6, /* the other axes, as after a fault */
    SJ_CAUSES = 7
};

enum sj_reaction { SJ_REACT_NONE = 0, SJ_REACT_HALT = 1, SJ_REACT_QUICK_STOP = 2 };

typedef struct {
    uint64_t cycle, time_ns; /* of the frame it happened in */
    uint64_t goal_id;
    double value;
    int32_t kind, axis, code, reserved; /* axis: -1 = all */
} sj_kernel_event;

typedef struct {
    double goal, goal_velocity;
    sj_limits limits;
    int32_t kind; /* enum sj_goal_kind; NONE: not for this axis */
    int32_t reserved;
} sj_axis_goal;

/* Levels for one path, by the goal id with which it was opened, whatever took over from it since;
 * another one runs at speed 1. */
typedef struct {
    uint64_t goal_id;
    double speed;          /* 0 .. 2, times the override */
    int32_t pause, cancel; /* 1: come to rest on the path; and forget it */
} sj_path_command;

/* Levels, and edges as counters: a new number is one edge, whatever was overwritten in between. */
typedef struct {
    sj_axis_goal goal;
    sj_limits limits; /* of the axis, taken when limit_sets is new */
    int32_t enable;
    uint32_t halts, quick_stops, resets, limit_sets;
    int32_t together; /* 1: this quick stop lasts as long as the longest with it */
} sj_axis_command;

typedef struct {
    uint64_t sequence;               /* of this command; echoed */
    uint64_t goal_id;                /* a new number is a new goal */
    int64_t least_cycles;            /* of this goal */
    int32_t synchronization;         /* of this goal: enum sj_synchronization */
    int32_t hold;                    /* 1: wait on the path */
    double override;                 /* of velocities, 0 .. 2 */
    uint64_t goal_records;           /* records published before this goal: it replaces them */
    uint64_t stop_records;           /* before the newest halt, quick stop or disable */
    uint64_t cancel_from, cancel_to; /* records that are not to be begun, by number */
    uint64_t cancel_axes;            /* bit n: on axis n; taken when cancels is new */
    uint32_t cancels;
    int32_t reserved;
    sj_path_command path;
    sj_axis_command axis[64];
} sj_command;

/* A record of the look-ahead ring; one ring for queued moves and paths, in one order. Its number is
 * that of the ring, from 1. Goal ids of direct goals, moves and paths are one rising sequence. */
enum sj_record_kind {
    SJ_RECORD_MOVE = 1,   /* a goal that waits for the one before */
    SJ_RECORD_PATH = 2,   /* opens a path: its axes, its goal id */
    SJ_RECORD_SEGMENT = 3 /* a piece of it */
};

/* PLCopen: how a move follows the one before */
enum sj_buffer_mode {
    SJ_BUFFER_ABORTING = 0, /* at once; no record, a direct goal */
    SJ_BUFFER_BUFFERED = 1, /* when it is done */
    SJ_BUFFER_LOW = 2,      /* passes its goal at the lower of both velocities, */
    SJ_BUFFER_PREVIOUS = 3, /* at the velocity of the one before, */
    SJ_BUFFER_NEXT = 4,     /* of the next, */
    SJ_BUFFER_HIGH = 5      /* at the higher */
};

typedef struct {
    sj_axis_goal goal; /* MOVE; of every kind: NONE = not for this axis */
    double position;   /* SEGMENT: way-point at its end; PATH: the first one */
    double velocity, acceleration, last_jerk; /* continuous state at its first knot, per cycle */
    double jerk[4];                           /* of its phases */
} sj_axis_record;

typedef struct {
    uint64_t goal_id;
    uint64_t number;         /* SEGMENT: of the way-point at its end; PATH: 0, or the one
                                           from which it replaces the path that runs */
    int64_t cycles[4];       /* SEGMENT: its phases; PATH: the first, so many cycles after
                                           the way-point before that one */
    int64_t least_cycles;    /* MOVE */
    int32_t kind;            /* enum sj_record_kind */
    int32_t mode;            /* MOVE: enum sj_buffer_mode */
    int32_t synchronization; /* MOVE: enum sj_synchronization */
    int32_t last;            /* SEGMENT: 1 = the path ends with it */
    sj_axis_record axis[64]; /* as many as the kernel has */
} sj_record;

/* A drive outside the kernel, as the port that reaches it sees it. */
typedef struct {
    uint64_t lost;   /* cycles without an answer of this drive, */
    uint64_t wrong;  /* and those of them in which its frame came, with another working counter */
    int32_t in_row;  /* cycles without an answer, the last ones; it stays at its largest number */
    int32_t counter; /* working counter, of the last frame that came */
    uint16_t state, code; /* 0130h, 0134h; 0: not known */
    uint32_t present;     /* 1: a port exchanges this drive */
} sj_axis_bus;

typedef struct {
    double position, velocity, acceleration, jerk;      /* commanded sample */
    double actual_position, actual_velocity;            /* of the encoder; unit and unit/cycle */
    double peak_velocity, peak_acceleration, peak_jerk; /* of the command since the goal came */
    double goal;
    uint64_t goal_id;                     /* goal in execution or done */
    int64_t target_counts, actual_counts; /* unwrapped, encoder increments */
    int32_t following_error;              /* 60F4h */
    uint16_t statusword, error_code;
    uint32_t digital_inputs; /* 60FDh */
    int32_t velocity_offset; /* 60B1h, 60B2h: what the kernel feeds forward */
    int32_t torque_offset, reserved;
    int32_t moving, settled; /* settled: on the goal, or past it at its velocity */
    int32_t follows, enabled, fault;
    int32_t state;  /* SJ_AXIS_... */
    int32_t enable; /* levels and counters of the command, as taken */
    uint32_t halts, quick_stops, resets, limit_sets;
    int32_t external; /* its drive is outside the kernel */
    sj_limits limits; /* in force */
    double position_min, position_max;
    double counts_per_unit, wrap; /* wrap: axis units per turn, 0 = none */
    char unit[16];
    char name[64];
    sj_axis_bus bus;
} sj_axis_feedback;

enum sj_path_state {
    SJ_PATH_NONE = 0, /* there was none yet */
    SJ_PATH_RUNS = 1,
    SJ_PATH_PAUSED = 2,  /* at rest on it: pause, hold, speed 0 */
    SJ_PATH_STARVES = 3, /* stops, or is at rest, on it for want of segments */
    SJ_PATH_STOPS = 4,   /* on it, to be forgotten */
    SJ_PATH_DONE = 5,    /* on its last way-point */
    SJ_PATH_STOPPED = 6, /* at rest on it, and forgotten */
    SJ_PATH_LEFT = 7     /* by a quick stop, a goal, or for want of segments */
};

/* The path in play, or the last one. */
typedef struct {
    uint64_t goal_id, axes; /* bit n: axis n */
    int64_t number;         /* of the next way-point */
    int64_t known;          /* of the last one taken */
    double cycle;           /* passed since the way-point before, path cycles */
    double speed;           /* 1 = as planned */
    int32_t state;          /* enum sj_path_state */
    int32_t result;         /* enum sj_result of its segments */
} sj_path_feedback;

/* The bus of drives outside the kernel; all zero where there is none. */
typedef struct {
    uint64_t sent;         /* frames */
    uint64_t lost;         /* that did not come back in their cycle */
    uint64_t stray;        /* frames that came and answer nothing that waits */
    int64_t phase_ns;      /* of the cycle against the drives' clock: more than wanted */
    int64_t worst_ns;      /* largest magnitude of it since it was first aligned */
    int64_t correction_ns; /* of the last deadline */
    int32_t devices;       /* that a port exchanges */
    int32_t present;       /* that answered last */
    int32_t states;        /* bitwise or of their 0130h */
    int32_t aligned;       /* 1: the clocks have been together for a while */
    int32_t foreign;       /* 1: another main device has taken the drives */
    int32_t reserved;
} sj_bus_feedback;

enum { SJ_HISTOGRAM_BUCKETS = 400 };

/* Durations in ns: 16 buckets per octave from 64 ns on; `late` counts deadlines that passed. */
typedef struct {
    uint64_t count, worst_ns;
    uint32_t bucket[400];
} sj_histogram;

/* or an errno, negative: asked, refused, and why */
enum sj_grant {
    SJ_GRANT_NOT_ASKED = 0,
    SJ_GRANT_FULL = 1,
    SJ_GRANT_PART = 2 /* memory: what the cycle touches, not the whole process */
};

typedef struct {
    uint64_t period_ns;
    uint64_t spin_ns;    /* busy wait before each deadline, at most; 0 = sleep only */
    int32_t priority;    /* SCHED_FIFO 1..99; 0 = not asked */
    int32_t cpu;         /* pin to this processor; -1 = not asked */
    int32_t lock_memory; /* 1: lock and touch all memory of the cycle */
    int32_t reserved;
} sj_clock_options;

typedef struct {
    sj_clock_options asked;
    int32_t priority, cpu, memory; /* enum sj_grant */
    int32_t capped;                /* 1: the busy wait is shorter than asked */
    double share;                  /* of the processor that a real-time thread may use, or 1 */
    uint64_t spin_ns;              /* busy wait of an idle cycle */
} sj_clock_report;

/* Times first: a kernel in a caller's own loop has none and publishes from `cycle` on. */
typedef struct {
    sj_histogram latency, period, computing;
    sj_clock_report clock;
    uint64_t cycle;          /* cycles since start */
    uint64_t time_ns;        /* CLOCK_MONOTONIC at its begin, 0 in a caller's own loop */
    uint64_t sequence;       /* newest command taken */
    uint64_t result_goal_id; /* goal that `result` is about */
    uint64_t late;           /* cycles of the clock that were skipped */
    uint64_t corrupt;        /* commands that a wild writer made corrupt */
    uint64_t kernel_epoch;   /* which kernel this frame is of */
    double cycle_time_s, override;
    int32_t result, result_axis; /* enum sj_result; axis that refused, or -1 */
    uint64_t feed_hold;          /* bit n: axis n is on its planned path, at another feed */
    int32_t axes, ending, hold;
    int32_t ring_corrupt; /* 1: no record is taken until the host flushes the ring */
    sj_path_feedback path;
    sj_bus_feedback bus;
    sj_axis_feedback axis[64];
} sj_feedback;

/* Of so many axes. */
uint64_t sj_command_bytes(int32_t axes);
uint64_t sj_record_bytes(int32_t axes);
uint64_t sj_feedback_bytes(int32_t axes);
uint64_t sj_feedback_times(void); /* bytes before `cycle` */
