/* Who lives: epochs, heartbeats, orderly ends, and what a restart clears away.
 *
 * An epoch counts the hosts and the kernels of a segment; all that is sent carries the epoch of the
 * kernel it is meant for. Time is an argument.
 * Never here: the lock that shows a death (a system call, outside the cycle).
 */
#include "dpram/_pages.h" /* layout and atomics */

/* The new epoch is stored last: until then hosts address the old kernel, whose commands and records
 * are refused by their stamp; nothing addressed to the new one can be cleared away here. */
uint64_t sj_shm_begin_kernel(void *base, uint64_t now_ns)
{
    kernel_page *k = kernel(base);
    const uint64_t epoch = load(&k->epoch) + 1;
    uint32_t old = atomic_load_explicit(command_word(base), memory_order_relaxed);
    while (!atomic_compare_exchange_weak_explicit(command_word(base), &old, old & ~(1U << 6),
                                                  memory_order_acq_rel, memory_order_relaxed)) {}
    const uint64_t head = acquire(&host_of(base)->head), tail = load(&k->tail);
    if (header(base)->config.record_capacity != 0 &&
        head - tail <= header(base)->config.record_capacity) {
        store(&k->discarded, load(&k->discarded) + (head - tail));
        release(&k->tail, head);
    }
    sj_stop_clear(base);
    store(&k->host_note, 0);
    store(&k->beat_ns, now_ns);
    release(&k->epoch, epoch);
    return epoch;
}

/* Disturbs nothing: the kernel goes on with what it has. */
uint64_t sj_shm_begin_host(void *base, uint64_t pid, uint64_t now_ns)
{
    host_page *h = host(base);
    const uint64_t epoch = load(&h->epoch) + 1;
    store(&h->timeout_ns, 0);
    store(&h->beat_ns, now_ns);
    store(&h->pid, pid);
    store(&h->addressed, acquire(&kernel_of(base)->epoch));
    release(&h->epoch, epoch);
    return epoch;
}

void sj_shm_leave_host(void *base)
{
    store(&host(base)->timeout_ns, 0);
    release(&host(base)->left, load(&host(base)->epoch));
}

void sj_shm_leave_kernel(void *base) { release(&kernel(base)->left, load(&kernel(base)->epoch)); }

int32_t sj_shm_kernel_left(const void *base)
{
    const uint64_t left = acquire(&kernel_of(base)->left);
    return left != 0 && left == acquire(&kernel_of(base)->epoch);
}

uint64_t sj_shm_host_left(const void *base) { return acquire(&host_of(base)->left); }
uint64_t sj_shm_kernel_epoch(const void *base) { return acquire(&kernel_of(base)->epoch); }
uint64_t sj_shm_host_epoch(const void *base) { return acquire(&host_of(base)->epoch); }
uint64_t sj_shm_host_pid(const void *base) { return load(&host_of(base)->pid); }

uint64_t sj_shm_address(void *base)
{
    const uint64_t epoch = acquire(&kernel_of(base)->epoch);
    store(&host(base)->addressed, epoch);
    return epoch;
}

uint64_t sj_shm_addressed(const void *base) { return load(&host_of(base)->addressed); }

void sj_shm_watch_host(void *base, uint64_t timeout_ns, uint64_t now_ns)
{
    store(&host(base)->beat_ns, now_ns);
    release(&host(base)->timeout_ns, timeout_ns);
}

void sj_shm_beat_host(void *base, uint64_t now_ns) { release(&host(base)->beat_ns, now_ns); }
void sj_shm_beat_kernel(void *base, uint64_t now_ns) { release(&kernel(base)->beat_ns, now_ns); }
uint64_t sj_shm_host_beat(const void *base) { return acquire(&host_of(base)->beat_ns); }

/* The epoch is read before the lock is looked at: a host that begins in between is not taken for dead. */
void sj_shm_note_host(void *base, uint64_t host_epoch, int32_t lock_held)
{
    release(&kernel(base)->host_note, host_epoch << 1 | (lock_held != 0));
}

/* A note about an earlier host says nothing about this one, which then counts as alive. */
int32_t sj_shm_host_state(const void *base, uint64_t now_ns)
{
    const host_page *h = host_of(base);
    const uint64_t note = acquire(&kernel_of(base)->host_note), epoch = acquire(&h->epoch);
    const uint64_t timeout_ns = acquire(&h->timeout_ns), beat_ns = load(&h->beat_ns);
    if (epoch == 0 || acquire(&h->left) == epoch)
        return SJ_HOST_ABSENT;
    if (note == epoch << 1)
        return SJ_HOST_DEAD;
    if (timeout_ns != 0 && now_ns > beat_ns && now_ns - beat_ns > timeout_ns)
        return SJ_HOST_SILENT;
    return SJ_HOST_ALIVE;
}
