/* What the two sides and the bystanders do in the stress test: fill, exchange, check, count; at full
 * speed, until told to stop or killed. Counters are whole words in memory that outlives the process.
 * The same loops run as processes (tests/stress/handshake.py) and as threads (main, under
 * ThreadSanitizer). Each payload is a number and words that follow from it, so that a mixture shows.
 */
#define _GNU_SOURCE
#include <pthread.h>
#include <sched.h>
#include <stdint.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "dpram/_dpram.h"

enum { WORDS = 64, RECORD = 8 }; /* a command: 16 axes of four doubles; a record: one line */

/* Where the counters lie; the Python side knows the same order. */
enum {
    STOP,
    SENT,
    GOT,
    TORN,
    CORRUPT,
    BACKWARDS,
    WRONG,
    LOST,
    DOUBLED,
    MISSED,
    LAST,
    CYCLES,
    LAPPED,
    READDRESSED,
    RETRIES,
    COUNTERS
};

static uint64_t get(const uint64_t *r, int at) { return __atomic_load_n(&r[at], __ATOMIC_RELAXED); }
static void set(uint64_t *r, int at, uint64_t v) { __atomic_store_n(&r[at], v, __ATOMIC_RELAXED); }
static void add(uint64_t *r, int at, uint64_t v) { set(r, at, get(r, at) + v); }

static void fill(uint64_t *out, int words, uint64_t number, uint64_t epoch)
{
    out[0] = number;
    out[1] = epoch;
    for (int i = 2; i < words; i++)
        out[i] = number * 0x9E3779B97F4A7C15ULL + (uint64_t)i;
}

static int whole(const uint64_t *in, int words)
{
    for (int i = 2; i < words; i++)
        if (in[i] != in[0] * 0x9E3779B97F4A7C15ULL + (uint64_t)i)
            return 0;
    return 1;
}

static uint64_t cpu_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (uint64_t)t.tv_sec * 1000000000ULL + (uint64_t)t.tv_nsec;
}

/* ---- commands and feedback ------------------------------------------------------------------- */

void peer_host(void *base, uint64_t *r, uint64_t most)
{
    uint64_t out[WORDS];
    while (!get(r, STOP) && get(r, SENT) < most) {
        fill(out, WORDS, sj_command_published(base) + 1, sj_shm_addressed(base));
        const int32_t status = sj_command_publish(base, out);
        if (status == 0)
            add(r, SENT, 1);
        else if (status == SJ_SHM_KERNEL_RESTARTED) {
            sj_shm_address(base);
            add(r, READDRESSED, 1);
        } else
            add(r, CORRUPT, 1);
    }
}

void peer_kernel(void *base, uint64_t *r)
{
    uint64_t in[WORDS], out[WORDS];
    const uint64_t epoch = sj_shm_kernel_epoch(base);
    while (!get(r, STOP)) {
        const int32_t status = sj_command_collect(base, in);
        if (status < 0)
            add(r, CORRUPT, 1);
        if (status == 1) {
            if (!whole(in, WORDS))
                add(r, TORN, 1);
            if (in[0] <= get(r, LAST))
                add(r, BACKWARDS, 1);
            if (in[1] != epoch)
                add(r, WRONG, 1);
            set(r, LAST, in[0]);
            add(r, GOT, 1);
        }
        if (get(r, CYCLES) % 8 == 0) {
            fill(out, WORDS, sj_feedback_latest(base) + 1, epoch);
            sj_feedback_publish(base, out);
        }
        add(r, CYCLES, 1);
    }
}

void peer_monitor(const void *base, uint64_t *r)
{
    uint64_t in[WORDS], number = 0;
    while (!get(r, STOP)) {
        const int32_t status = sj_feedback_read(base, in, &number);
        if (status < 0)
            add(r, LAPPED, 1);
        if (status != 1)
            continue;
        if (!whole(in, WORDS) || in[0] != number)
            add(r, TORN, 1);
        if (number < get(r, LAST))
            add(r, BACKWARDS, 1);
        set(r, LAST, number);
        add(r, GOT, 1);
    }
}

