/* Times cycles of the library one by one, as a caller's own loop in C would run them: by absolute
 * time, with external drives that answer each target by being there in the next cycle.
 *
 * Loaded by test_kernel.py; the cycle itself is the library's, by its address.
 */
#define _GNU_SOURCE /* clock_nanosleep */
#include <errno.h>
#include <stddef.h>
#include <stdint.h>
#include <time.h>
#include "cycle/_state.h"

static uint64_t read_ns(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (uint64_t)t.tv_sec * 1000000000 + (uint64_t)t.tv_nsec;
}

static void exchange(sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_drive_tx *tx = &kernel->tx[i];
        tx->statusword = SJ_SW_READY | SJ_SW_SWITCHED_ON | SJ_SW_OPERATION_ENABLED |
                         SJ_SW_QUICK_STOP | SJ_SW_VOLTAGE | SJ_SW_FOLLOWS;
        tx->mode_display = SJ_MODE_CSP;
        tx->position_actual = kernel->rx[i].target_position;
    }
}

/* CPU time of each of `count` cycles in ns; period_ns = 0: back to back. The last spin_ns before each
 * are watched, not slept; rehearsals are part of that, as in
 * _clock.c. */
void cycle_times(void (*cycle)(sj_kernel *, uint64_t), sj_kernel *kernel, int64_t count,
                 uint64_t period_ns, uint64_t spin_ns, int32_t external,
                 void (*rehearse)(const sj_kernel *, sj_kernel *), sj_kernel *copy,
                 uint64_t *cpu_ns)
{
    uint64_t deadline = read_ns(CLOCK_MONOTONIC);
    for (int64_t k = 0; k < count; k++) {
        struct timespec t;
        uint64_t before, most = 10000;
        uint64_t wake;
        deadline += period_ns;
        wake = deadline - spin_ns;
        t = (struct timespec){(time_t)(wake / 1000000000), (long)(wake % 1000000000)};
        if (period_ns)
            while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
                ;
        for (uint64_t now = read_ns(CLOCK_MONOTONIC); rehearse && now + most < deadline;) {
            uint64_t begun = now;
            rehearse(kernel, copy);
            now = read_ns(CLOCK_MONOTONIC);
            most = 2 * (now - begun);
        }
        while (period_ns && read_ns(CLOCK_MONOTONIC) < deadline)
            ;
        if (external)
            exchange(kernel);
        before = read_ns(CLOCK_THREAD_CPUTIME_ID);
        if (cycle)
            cycle(kernel, deadline);
        cpu_ns[k] = read_ns(CLOCK_THREAD_CPUTIME_ID) - before;
    }
}
