/* Every step of the real C: runs the C of dpram/ with a scheduler between its atomic operations.
 *
 * That C is compiled with -fsanitize=thread but linked with this file instead of the sanitizer:
 * each atomic operation then calls a function below, which may first let the other side run, or kill
 * this side, whose successor begins as after kill -9. All runs with up to `deviations` such switches
 * and kills are tried, by replaying from the start. Usage: steps PROTOCOL DEVIATIONS
 * Prints "runs N kills N", or "violation: ..." with exit status 1. Single-threaded and deterministic.
 */
#define _XOPEN_SOURCE 700
#include <stdint.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <ucontext.h>
#include "dpram/_dpram.h"

enum { HOST = 0, KERNEL = 1, SWITCH = 0, KILL = 1, MOST = 8, STACK = 1 << 16 };

typedef struct {
    uint64_t number, again;
} item; /* two words that must agree */

static const sj_shm_config CONFIG = {
    sizeof(item), sizeof(item), sizeof(item), 2, sizeof(item), 4, 1};
static struct {
    int at, kind;
} plan[MOST];
static int planned, next, at, now, running, done[2], restart[2];
static ucontext_t director, side[2];
static char stack[2][STACK];
static uint8_t *base, *blank;
static uint64_t size, runs, kills, last, published[2], cursor, missed, seen;
static uint64_t life, slot_now, begun[MOST], ended[MOST], stopped,
    kernels; /* stops: of each life of the host */
static const char *protocol;

static void violation(const char *what)
{
    printf("violation: %s: %s, deviations", protocol, what);
    for (int i = 0; i < planned; i++)
        printf(" %s@%d", plan[i].kind == KILL ? "kill" : "switch", plan[i].at);
    printf("\n");
    exit(1);
}

/* ---- the scheduler, called before every atomic operation ------------------------------------- */

static void step(void)
{
    if (!running)
        return;
    at++;
    while (next < planned && plan[next].at == at) {
        const int me = now;
        if (plan[next++].kind == KILL) {
            kills++;
            restart[me] = 1;
            setcontext(&director);
        } else if (!done[1 - me]) {
            now = 1 - me;
            swapcontext(&side[me], &side[1 - me]);
        }
    }
}

void __tsan_init(void) {}
void __tsan_func_entry(void *p) { (void)p; }
void __tsan_func_exit(void) {}
void __tsan_read4(void *p) { (void)p; }
void __tsan_read8(void *p) { (void)p; }
void __tsan_write4(void *p) { (void)p; }
void __tsan_write8(void *p) { (void)p; }
void __tsan_read_range(void *p, size_t n)
{
    (void)p;
    (void)n;
}
void __tsan_write_range(void *p, size_t n)
{
    (void)p;
    (void)n;
}
void __tsan_atomic_thread_fence(int order) { (void)order; }
uint64_t __tsan_atomic64_load(const volatile uint64_t *p, int order)
{
    (void)order;
    step();
    return *p;
}
void __tsan_atomic64_store(volatile uint64_t *p, uint64_t v, int order)
{
    (void)order;
    step();
    *p = v;
}
uint32_t __tsan_atomic32_load(const volatile uint32_t *p, int order)
{
    (void)order;
    step();
    return *p;
}
void __tsan_atomic32_store(volatile uint32_t *p, uint32_t v, int order)
{
    (void)order;
    step();
    *p = v;
}
int __tsan_atomic32_compare_exchange_weak(volatile uint32_t *p, uint32_t *expected, uint32_t v,
                                          int a, int b)
{
    (void)a;
    (void)b;
    step();
    if (*p == *expected) {
        *p = v;
        return 1;
    }
    *expected = *p;
    return 0;
}

uint64_t __tsan_atomic64_fetch_or(volatile uint64_t *p, uint64_t v, int order)
{
    (void)order;
    step();
    const uint64_t old = *p;
    *p = old | v;
    return old;
}
uint64_t __tsan_atomic64_exchange(volatile uint64_t *p, uint64_t v, int order)
{
    (void)order;
    step();
    const uint64_t old = *p;
    *p = v;
    return old;
}

/* ---- what each side does --------------------------------------------------------------------- */

static void whole(const item *i)
{
    if (i->again != i->number * 3)
        violation("torn");
}