/* A cyclic kernel: `count` cycles of `period_ns`, the computing time of each into `took_ns`. */
void peer_paced(void *base, uint64_t *r, uint32_t *took_ns, uint64_t count, uint64_t period_ns)
{
    uint64_t in[WORDS], out[WORDS];
    const struct timespec pause = {0, (long)period_ns};
    for (uint64_t i = 0; i < count && !get(r, STOP); i++) {
        nanosleep(&pause, NULL);
        const uint64_t begun = cpu_ns();
        const int32_t status = sj_command_collect(base, in);
        if (status == 1)
            add(r, GOT, 1);
        if (status < 0)
            add(r, TORN, 1);
        fill(out, WORDS, sj_feedback_latest(base) + 1, 0);
        sj_feedback_publish(base, out);
        took_ns[i] = (uint32_t)(cpu_ns() - begun);
        add(r, CYCLES, 1);
    }
}

/* ---- ring ------------------------------------------------------------------------------------ */

void peer_producer(void *base, uint64_t *r, uint64_t most)
{
    uint64_t out[8][RECORD];
    uint32_t batch = 1;
    while (!get(r, STOP) && sj_ring_published(base) < most) {
        const uint64_t left = most - sj_ring_published(base);
        const uint32_t count = batch < left ? batch : (uint32_t)left;
        for (uint32_t i = 0; i < count; i++)
            fill(out[i], RECORD, sj_ring_published(base) + i + 1, 0);
        const int32_t status = sj_ring_publish(base, out, count);
        if (status == 1) {
            add(r, SENT, count);
            batch = batch % 8 + 1;
        } else if (status == 0)
            sched_yield();
        else if (status == SJ_SHM_KERNEL_RESTARTED)
            sj_shm_address(base);
        else
            add(r, CORRUPT, 1);
    }
}

void peer_consumer(void *base, uint64_t *r, uint64_t most)
{
    uint64_t in[RECORD];
    while (!get(r, STOP) && get(r, LAST) < most) {
        const int32_t status = sj_ring_take(base, in);
        if (status < 0)
            add(r, CORRUPT, 1);
        if (status == 0)
            sched_yield();
        if (status != 1)
            continue;
        if (!whole(in, RECORD))
            add(r, TORN, 1);
        if (in[0] <= get(r, LAST))
            add(r, DOUBLED, 1);
        else
            add(r, LOST, in[0] - get(r, LAST) - 1);
        set(r, LAST, in[0]);
        add(r, GOT, 1);
    }
}

/* ---- events ---------------------------------------------------------------------------------- */

void peer_events(void *base, uint64_t *r, uint64_t most)
{
    uint64_t out[RECORD];
    while (!get(r, STOP) && sj_event_latest(base) < most) {
        fill(out, RECORD, sj_event_latest(base) + 1, 0);
        sj_event_publish(base, out);
        add(r, SENT, 1);
    }
}

/* Until event `most` has been seen or missed; every gap is held against the numbers in the payload. */
void peer_listener(const void *base, uint64_t *r, uint64_t most)
{
    uint64_t in[RECORD], cursor = 0, missed = 0;
    while (!get(r, STOP) && cursor < most) {
        const uint64_t before = missed;
        const int32_t status = sj_event_read(base, &cursor, in, &missed);
        if (status < 0)
            add(r, LAPPED, 1);
        if (status != 1)
            continue;
        if (!whole(in, RECORD))
            add(r, TORN, 1);
        if (in[0] - get(r, LAST) - 1 != missed - before)
            add(r, WRONG, 1);
        set(r, LAST, in[0]);
        set(r, MISSED, missed);
        add(r, GOT, 1);
    }
}

/* ---- naive variants, which tear -------------------------------------------------------------- */

