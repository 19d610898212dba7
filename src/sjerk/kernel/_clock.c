/* The cyclic loop: the only file that knows time and scheduling.
 *
 * Absolute deadlines on CLOCK_MONOTONIC: sleep until shortly before, then watch the clock; a deadline
 * that has passed is counted and skipped, never made up for by a burst. Computing time is the
 * thread's own CPU time. What the system refuses is reported, and the loop runs all the same.
 */
#define _GNU_SOURCE    /* clock_nanosleep, processor affinity */
#include <errno.h>     /* EINTR */
#include <pthread.h>   /* scheduling of the own thread */
#include <sched.h>     /* SCHED_FIFO, cpu_set_t */
#include <stdatomic.h> /* the end flag, raised by another thread */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>    /* the system's real-time share, read before the loop */
#include <sys/mman.h> /* mlock */
#include <time.h>
#include "cycle/_cycle.h"
#include "cycle/_goals.h"
#include "kernel/_clock.h"

enum { SECOND_NS = 1000000000, SUB_BUCKETS = 16, FIRST_NS = 64 };

static uint64_t read_clock(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (uint64_t)t.tv_sec * SECOND_NS + (uint64_t)t.tv_nsec;
}

uint64_t sj_clock_now_ns(void) { return read_clock(CLOCK_MONOTONIC); }

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

/* ---- what is asked of the system, before the loop ---- */

enum { STACK_BYTES = 256 * 1024, PAGE = 4096 };
static const double used_share = 0.9; /* of the real-time share: the rest is for what is not seen */

static long read_number(const char *path, long otherwise)
{
    FILE *file = fopen(path, "r");
    long number = otherwise;
    if (file == NULL)
        return otherwise;
    if (fscanf(file, "%ld", &number) != 1)
        number = otherwise;
    fclose(file);
    return number;
}

/* The share of each period after which the system suspends real-time threads. */
static double realtime_share(void)
{
    long runtime = read_number("/proc/sys/kernel/sched_rt_runtime_us", -1);
    long period = read_number("/proc/sys/kernel/sched_rt_period_us", 1000000);
    return runtime < 0 || period <= 0 || runtime >= period ? 1.0 : (double)runtime / (double)period;
}

uint64_t sj_clock_spin_ns(const sj_clock_options *options, double share, uint64_t computing_ns)
{
    double most = share * used_share * (double)options->period_ns - (double)computing_ns;
    if (most <= 0.0)
        return 0;
    return (double)options->spin_ns <= most ? options->spin_ns : (uint64_t)most;
}

/* Grow the stack to what a cycle may need and lock it: no page fault in the loop. */
static __attribute__((noinline)) int lock_stack(void)
{
    volatile char stack[STACK_BYTES];
    for (size_t i = 0; i < sizeof stack; i += PAGE)
        stack[i] = 0;
    return mlock((const void *)stack, sizeof stack);
}

static int32_t lock_memory(const sj_kernel *kernel, uint64_t bytes)
{
    int stack = lock_stack();
    /* not MCL_FUTURE: under a limit it would make later allocations of the process fail */
    if (mlockall(MCL_CURRENT) == 0)
        return SJ_GRANT_FULL;
    if (stack == 0 && mlock(kernel, sizeof *kernel) == 0 && mlock(kernel->segment, bytes) == 0)
        return SJ_GRANT_PART;
    return -errno;
}

/* bytes: of the segment. */
void sj_clock_prepare(const sj_kernel *kernel, uint64_t bytes, const sj_clock_options *options,
                      sj_clock_report *report)
{
    *report = (sj_clock_report){.asked = *options, .share = 1.0};
    if (options->cpu >= 0) {
        cpu_set_t set;
        int error = EINVAL;
        if (options->cpu < CPU_SETSIZE) {
            CPU_ZERO(&set);
            CPU_SET((size_t)options->cpu, &set);
            error = pthread_setaffinity_np(pthread_self(), sizeof set, &set);
        }
        report->cpu = error == 0 ? SJ_GRANT_FULL : -error;
    }
    if (options->lock_memory)
        report->memory = lock_memory(kernel, bytes);
    if (options->priority > 0) {
        struct sched_param priority = {.sched_priority = options->priority};
        int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority);
        report->priority = error == 0 ? SJ_GRANT_FULL : -error;
    }
    if (report->priority == SJ_GRANT_FULL)
        report->share = realtime_share();
    report->spin_ns = sj_clock_spin_ns(options, report->share, 0);
    report->capped = report->spin_ns < options->spin_ns;
}

