/* The state of a kernel and of its axes, and the cycle. */
#pragma once
#include <stdint.h>
#include "_kernel.h"
#include "cycle/_payload.h"
#include "cycle/_states.h"
#include "cycle/_trace_items.h"
#include "drive/_drive.h"
#include "planner/_planner.h"
#include "trajectory/_pace.h"

/* Words of the drive per axis unit and cycle; all 0: nothing is fed forward. */
typedef struct {
    double velocity;      /* 60B1h per axis unit/cycle */
    double inertia;       /* 60B2h per axis unit/cycle^2 */
    double friction;      /* 60B2h, far above friction_step */
    double friction_step; /* axis unit/cycle */
    double viscous;       /* 60B2h per axis unit/cycle */
    double load;          /* 60B2h, a whole number */
} sj_feed_forward;

typedef struct {
    sj_limits limits, stop_limits;     /* per cycle; of halts, of quick stops */
    double position_min, position_max; /* axis unit; -inf and inf: none */
    double counts_per_unit;
    double following_limit; /* axis unit; inf: not watched */
    double velocity_max;    /* per cycle: what the drive follows; inf: unknown */
    double wrap;
    sj_feed_forward feed_forward;
    double start;     /* axis unit; where a simulated drive stands before the first cycle */
    int32_t external; /* 1: rx and tx are exchanged by the caller */
    int32_t ideal;    /* 1: a drive without mechanics, always on its target */
    char unit[16];
    char name[64];
} sj_axis_config;

typedef struct {
    sj_interpolator interpolator;
    sj_drive drive;
    sj_axis_config config;
    sj_axis_goal goal;     /* in execution, or reached; absolute */
    sj_limits ceiling;     /* the largest of the axis since it last was at rest */
    double start;          /* where the goal's motion began */
    double line;           /* its distance on a straight line, 0: not on one */
    sj_exact before[2];    /* commanded positions of the two cycles before */
    double torque_left;    /* 60B2h, what rounding has left of it */
    int64_t actual_counts; /* 6064h unwrapped */
    int64_t target_counts; /* sent last */
    double turning;        /* increments per cycle of a motor that does not follow */
    int64_t least_cycles;
    uint64_t goal_id, goal_axes; /* goal_axes: bit n = axis n */
    int32_t synchronization;
    int32_t state;     /* SJ_AXIS_... */
    int32_t following; /* the drive follows the command */
    int32_t held;      /* not at its end though it may rest: feed hold, path */
    int32_t reached;   /* has been on the goal */
    int32_t blends;    /* passes its goal, where a queued move takes over */
    int32_t error;     /* stopped by the kernel; until reset */
    int32_t enable;
    int32_t reset;          /* cycles left of a fault reset's edge */
    int32_t homing;         /* cycles since the order, 0 = none */
    int32_t resting, still; /* cycles since the command, the motor came to rest */
    int32_t homed;          /* 1: at its home, and does not follow again yet */
    int32_t unfollowed;     /* cycles in which an enabled drive has not followed */
    int32_t drive_stop;     /* 1: the drive's own quick stop; the planner could not */
    uint32_t switches;      /* 60FDh bits 0, 1: the limit switches that are closed */
    int32_t limited;        /* a limit of the drive kept it from following last */
    uint32_t halts, quick_stops, resets, limit_sets;
} sj_axis;

enum {
    SJ_LOOKAHEAD = 32,        /* most records that are taken and wait for their turn */
    SJ_LOOKAHEAD_TAKES = 4,   /* most that one cycle takes, */
    SJ_LOOKAHEAD_PASSES = 32, /* besides those that are not to be begun */
    SJ_LOOKAHEAD_DROPS = 4    /* most orders to drop that are remembered */
};

/* A record that waits for its turn. */
typedef struct {
    sj_record record;
    uint64_t number;   /* of the ring */
    uint64_t axes;     /* bit n: axis n */
    uint64_t blending; /* axes of the move before that blend into it */
    double share;      /* of the blend's velocity; what is tried next */
    int32_t spent;     /* has its answer; begun only to come to rest */
    int32_t refused;   /* the axis that a refusal is about, or -1 */
} sj_waiting;

/* An order to drop: records first .. last of these axes are not begun. */
typedef struct {
    uint64_t first, last, axes;
    int32_t result; /* their answer */
    int32_t reserved;
} sj_drop;

/* The look-ahead. */
typedef struct {
    uint64_t seen; /* records published before this cycle's command was taken */
    uint64_t stop; /* of these a stop in this cycle means the ones up to here */
    int32_t count; /* records that wait: waiting[order[0 .. count - 1]] */
    int32_t drops;
    int32_t order[32]; /* a permutation; the rest are free */
    sj_drop drop[4];
    sj_waiting waiting[32];
} sj_lookahead;

/* The path in play, or the last one. */
typedef struct {
    uint64_t goal_id, newest; /* newest: highest id a record of a path had */
    uint64_t root;            /* of the path that was opened; others took over from it */
    uint64_t axes;            /* bit n: axis n is driven by it; 0: none is in play */
    int32_t count;            /* of its axes */
    int32_t cancelled;
    int32_t axis[64];  /* of the kernel, by axis of the track */
    sj_exact turn[64]; /* from the positions of its records to the axis: whole turns, likewise */
    sj_player player;
} sj_path;

/* Synchronised moves that are held on the path that was planned, one feed for all their axes. */
typedef struct {
    uint64_t axes;   /* bit n: axis n is driven by it; 0: none is */
    double override; /* under which they were planned */
    int64_t at;      /* cycles that `planned` has gone */
    int32_t count, reserved;
    int32_t axis[64];            /* of the kernel, by axis of the track */
    sj_interpolator planned[64]; /* the moves as they were planned */
    sj_player player;
} sj_feed_hold;

typedef struct {
    void *segment;
    int32_t axes;
    int32_t ending; /* 1: stop, disable, refuse goals */
    int32_t ended;  /* cycles since the end has been seen */
    int32_t host_state;
    int32_t hold;
    uint32_t cancels;
    int32_t collected; /* status of this cycle's collection of the command */
    int32_t quiet;     /* 1: nobody reads the feedback of this cycle (_replay.c) */
    int32_t own_loop;  /* 1: nothing clocks it; frames are without times */
    int32_t pad;
    double override;
    uint64_t goal_id, late;
    uint64_t host_epoch;                            /* of the host seen last */
    uint64_t ring_seen, ring_published, ring_taken; /* of this cycle */
    int32_t ring_status;
    int32_t reserved;
    void *trace;               /* segment of the trace, or NULL */
    sj_trace_frame *frame_out; /* where this cycle's frame goes too, or NULL */
    sj_trace_given given;
    sj_trace_item item;  /* of the trace, under the pen */
    int32_t reaction[8]; /* enum sj_reaction by enum sj_cause */
    sj_command incoming; /* what collect fills; corrupt where it fails */
    sj_command command;
    sj_feedback feedback;
    sj_plan plan[64]; /* room for planning a goal */
    sj_interpolator trial[64];
    sj_lookahead lookahead;
    sj_path path;
    sj_feed_hold feed_hold;
    sj_drive_rx rx[64]; /* process image: to the drives, from the drives */
    sj_drive_tx tx[64];
    int32_t stale[64]; /* caller: 1, nothing of this drive came in time */
    sj_axis axis[64];
} sj_kernel;

/* For C only. */

/* What a room says to a record whose turn it is; or refused with -(enum sj_result), then held->refused
 * is the axis that it is about, or -1. */
enum sj_offer { OFFER_WAIT = 0, OFFER_TAKEN = 1 };
