/* The axes of one goal. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* The axes under way that share a goal with this one, itself first; cleared from the set. How many. */
int32_t sj_group_of(const sj_kernel *kernel, int32_t axis, uint64_t *set, int32_t *axes);
/* One plan for all axes of a straight line, so that they stay on it, into kernel->plan: to rest, or
 * to their goals. -1: they are not on one. */
int32_t sj_group_line(sj_kernel *kernel, const int32_t *axes, int32_t n, const sj_limits *limits,
                      int32_t stop);
