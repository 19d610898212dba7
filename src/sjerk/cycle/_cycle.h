/* One kernel: set up, then cycle by cycle. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"

/* 0, or -1: the number of axes is out of range. Then every axis must be set. */
int32_t sj_kernel_init(sj_kernel *kernel, void *segment, int32_t axes, double cycle_time_s);
/* As sj_drive_init. */
int32_t sj_kernel_axis(sj_kernel *kernel, int32_t axis, const sj_drive_config *drive,
                       const sj_axis_config *config);
/* Top to bottom in the order of the data. now_ns: the begin of the cycle, any monotonic clock. */
void sj_kernel_cycle(sj_kernel *kernel, uint64_t now_ns);
void sj_kernel_cycles(sj_kernel *kernel, int64_t cycles); /* in a caller's own loop */
void sj_kernel_step(sj_kernel *kernel);                   /* the same, one */
int32_t sj_kernel_at_rest(const sj_kernel *kernel);       /* nothing moves, no drive is enabled */
