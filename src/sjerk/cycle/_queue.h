/* Queued moves. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* enum sj_result: whether a move that has just come can ever be begun; waiting->refused: the axis. */
int32_t sj_queue_judge(const sj_kernel *kernel, sj_waiting *waiting);
/* It is its turn: begun if its axes are free; else the move before may be planned to blend into it.
 * enum sj_offer. */
int32_t sj_queue_offer(sj_kernel *kernel, sj_waiting *waiting);
/* The moves of these axes are not to blend but to come to rest on their goals. 0: it is too late, they
 * pass them. */
int32_t sj_queue_release(sj_kernel *kernel, const int32_t *axes, int32_t n);
/* A move that is not to be begun. 1: it stays until the one before, which is too near to its goal, has
 * passed it. */
int32_t sj_queue_drop(sj_kernel *kernel, sj_waiting *waiting);
