/* Queued moves. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* enum sj_result: whether a move that has just come can ever be begun; held->refused: the axis. */
int32_t sj_queue_judge(const sj_kernel *kernel, sj_held *held);
/* It is its turn: begun if its axes are free; else the move before may be told to pass its goal. enum
 * sj_offer. */
int32_t sj_queue_offer(sj_kernel *kernel, sj_held *held);
/* The moves of these axes are not to pass their goal but to rest on it. 0: too late, they pass. */
int32_t sj_queue_release(sj_kernel *kernel, const int32_t *axes, int32_t n);
/* A move that is not to be begun. 1: it must be, since the one before passes its goal for it. */
int32_t sj_queue_drop(sj_kernel *kernel, sj_held *held);
