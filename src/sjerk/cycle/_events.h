/* Events to the hosts and the trace: what has happened, and the one answer to each goal. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* An event of an axis, or of all (axis -1), about the goal that is in execution there. */
void sj_events_report(sj_kernel *kernel, int32_t kind, int32_t axis, int32_t code, double value);
/* The one answer to a goal, enum sj_result; axis: the one that refused, or -1. */
void sj_events_answer(sj_kernel *kernel, uint64_t goal_id, int32_t axis, int32_t result);
/* All axes of a goal are on it, in this frame. */
void sj_events_reached(sj_kernel *kernel, uint64_t goal_id);
/* The path in play has a new state, enum sj_path_state. */
void sj_events_path(sj_kernel *kernel, int32_t state);
/* A change of the axis' state, PLCopen; reported. 0, or -1: refused in this state. */
int32_t sj_events_trigger(sj_kernel *kernel, int32_t axis, int32_t trigger);
