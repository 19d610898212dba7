/* Stops of axes that are driven by their interpolators. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* The axes of one goal to rest, together where that works; their goals stay. */
void sj_stop_together(sj_kernel *kernel, const int32_t *axes, int32_t n);
/* An axis that moves without a goal to rest, by its own limits. */
void sj_stop_alone(sj_axis *axis);
/* A halt of these axes and of all that share a goal with one of them. */
void sj_stop_halt(sj_kernel *kernel, uint64_t axes);
/* A quick stop of these. together: those of them that are slowed to stop with the slowest. */
void sj_stop_quick(sj_kernel *kernel, uint64_t axes, uint64_t together);
