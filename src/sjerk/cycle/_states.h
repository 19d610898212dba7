/* The states of an axis. */
#pragma once
#include <stdint.h>

/* PLCopen, motion control part 1: the state diagram */
enum {
    SJ_AXIS_DISABLED = 0,
    SJ_AXIS_STANDSTILL = 1,
    SJ_AXIS_DISCRETE = 2, /* a motion that ends at rest */
    SJ_AXIS_CONTINUOUS = 3,
    SJ_AXIS_SYNCHRONIZED = 4,
    SJ_AXIS_HOMING = 5,
    SJ_AXIS_STOPPING = 6,
    SJ_AXIS_ERROR_STOP = 7,
    SJ_AXIS_STATES = 8
};

/* what changes one into the next */
enum {
    SJ_TRIGGER_POWER_ON = 0, /* the drive follows */
    SJ_TRIGGER_POWER_OFF = 1,
    SJ_TRIGGER_FAULT = 2,
    SJ_TRIGGER_RESET = 3, /* the fault is gone */
    SJ_TRIGGER_MOVE = 4,
    SJ_TRIGGER_JOG = 5,
    SJ_TRIGGER_SYNCHRONIZE = 6,
    SJ_TRIGGER_HOME = 7,
    SJ_TRIGGER_HALT = 8,
    SJ_TRIGGER_QUICK_STOP = 9,
    SJ_TRIGGER_DONE = 10, /* at rest */
    SJ_TRIGGERS = 11
};

/* The next state, or -1: refused in this state. */
int32_t sj_axis_next(int32_t state, int32_t trigger);
