/* The cyclic loop: the only file that knows time and scheduling.
 *
 * Absolute deadlines on CLOCK_MONOTONIC; a deadline that has passed is counted and skipped, never
 * made up for by a burst. Computing time is the thread's own CPU time.
 */
#define _POSIX_C_SOURCE 200809L /* clock_nanosleep */
#include <errno.h>     /* EINTR */
#include <stdatomic.h> /* the end flag, raised by another thread */
#include <stddef.h>
#include <stdint.h>
#include <time.h>
#include "_kernel.h"

enum { SECOND_NS = 1000000000, SUB_BUCKETS = 16, FIRST_NS = 64 };

static uint64_t read_clock(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (uint64_t)t.tv_sec * SECOND_NS + (uint64_t)t.tv_nsec;
}

uint64_t sj_clock_now_ns(void)
{
    return read_clock(CLOCK_MONOTONIC);
}

void sj_histogram_add(sj_histogram *histogram, uint64_t ns)
{
    uint32_t octave = 0, bucket;
    uint64_t rest = ns;
    while (rest >= 2 * FIRST_NS) {
        rest >>= 1;
        octave++;
    }
    bucket = octave * SUB_BUCKETS;
    bucket += rest >= FIRST_NS ? (uint32_t)(rest - FIRST_NS) * SUB_BUCKETS / FIRST_NS : 0;
    if (bucket >= SJ_HISTOGRAM_BUCKETS)
        bucket = SJ_HISTOGRAM_BUCKETS - 1;
    histogram->bucket[bucket]++;
    histogram->count++;
    if (ns > histogram->worst_ns)
        histogram->worst_ns = ns;
}

static void sleep_until(uint64_t deadline_ns)
{
    struct timespec t = {(time_t)(deadline_ns / SECOND_NS), (long)(deadline_ns % SECOND_NS)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
        ;
}

/* Raise the end flag of a running loop, from any thread. */
void sj_clock_end(int32_t *end)
{
    atomic_store((_Atomic int32_t *)end, 1);
}

/* Cycle until the flag is raised and then everything is at rest and disabled. */
void sj_clock_run(sj_kernel *kernel, uint64_t period_ns, int32_t *end)
{
    uint64_t deadline = sj_clock_now_ns() + period_ns, woken_before = 0;

    while (!kernel->ending || !sj_kernel_at_rest(kernel)) {
        uint64_t woken, cpu, done;
        sleep_until(deadline);
        woken = sj_clock_now_ns();
        cpu = read_clock(CLOCK_THREAD_CPUTIME_ID);
        kernel->ending = atomic_load((_Atomic int32_t *)end);
        sj_kernel_cycle(kernel, woken);
        cpu = read_clock(CLOCK_THREAD_CPUTIME_ID) - cpu;

        sj_histogram_add(&kernel->feedback.latency, woken - deadline);
        sj_histogram_add(&kernel->feedback.computing, cpu);
        if (woken_before != 0)
            sj_histogram_add(&kernel->feedback.period, woken - woken_before);
        woken_before = woken;
        deadline += period_ns;
        done = sj_clock_now_ns();
        if (done >= deadline) {
            uint64_t skipped = (done - deadline) / period_ns + 1;
            kernel->feedback.late += skipped;
            deadline += skipped * period_ns;
        }
    }
}