static void check_command(void)
{
    item in;
    const uint64_t epoch = sj_shm_kernel_epoch(base);
    const int32_t status = sj_command_collect(base, &in);
    if (status < 0)
        violation("corrupt");
    if (status == 0)
        return;
    whole(&in);
    if (in.number <= last)
        violation("backwards");
    if (in.number >> 8 != epoch)
        violation("meant for another kernel");
    last = in.number;
}

static void check_ring(void)
{
    item in;
    const uint64_t epoch = sj_shm_kernel_epoch(base), tail = sj_ring_taken(base);
    const int32_t status = sj_ring_take(base, &in);
    if (status < 0)
        violation("corrupt");
    if (status == 0)
        return;
    whole(&in);
    if ((in.number & 0xFF) <= (last & 0xFF))
        violation("doubled");
    if (in.number >> 8 != epoch)
        violation("meant for another kernel");
    if ((in.number & 0xFF) != sj_ring_taken(base) || (in.number & 0xFF) <= tail)
        violation("out of order");
    last = in.number;
}

static void check_feedback(void)
{
    item in;
    uint64_t number = 0;
    const int32_t status = sj_feedback_read(base, &in, &number);
    if (status < 0)
        violation("lapped for ever");
    if (status == 0)
        return;
    whole(&in);
    if (number < last || in.number != number)
        violation("backwards");
    last = number;
}

static void check_event(void)
{
    item in;
    const int32_t status = sj_event_read(base, &cursor, &in, &missed);
    if (status < 0)
        violation("lapped for ever");
    if (status == 0)
        return;
    whole(&in);
    seen++;
    if (in.number != cursor || seen + missed != cursor)
        violation("gap counted wrongly");
}

/* Each request is of an axis of its own, so that each can be told from the others. */
static void check_stops(void)
{
    sj_stop stop;
    for (uint32_t index = 0; index < 2; index++) {
        if (!sj_stop_take(base, index, &stop))
            continue;
        const uint64_t axes = stop.halts | stop.quick_stops;
        if (axes == 0 || stop.pid == 0 || stop.pid > life + 1)
            violation("a stop of nobody");
        if (axes & ~begun[stop.pid - 1])
            violation("not asked by who is told");
        if (stop.quick_stops & 0xAAAAAAAAAAAAAAAAULL || stop.halts & 0x5555555555555555ULL)
            violation("mixed up");
        if (axes & stopped)
            violation("doubled");
        stopped |= axes;
    }
}

static void ask_stops(void)
{
    slot_now = sj_stop_claim(base, 0, life + 1) ? 0 : 1;
    if (slot_now == 1 && !sj_stop_claim(base, 1, life + 1))
        return;
    for (int i = 0; i < 4; i++) {
        const uint64_t axis = 1ULL << (8 * life + (uint64_t)i);
        begun[life] |= axis;
        sj_stop_request(base, (uint32_t)slot_now, i % 2 ? axis : 0, i % 2 ? 0 : axis);
        ended[life] |= axis;
    }
}

static item make(uint64_t number) { return (item){number, number * 3}; }

static void host(void)
{
    if (restart[HOST]) {
        sj_shm_begin_host(base, 1, 0);
        life++;
    }
    restart[HOST] = 0;
    if (protocol[0] == 'c') {
        for (int i = 0; i < 2; i++) {
            sj_shm_address(base);
            const uint64_t epoch = sj_shm_addressed(base);
            const item out = make(epoch << 8 | (sj_command_published(base) + 1));
            if (sj_command_publish(base, &out) == 0)
                published[0] = out.number;
        }
    } else if (protocol[0] == 'r') {
        for (int i = 0; i < 3; i++) {
            sj_shm_address(base);
            const uint64_t number = sj_shm_addressed(base) << 8 | (sj_ring_published(base) + 1);
            const item out[2] = {make(number), make(number + 1)};
            if (i == 2)
                sj_ring_flush(base);
            sj_ring_publish(base, out, i == 0 ? 2 : 1);
        }
    } else if (protocol[0] == 's') {
        ask_stops();
    } else {
        for (int i = 0; i < 3; i++)
            protocol[0] == 'f' ? check_feedback() : check_event();
    }
    done[HOST] = 1;
    now = KERNEL;
    setcontext(done[KERNEL] ? &director : &side[KERNEL]);
}

