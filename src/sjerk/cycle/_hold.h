/* A feed hold: motions come to rest on their path and go on from there. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* Whether the axes of a goal can be held on the path that was planned. */
int32_t sj_hold_possible(const sj_kernel *kernel, const int32_t *axes, int32_t n);
/* These axes are held on it, all by one feed; `planned`: the override under which it was planned. 0:
 * they stay as they were. */
int32_t sj_hold_begin(sj_kernel *kernel, uint64_t axes, double planned);
/* The axes of one goal are held by a stop of their own. */
void sj_hold_by_stop(sj_kernel *kernel, const int32_t *axes, int32_t n);
/* One cycle of the held moves. The axes that have lost their path: the caller halts them. */
uint64_t sj_hold_step(sj_kernel *kernel);
/* The interpolators of these axes as they go on from it; and to let go of them. */
void sj_hold_hand_over(sj_kernel *kernel, uint64_t axes);
void sj_hold_release(sj_kernel *kernel, uint64_t axes);
