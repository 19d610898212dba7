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

typedef struct {
    uint64_t goal_id, newest;           /* newest: highest id a record of a path had */
    uint64_t root;                      /* of the path that was opened; others took over from it */
    uint64_t led;                       /* bit n: axis n is led by it; 0: none is in play */
    int32_t count;                      /* of its axes */
    int32_t cancelled;
    int32_t axis[64];                   /* of the kernel, by axis of the track */
    sj_player player;
} sj_path;

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

int32_t  sj_kernel_at_rest(const sj_kernel *kernel);    /* nothing moves, no drive is enabled */

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
