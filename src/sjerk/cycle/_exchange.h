/* How a clocked kernel reaches the drives outside it: functions that a port fills in. */
#pragma once
#include <stdint.h>
#include "cycle/_payload.h"

/* Called once a cycle, by the thread of the cycle: take, the cycle, send. Times: CLOCK_MONOTONIC, ns. */
typedef struct {
    void *self;
    /* What has come since the last send, into the kernel's image of the drives. Returns by how much the
     * next deadline is to be moved, ns. */
    int64_t (*take)(void *self);
    /* What the kernel wants of the drives. deadline_ns: when the cycle should have begun. */
    void (*send)(void *self, int64_t deadline_ns);
    /* What there is to see of the bus, into the fields `bus` of the feedback. */
    void (*state)(void *self, sj_feedback *feedback);
} sj_exchange;