/* ---- the loop ---- */

enum { REHEARSAL_NS = 5000 }; /* of the first rehearsal what is not the cycle itself, at most */

/* Sleep, then watch the clock for the last spin_ns; while there is surely time for one more, rehearse:
 * what a neighbour on the processor pushes out of the caches comes back. Returns the time of waking. */
static uint64_t wait_until(uint64_t deadline_ns, uint64_t spin_ns, const sj_kernel *kernel,
                           sj_kernel *copy, uint64_t computing_ns)
{
    uint64_t most = 2 * computing_ns + REHEARSAL_NS, now;
    sleep_until(deadline_ns - spin_ns);
    now = sj_clock_now_ns();
    while (copy != NULL && now + most < deadline_ns) {
        uint64_t begun = now;
        sj_kernel_rehearse(kernel, copy);
        now = sj_clock_now_ns();
        most = 2 * (now - begun);
    }
    while (now < deadline_ns)
        now = sj_clock_now_ns();
    return now;
}

void sj_clock_order(sj_clock_end *end, int32_t order)
{
    atomic_store((_Atomic int32_t *)&end->order, order);
}

int32_t sj_clock_at_rest(const sj_clock_end *end)
{
    return atomic_load((const _Atomic int32_t *)&end->at_rest);
}

/* Cycle until the order to leave has come and then everything is at rest and disabled. A port moves the
 * deadlines; where none does, they are periods apart. */
void sj_clock_run(sj_kernel *kernel, sj_kernel *copy, const sj_clock_options *options,
                  const sj_exchange *exchange, sj_clock_end *end)
{
    const uint64_t period_ns = options->period_ns;
    sj_feedback *feedback = &kernel->feedback;
    uint64_t deadline = sj_clock_now_ns() + period_ns, woken_before = 0, cpu = 0;
    int32_t order = SJ_END_NOT;

    while (order != SJ_END_LEAVE || !sj_kernel_at_rest(kernel)) {
        uint64_t spin_ns = sj_clock_spin_ns(options, feedback->clock.share, cpu), woken, done;
        int64_t moved = 0;
        woken = wait_until(deadline, spin_ns, kernel, copy, cpu);
        cpu = read_clock(CLOCK_THREAD_CPUTIME_ID);
        order = atomic_load((_Atomic int32_t *)&end->order);
        kernel->ending = order != SJ_END_NOT;
        if (exchange != NULL) {
            moved = exchange->take(exchange->self);
            exchange->state(exchange->self, feedback);
        }
        sj_kernel_cycle(kernel, woken);
        if (exchange != NULL)
            exchange->send(exchange->self, (int64_t)deadline);
        if (kernel->ending && sj_kernel_at_rest(kernel))
            atomic_store((_Atomic int32_t *)&end->at_rest, 1);
        cpu = read_clock(CLOCK_THREAD_CPUTIME_ID) - cpu;

        sj_histogram_add(&feedback->latency, woken - deadline);
        sj_histogram_add(&feedback->computing, cpu);
        if (woken_before != 0)
            sj_histogram_add(&feedback->period, woken - woken_before);
        woken_before = woken;
        if (sj_clock_now_ns() - deadline < period_ns / 2)
            sj_goal_rehearse(kernel); /* a planner last used long ago takes twice as long */
        deadline += (uint64_t)((int64_t)period_ns + moved);
        done = sj_clock_now_ns();
        if (done >= deadline) {
            uint64_t skipped = (done - deadline) / period_ns + 1;
            feedback->late += skipped;
            deadline += skipped * period_ns;
        }
    }
}