void naive_writer(uint64_t *shared, uint64_t *r, uint64_t most, int twice)
{
    uint64_t out[WORDS];
    for (uint64_t n = 1; n <= most && !get(r, STOP); n++) {
        fill(out, WORDS, n, 0);
        memcpy(shared + WORDS * (twice ? 1 + n % 2 : 1), out, sizeof out);
        __atomic_store_n(&shared[0], n, __ATOMIC_RELEASE);
        set(r, SENT, n);
    }
}

void naive_reader(const uint64_t *shared, uint64_t *r, int twice)
{
    uint64_t in[WORDS];
    while (!get(r, STOP)) {
        const uint64_t n = __atomic_load_n(&shared[0], __ATOMIC_ACQUIRE);
        if (n == get(r, LAST))
            continue;
        memcpy(in, shared + WORDS * (twice ? 1 + n % 2 : 1), sizeof in);
        if (!whole(in, WORDS))
            add(r, TORN, 1);
        set(r, LAST, n);
        add(r, GOT, 1);
    }
}

/* ---- a spin on one cache line: the limit of any round trip ----------------------------------- */

void spin_echo(uint64_t *line, uint64_t count)
{
    for (uint64_t n = 1; n <= count; n++) {
        while (__atomic_load_n(&line[0], __ATOMIC_ACQUIRE) != n) {}
        __atomic_store_n(&line[1], n, __ATOMIC_RELEASE);
    }
}

static uint64_t wall_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000ULL + (uint64_t)t.tv_nsec;
}

/* Both askers time blocks of round trips, so that the clock weighs little. */
void spin_ask(uint64_t *line, uint64_t blocks, uint64_t block, uint32_t *took_ns)
{
    uint64_t n = 0;
    for (uint64_t i = 0; i < blocks; i++) {
        const uint64_t begun = wall_ns();
        for (uint64_t k = 0; k < block; k++) {
            __atomic_store_n(&line[0], ++n, __ATOMIC_RELEASE);
            while (__atomic_load_n(&line[1], __ATOMIC_ACQUIRE) != n) {}
        }
        took_ns[i] = (uint32_t)(wall_ns() - begun);
    }
}

/* The kernel of the latency benchmark: every command is answered by a frame with its bytes. */
void peer_echo(void *base, const uint64_t *stop)
{
    uint64_t in[512];
    while (!__atomic_load_n(stop, __ATOMIC_RELAXED))
        if (sj_command_collect(base, in) == 1)
            sj_feedback_publish(base, in);
}

/* The host of the same in C: what the exchange costs without Python. */
void peer_ask(void *base, uint64_t blocks, uint64_t block, uint32_t *took_ns)
{
    uint64_t out[512] = {0}, number;
    for (uint64_t i = 0; i < blocks; i++) {
        const uint64_t begun = wall_ns();
        for (uint64_t k = 0; k < block; k++) {
            const uint64_t before = sj_feedback_latest(base);
            sj_command_publish(base, out);
            while (sj_feedback_latest(base) == before) {}
            sj_feedback_read(base, out, &number);
        }
        took_ns[i] = (uint32_t)(wall_ns() - begun);
    }
}

/* ---- threads, for ThreadSanitizer ------------------------------------------------------------ */

#ifdef PEER_THREADS
static uint8_t *base;
static uint64_t counts[8][COUNTERS];
static uint64_t most;

