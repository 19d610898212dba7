/* The clock, virtual time, and the warm-up before a cycle. */
#pragma once
#include <stdint.h>
#include "cycle/_exchange.h"
#include "cycle/_state.h"

/* Before a cycle, while there is time: it runs on a copy, so that code and data are in the caches. The
 * copy: of as many axes, with a segment of its own. */
void sj_kernel_rehearse(const sj_kernel *kernel, sj_kernel *copy);

/* Cycles in virtual time from now_ns on; `frames` (one each, back to back) may be NULL. */
void sj_virtual_run(sj_kernel *kernel, int64_t cycles, uint64_t now_ns, uint64_t period_ns,
                    void *frames);
/* Recorded cycles again. Returns how many came out the same, bit for bit; where one did not, its
 * frame is in kernel->item. */
int64_t sj_virtual_replay(sj_kernel *kernel, int64_t cycles, const void *frames,
                          int64_t command_count, const void *commands, int64_t record_count,
                          const void *records, int64_t stop_count, const void *stops);

/* Ask the system for what `options` says, for the calling thread; `report` says what it gave. */
void sj_clock_prepare(const sj_kernel *kernel, uint64_t bytes, const sj_clock_options *options,
                      sj_clock_report *report);
/* What a running loop is told, and tells; other threads read and write it while it runs. */
enum sj_end {
    SJ_END_NOT = 0,
    SJ_END_REST = 1, /* stop, disable, refuse goals; the cycle goes on */
    SJ_END_LEAVE = 2 /* the same, and return once everything is at rest */
};
typedef struct {
    int32_t order;   /* enum sj_end */
    int32_t at_rest; /* 1: everything is at rest and disabled, after the order */
} sj_clock_end;
/* copy: for rehearsals, or NULL for none. exchange: of drives outside, or NULL. */
void sj_clock_run(sj_kernel *kernel, sj_kernel *copy, const sj_clock_options *options,
                  const sj_exchange *exchange, sj_clock_end *end);
/* Longest busy wait of one cycle that keeps this share of the processor, computing included. */
uint64_t sj_clock_spin_ns(const sj_clock_options *options, double share, uint64_t computing_ns);
void sj_clock_order(sj_clock_end *end, int32_t order);
int32_t sj_clock_at_rest(const sj_clock_end *end);
uint64_t sj_clock_now_ns(void);
void sj_histogram_add(sj_histogram *histogram, uint64_t ns);
