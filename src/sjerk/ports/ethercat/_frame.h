/* The cyclic frame of an EtherCAT main device: composed, taken apart, and the clock that it carries.
 *
 * Pure: frames and times in, frames and corrections out. Times are ns. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

enum {
    SJ_BUS_DRIVES = 64, /* most drives, */
    SJ_BUS_WORDS = 24,  /* mapped words of one of them each way, */
    SJ_BUS_FRAMES = 8,  /* and frames of a cycle */
    SJ_BUS_FRAME = 1514 /* bytes of a frame without its checksum */
};

/* A mapped object: where in the process data, and where in sj_drive_rx or sj_drive_tx. */
typedef struct {
    uint16_t bit, bits, offset;
} sj_bus_word;

typedef struct {
    /* set up */
    int32_t axis;     /* of the kernel */
    uint32_t logical; /* where outputs and inputs begin, both */
    uint16_t station;
    uint16_t out_bytes, in_bytes;
    uint16_t expected; /* working counter of its LRW */
    int32_t out_words, in_words;
    sj_bus_word outputs[24], inputs[24];
    /* what came */
    int32_t frame;   /* of the cycle's, that carries it */
    int32_t been_up; /* has been in Operational since it was last released */
    sj_axis_bus told;
} sj_bus_drive;

/* One frame that is on its way. */
typedef struct {
    uint8_t bytes[1514];
    int32_t length; /* 0: none */
    int32_t answered;
} sj_bus_flight;

typedef struct {
    /* set up */
    sj_kernel *kernel; /* whose image is exchanged */
    int64_t period_ns;
    int64_t
        phase_ns;  /* the frame is at the reference clock so long after a multiple of the period */
    int32_t lost;  /* cycles in a row without an answer: the drive is lost */
    int32_t count; /* of drives */
    uint16_t reference; /* station with the clock; 0: none */
    uint16_t wide;      /* 1: its clock has 64 bits */
    int32_t raw;        /* 1: the clock by arrival times, as others do; for comparisons */
    int32_t together; /* 1: one LRW for all drives of one frame, likewise; before the first cycle */
    sj_bus_drive drive[64];
    /* the cycle's frames */
    int32_t frames;
    uint32_t index; /* of the newest frame */
    int32_t turn;   /* the drive whose state is read in this cycle */
    sj_bus_flight flight[8];
    /* the clock */
    int64_t sent_ns, deadline_ns; /* of the frames on their way */
    int64_t clock_ns;             /* of the reference, when last known, */
    int64_t clock_sent_ns;        /* and when that frame was sent */
    int64_t integral_ns;
    int32_t good;       /* cycles in a row near the wanted phase */
    int32_t clock_came; /* since the last send */
    sj_bus_feedback told;
    sj_histogram phase; /* magnitudes, once aligned */
} sj_bus;

/* Which frame carries which drive. Returns the number of frames, 0 if they do not fit. */
int32_t sj_bus_lay_out(sj_bus *bus);
/* The frames of a cycle, into bus->flight; they are sent at sent_ns, the cycle should have begun at
 * deadline_ns. */
void sj_bus_compose(sj_bus *bus, int64_t sent_ns, int64_t deadline_ns);
/* A frame that came. Returns 1 if it is an answer that is waited for. */
int32_t sj_bus_accept(sj_bus *bus, const uint8_t *frame, int32_t length);
/* What came since the last composing is all that comes: into the kernel's image. Returns by how much
 * the next deadline is to be moved. */
int64_t sj_bus_settle(sj_bus *bus);
/* What there is to see, into the fields `bus` of the feedback. */
void sj_bus_state(const sj_bus *bus, sj_feedback *feedback);
