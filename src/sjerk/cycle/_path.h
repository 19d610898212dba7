/* The path in play. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* A record of a path whose turn it is: enum sj_offer. */
int32_t sj_path_offer(sj_kernel *kernel, sj_waiting *waiting);
/* Lets go of axes that do not follow any more. The axes of the path, if its command has just cancelled
 * it: the caller halts them. */
uint64_t sj_path_watch(sj_kernel *kernel);
/* One cycle of it. The axes that have lost their path: the caller halts them. */
uint64_t sj_path_step(sj_kernel *kernel);
/* Where one of these axes is driven by it, it comes to rest on itself and is forgotten. All its axes,
 * or 0. */
uint64_t sj_path_halt(sj_kernel *kernel, uint64_t axes);
/* It is left at once, if it drives one of these axes. Its other axes: the caller halts them. */
uint64_t sj_path_leave(sj_kernel *kernel, uint64_t axes);
/* The interpolator of an axis as it goes on from the path; and to let go of axes. */
void sj_path_hand_over(sj_kernel *kernel, int32_t axis);
void sj_path_release(sj_kernel *kernel, uint64_t axes);
