/* The trace: what each cycle took from outside and what it gave. */
#pragma once
#include <stdint.h>
#include "cycle/_payload.h"

/* The trace: what each cycle took from outside and what it gave, in the order of the cycle. An item
 * is one event of a segment of its own (sj_event_publish); a cycle's items end with its frame. With
 * the inputs alone the same cycle gives the same frames, bit for bit. */
enum sj_trace_kind {
    SJ_TRACE_FRAME = 0,   /* sj_trace_frame */
    SJ_TRACE_COMMAND = 1, /* a command as it was taken */
    SJ_TRACE_EVENT = 2,   /* sj_kernel_event */
    SJ_TRACE_RECORD = 3,  /* a record of the ring as it was taken */
    SJ_TRACE_STOP = 4     /* sj_stop as it was taken; number: its slot */
};

enum sj_trace_flag {
    SJ_TRACE_MOVING = 1,
    SJ_TRACE_SETTLED = 2,
    SJ_TRACE_FOLLOWS = 4,
    SJ_TRACE_HELD = 8, /* not at its end though it may rest */
    SJ_TRACE_DRIVE_STOP = 16,
    SJ_TRACE_PATH = 32, /* driven by a path */
    SJ_TRACE_STALE = 64,
    SJ_TRACE_FEED_HOLD = 128 /* on its planned path, at another feed */
};

typedef struct {
    uint64_t cycle;
    uint64_t number; /* of a record in its ring */
    int32_t kind;    /* enum sj_trace_kind */
    int32_t reserved;
} sj_trace_head;

typedef struct {
    double position, velocity, acceleration, jerk; /* commanded sample, per cycle */
    double goal;
    sj_limits limits; /* of the axis, in force */
    uint64_t goal_id;
    int64_t target_counts, actual_counts;     /* unwrapped, encoder increments */
    int32_t velocity_actual, following_error; /* 606Ch, 60F4h */
    uint16_t statusword, error_code;          /* 6041h, 603Fh */
    int16_t torque_actual;                    /* 6077h */
    int8_t mode_display;                      /* 6061h */
    uint8_t state;                            /* SJ_AXIS_... */
    uint32_t flags;                           /* enum sj_trace_flag */
    uint32_t digital_inputs;                  /* 60FDh */
    int32_t velocity_offset;                  /* 60B1h, 60B2h: what the kernel fed forward */
    int16_t torque_offset;
    uint16_t reserved;
} sj_axis_trace;

typedef struct {
    sj_trace_head head;
    uint64_t time_ns;           /* of the cycle's begin, as it was given */
    uint64_t late;              /* inputs: cycles skipped so far, */
    uint64_t ring_seen;         /* records published at the begin, */
    uint64_t ring_published;    /* and once the command was collected, */
    uint64_t ring_taken;        /* taken or discarded at the end, */
    int32_t host_state, ending; /* the host as seen, the order to end, */
    int32_t collected;          /* what the collection of the command said, */
    int32_t ring_status;        /* and the last taking of a record where it was none */
    uint64_t sequence;          /* newest command taken */
    double override;
    int32_t hold, reserved;
    sj_axis_trace axis[64];
} sj_trace_frame;

typedef struct {
    sj_trace_head head;
    uint64_t payload[1100]; /* command, record, stop or event, as its bytes */
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
    const sj_trace_frame *frame;            /* as recorded, or NULL: no replay */
    sj_trace_rows commands, records, stops; /* to come */
} sj_trace_given;

uint64_t sj_trace_frame_bytes(int32_t axes);
uint64_t sj_trace_item_bytes(int32_t axes); /* of one event of the trace's segment */
/* Items after *cursor, at most `room`, back to back; how many. Any process, at any time. */
int64_t sj_trace_drain(const void *segment, uint64_t *cursor, uint64_t *missed, int64_t room,
                       void *items);
