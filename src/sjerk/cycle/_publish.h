/* The frame that hosts read. */
#pragma once
#include "cycle/_state.h"

/* What needs every cycle, whether a client reads or not. */
void sj_publish_keep(sj_kernel *kernel);
/* The frame of this cycle, and the kernel's sign of life. */
void sj_publish(sj_kernel *kernel);
