/* Records of the ring that wait for their turn. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

void sj_lookahead_start(sj_lookahead *lookahead);
/* Before all else in a cycle: how far the ring goes. */
void sj_lookahead_see(sj_kernel *kernel);
/* After the command: a few records. 1: the ring has just been found corrupt, and the caller reacts. */
int32_t sj_lookahead_take(sj_kernel *kernel);
/* Then each record whose turn it is to its room. */
void sj_lookahead_offer(sj_kernel *kernel);
/* Records first .. last of these axes are not begun, be they taken or still in the ring; each is
 * answered with `result`. */
void sj_lookahead_drop(sj_kernel *kernel, uint64_t axes, uint64_t first, uint64_t last,
                       int32_t result);
/* All that were given before this cycle's stop. */
void sj_lookahead_stop(sj_kernel *kernel, uint64_t axes);
