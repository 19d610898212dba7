/* Override and hold of the motions under way. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* A new override, 0 .. 2 (another number: as it was), and hold. */
void sj_override_set(sj_kernel *kernel, double override, int32_t hold);
/* After a goal has begun: under a hold its axes come to rest, and it is planned when the hold ends. */
void sj_override_hold(sj_kernel *kernel);