static void kernel(void)
{
    if (restart[KERNEL]) {
        kernels++;
        sj_shm_begin_kernel(base, 0);
    }
    restart[KERNEL] = 0;
    for (int i = 0; i < 3; i++) {
        if (protocol[0] == 'c')
            check_command();
        else if (protocol[0] == 'r')
            check_ring();
        else if (protocol[0] == 's')
            check_stops();
    }
    const int frames = protocol[0] == 'f' ? SJ_SHM_FEEDBACK_SLOTS + 2 : 6;
    for (int i = 0; i < frames; i++) {
        if (protocol[0] == 'f') {
            const item out = make(sj_feedback_latest(base) + 1);
            sj_feedback_publish(base, &out);
        } else if (protocol[0] == 'e') {
            const item out = make(sj_event_latest(base) + 1);
            sj_event_publish(base, &out);
        }
    }
    done[KERNEL] = 1;
    now = HOST;
    setcontext(done[HOST] ? &director : &side[HOST]);
}

/* ---- all runs -------------------------------------------------------------------------------- */

static void prepare(int which)
{
    getcontext(&side[which]);
    side[which].uc_stack.ss_sp = stack[which];
    side[which].uc_stack.ss_size = STACK;
    side[which].uc_link = &director;
    makecontext(&side[which], which == HOST ? host : kernel, 0);
}

static int run(void)
{
    memcpy(base, blank, size);
    next = at = now = 0;
    last = cursor = missed = seen = published[0] = 0;
    life = stopped = kernels = 0;
    memset(begun, 0, sizeof begun);
    memset(ended, 0, sizeof ended);
    memset(done, 0, sizeof done);
    memset(restart, 0, sizeof restart);
    prepare(HOST);
    prepare(KERNEL);
    running = 1;
    getcontext(&director); /* comes back here after a kill, and when both are done */
    if (!done[HOST] || !done[KERNEL]) {
        if (restart[now])
            prepare(now);
        setcontext(&side[now]);
    }
    running = 0;
    runs++;
    if (protocol[0] == 'c') { /* nothing lost: the last command for this kernel arrives */
        for (int i = 0; i < 2; i++)
            check_command();
        if (published[0] >> 8 == sj_shm_kernel_epoch(base) && published[0] > last)
            violation("lost");
    } else if (protocol[0] == 'r') {
        for (int i = 0; i < 4; i++)
            check_ring();
        if (sj_ring_taken(base) != sj_ring_published(base))
            violation("stuck");
    } else if (protocol[0] == 's') {
        check_stops();
        for (uint64_t i = 0; i <= life && kernels == 0; i++)
            if (ended[i] & ~stopped)
                violation("lost");
        if (sj_stop_waits(base, 0) || sj_stop_waits(base, 1))
            violation("stuck");
    } else if (protocol[0] == 'f') {
        check_feedback();
    } else {
        for (int i = 0; i < 4; i++)
            check_event();
        if (cursor != sj_event_latest(base))
            violation("stuck");
    }
    return at;
}

static void search(int depth, int most)
{
    planned = depth;
    const int steps = run();
    if (depth == most)
        return;
    for (int i = (depth ? plan[depth - 1].at : 0) + 1; i <= steps; i++)
        for (int kind = SWITCH; kind <= KILL; kind++) {
            plan[depth].at = i;
            plan[depth].kind = kind;
            search(depth + 1, most);
            planned = depth;
        }
}

int main(int argc, char **argv)
{
    if (argc != 3)
        return 2;
    protocol = argv[1];
    size = sj_shm_size(&CONFIG);
    base = aligned_alloc(4096, size);
    blank = aligned_alloc(4096, size);
    if (!base || !blank || sj_shm_format(blank, size, &CONFIG) != 0)
        return 2;
    sj_shm_begin_kernel(blank, 0);
    sj_shm_begin_host(blank, 1, 0);
    for (uint64_t i = 1; i <= SJ_SHM_FEEDBACK_SLOTS; i++) { /* a lap, so that readers have prey */
        const item out = make(i);
        sj_feedback_publish(blank, &out);
        sj_event_publish(blank, &out);
    }
    search(0, atoi(argv[2]));
    printf("runs %llu kills %llu\n", (unsigned long long)runs, (unsigned long long)kills);
    return 0;
}
