/* Override and hold of the motions under way. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* A new override, 0 .. 2 (another number: as it was), and hold. */
void sj_override_set(sj_kernel *kernel, double override, int32_t hold);
