/* A cycle before the cycle: while the loop only watches the clock, the same code runs on a copy of the
 * state, and what the cycle will touch is brought into the caches. Nothing of the kernel is changed.
 *
 * A processor that has slept has forgotten code, addresses and the outcomes of branches; the copy takes
 * the branches that the cycle will take, but for what comes from outside in between: goals, records,
 * motions that are driven by a path. Never here: decisions, time, memory of its own.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of the state */
#include "cycle/_cycle.h"
#include "dpram/_dpram.h"
#include "kernel/_clock.h"
#include "base/_simd.h" /* fetching ahead */

static void fetch_all(const sj_kernel *kernel)
{
    const int32_t n = kernel->axes;
    fetch(kernel, offsetof(sj_kernel, item));
    fetch(&kernel->reaction, sizeof kernel->reaction);
    fetch(&kernel->feedback.cycle, sj_feedback_bytes(n) - sj_feedback_times());
    fetch(&kernel->lookahead, offsetof(sj_lookahead, waiting));
    fetch(&kernel->path, offsetof(sj_path, axis));
    fetch(&kernel->feed_hold, offsetof(sj_feed_hold, axis));
    fetch(kernel->rx, (size_t)n * sizeof kernel->rx[0]);
    fetch(kernel->tx, (size_t)n * sizeof kernel->tx[0]);
    fetch(kernel->stale, (size_t)n * sizeof kernel->stale[0]);
    for (int32_t i = 0; i < n; i++) {
        const sj_axis *ax = &kernel->axis[i];
        const sj_interpolator *ip = &ax->interpolator;
        fetch(ip, offsetof(sj_interpolator, legs));
        fetch(&ip->legs[ip->leg < ip->count ? ip->leg : 0], 2 * sizeof ip->legs[0]);
        if (!ax->config.external) {
            fetch(&ax->drive, offsetof(sj_drive, goal.plan));
            fetch(&ax->drive.goal.plan_left, sizeof ax->drive - offsetof(sj_drive, goal.plan_left));
        }
        fetch(&ax->config, sizeof *ax - offsetof(sj_axis, config));
    }
    sj_shm_warm(kernel->segment);
}

/* What a cycle reads, without the rooms for records, paths and plans. */
static void copy_state(sj_kernel *to, const sj_kernel *from)
{
    const size_t n = (size_t)from->axes;
    void *segment = to->segment;

    memcpy(to, from, offsetof(sj_kernel, item));
    to->segment = segment; /* a host has never been there, nor has a record */
    to->trace = NULL;
    to->frame_out = NULL;
    to->given = (sj_trace_given){0};
    to->host_state = SJ_HOST_ABSENT;
    to->host_epoch = 0;
    to->ring_taken = 0;
    memcpy(&to->feedback.cycle, &from->feedback.cycle,
           sj_feedback_bytes(from->axes) - sj_feedback_times());
    memcpy(to->rx, from->rx, n * sizeof from->rx[0]);
    memcpy(to->tx, from->tx, n * sizeof from->tx[0]);
    memcpy(to->stale, from->stale, n * sizeof from->stale[0]);
    memcpy(to->axis, from->axis, n * sizeof from->axis[0]);
}

void sj_kernel_rehearse(const sj_kernel *kernel, sj_kernel *copy)
{
    copy_state(copy, kernel);
    sj_kernel_cycle(copy, kernel->feedback.time_ns);
    fetch_all(kernel);
}
