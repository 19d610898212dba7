/* Writing the trace. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* One item of this cycle; nothing where no trace is kept. */
void sj_trace_put(sj_kernel *kernel, int32_t kind, uint64_t number, const void *payload,
                  uint64_t bytes);
/* The frame of this cycle, after it has been counted. */
void sj_trace_close(sj_kernel *kernel);
