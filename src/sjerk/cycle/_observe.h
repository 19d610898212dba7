/* What the kernel sees, and what it makes of it. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* The drives' images, one after the other, then the following errors. */
void sj_observe_drives(sj_kernel *kernel);
/* The host, skipped cycles, the order to end. */
void sj_observe_rest(sj_kernel *kernel, uint64_t now_ns);