static void *host(void *a)
{
    peer_host(base, a, most);
    peer_producer(base, a, most);
    sj_ring_flush(base);
    return NULL;
}
static void *kernel(void *a)
{
    uint64_t event[RECORD], in[RECORD], out[WORDS], *r = a;
    while (!get(r, STOP)) {
        uint64_t command[WORDS];
        const int32_t status = sj_command_collect(base, command);
        if (status < 0)
            add(r, CORRUPT, 1);
        if (status == 1) {
            if (!whole(command, WORDS))
                add(r, TORN, 1);
            if (command[0] <= get(r, LAST))
                add(r, BACKWARDS, 1);
            set(r, LAST, command[0]);
            add(r, GOT, 1);
        }
        if (sj_ring_take(base, in) == 1 && !whole(in, RECORD))
            add(r, TORN, 1);
        for (uint32_t slot = 0; slot < 2; slot++) {
            sj_stop stop;
            if (!sj_stop_take(base, slot, &stop))
                continue;
            /* a request of two sets is two operations: either may come first, never a part of one */
            if (stop.halts != 0 && stop.halts != stop.pid)
                add(r, TORN, 1);
            if (stop.quick_stops != 0 && stop.quick_stops != ~stop.pid)
                add(r, TORN, 1);
            add(r, DOUBLED, 1); /* counts the stops here */
        }
        fill(out, WORDS, sj_feedback_latest(base) + 1, 0);
        sj_feedback_publish(base, out);
        fill(event, RECORD, sj_event_latest(base) + 1, 0);
        sj_event_publish(base, event);
        sj_shm_beat_kernel(base, get(r, CYCLES));
        sj_shm_note_host(base, sj_shm_host_epoch(base), 1);
        if (sj_shm_host_state(base, get(r, CYCLES)) == SJ_HOST_DEAD)
            add(r, WRONG, 1);
        add(r, CYCLES, 1);
    }
    return NULL;
}
/* Two processes that stop beside the host, each in a slot of its own, and one of them in turns. */
static void *stopper(void *a)
{
    uint64_t *r = a;
    const uint32_t slot = r == counts[5] ? 0 : 1;
    for (uint64_t turn = 1; !get(r, STOP); turn++) {
        if (!sj_stop_claim(base, slot, turn))
            continue;
        set(r, LAST, turn);
        sj_stop_request(base, slot, turn, ~turn);
        add(r, SENT, 1);
    }
    return NULL;
}
static void *monitor(void *a)
{
    peer_monitor(base, a);
    return NULL;
}
static void *listener(void *a)
{
    peer_listener(base, a, UINT64_MAX);
    return NULL;
}

int main(int argc, char **argv)
{
    const sj_shm_config config = {WORDS * 8, WORDS * 8, RECORD * 8, 16, RECORD * 8, 16, 1};
    const uint64_t size = sj_shm_size(&config);
    void *(*const jobs[])(void *) = {host, kernel, monitor, monitor, listener, stopper, stopper};
    enum { THREADS = sizeof jobs / sizeof *jobs };
    pthread_t threads[THREADS];
    most = argc > 1 ? strtoull(argv[1], NULL, 10) : 20000;
    base = aligned_alloc(4096, size);
    if (!base || sj_shm_format(base, size, &config) != 0)
        return 2;
    sj_shm_begin_kernel(base, 0);
    sj_shm_begin_host(base, 1, 0);
    for (int i = 0; i < THREADS; i++)
        if (pthread_create(&threads[i], NULL, jobs[i], counts[i]))
            return 2;
    pthread_join(threads[0], NULL);
    for (int i = 1; i < THREADS; i++)
        set(counts[i], STOP, 1);
    for (int i = 1; i < THREADS; i++)
        pthread_join(threads[i], NULL);
    uint64_t wrong = 0;
    for (int i = 0; i < THREADS; i++)
        wrong += counts[i][TORN] + counts[i][CORRUPT] + counts[i][BACKWARDS] + counts[i][WRONG];
    printf("sent %llu cycles %llu collected %llu frames %llu events %llu missed %llu stops %llu "
           "wrong %llu\n",
           (unsigned long long)counts[0][SENT], (unsigned long long)counts[1][CYCLES],
           (unsigned long long)counts[1][GOT],
           (unsigned long long)(counts[2][GOT] + counts[3][GOT]),
           (unsigned long long)counts[4][GOT], (unsigned long long)counts[4][MISSED],
           (unsigned long long)counts[1][DOUBLED], (unsigned long long)wrong);
    return wrong != 0;
}
#endif
