/* What the kernel adds to the targets of its drives. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* 60B1h and 60B2h of an axis, for the position that is commanded in this cycle. */
void sj_feed_forward_send(sj_kernel *kernel, int32_t axis);
