/* The ring, host to kernel: every record once and in order; a batch appears whole or not at all.
 *
 * Record n lies in slot n mod capacity. The host moves the head and the flush mark, the kernel the
 * tail: tail <= flush mark <= head <= tail + capacity, or the counters are corrupt.
 * Never here: a wait; a full ring is a status.
 */
#include "dpram/_pages.h" /* layout and atomics */

int32_t sj_ring_publish(void *base, const void *records, uint32_t count)
{
    const header_page *page = header(base);
    const uint32_t bytes = page->config.record_bytes, capacity = page->config.record_capacity;
    host_page *h = host(base);
    const uint64_t kernel_epoch = load(&h->addressed), host_epoch = load(&h->epoch);
    if (kernel_epoch != acquire(&kernel(base)->epoch))
        return SJ_SHM_KERNEL_RESTARTED;
    const uint64_t head = load(&h->head), used = head - acquire(&kernel(base)->tail);
    if (used > capacity)
        return SJ_SHM_CORRUPT_COUNTER;
    if (count > capacity - used)
        return 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint64_t number = head + i + 1;
        stamp *at = slot(base, page->ring, bytes, (head + i) & (capacity - 1));
        const uint8_t *record = (const uint8_t *)records + (size_t)i * bytes;
        sj_slot_fill(at, number, host_epoch, kernel_epoch, record, bytes);
    }
    release(&h->head, head + count); /* the whole batch, or none of it */
    return 1;
}

int32_t sj_ring_take(void *base, void *record)
{
    const header_page *page = header(base);
    const uint32_t bytes = page->config.record_bytes, capacity = page->config.record_capacity;
    kernel_page *k = kernel(base);
    /* The mark before the head: the host moves the head first, so the mark is never beyond it. */
    const uint64_t flush = acquire(&host_of(base)->flush), head = acquire(&host_of(base)->head);
    const uint64_t epoch = load(&k->epoch);
    uint64_t tail = load(&k->tail);
    if (head - tail > capacity || (flush > tail && flush - tail > head - tail))
        return SJ_SHM_CORRUPT_COUNTER;
    if (flush > tail) {
        store(&k->discarded, load(&k->discarded) + (flush - tail));
        tail = flush;
        release(&k->tail, tail);
    }
    for (; tail != head; tail++) { /* at most `capacity` rounds, and only after a restart */
        const stamp *at = slot_of(base, page->ring, bytes, tail & (capacity - 1));
        const uint64_t number = load(&at->number), host_epoch = load(&at->host_epoch);
        const uint64_t kernel_epoch = load(&at->kernel_epoch);
        if (kernel_epoch < epoch && number == tail + 1) { /* meant for an earlier kernel */
            store(&k->discarded, load(&k->discarded) + 1);
            release(&k->tail, tail + 1);
            continue;
        }
        if (!sj_slot_copy(at, number, host_epoch, kernel_epoch, record, bytes))
            return SJ_SHM_CORRUPT_DATA;
        if (number != tail + 1)
            return SJ_SHM_CORRUPT_COUNTER;
        release(&k->tail, tail + 1);
        return 1;
    }
    return 0;
}

void sj_ring_flush(void *base) { release(&host(base)->flush, load(&host(base)->head)); }
uint64_t sj_ring_published(const void *base) { return acquire(&host_of(base)->head); }
uint64_t sj_ring_taken(const void *base) { return acquire(&kernel_of(base)->tail); }
uint64_t sj_ring_discarded(const void *base) { return load(&kernel_of(base)->discarded); }

uint32_t sj_ring_waiting(const void *base)
{
    const uint64_t tail = acquire(&kernel_of(base)->tail), flush = acquire(&host_of(base)->flush);
    const uint64_t head = acquire(&host_of(base)->head), first = flush > tail ? flush : tail;
    const uint64_t waiting = head - first;
    return waiting > header(base)->config.record_capacity ? 0 : (uint32_t)waiting;
}
