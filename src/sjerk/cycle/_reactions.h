/* Who stops with whom, and what is dropped with it. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* A halt of these axes, of all that share a goal with one of them, and of the path. */
void sj_react_halt(sj_kernel *kernel, uint64_t axes);
/* A quick stop of these. together: those of them that are slowed to stop with the slowest. */
void sj_react_quick_stop(sj_kernel *kernel, uint64_t axes, uint64_t together);
/* Those of them whose drives are homing, by the drives' own quick stop. */
void sj_react_stop_homing(sj_kernel *kernel, uint64_t axes);
/* The reaction that is set for a cause, enum sj_cause. */
void sj_react(sj_kernel *kernel, int32_t cause, uint64_t axes);
