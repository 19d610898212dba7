/* Stop requests, any process to the kernel: a stop needs no lock of the host, and is never refused.
 *
 * Who wants to stop axes has a slot of its own: two sets of axes, to be halted and to be quick-stopped,
 * and its process. It adds axes to a set; the kernel, once per cycle, takes each set out whole:
 *     requester    set |= axes
 *     kernel       taken = set, set = {}
 * Each side needs one atomic operation, so no request is half made, none is taken twice, and none is lost,
 * wherever its process is killed. Requests of one slot that the kernel finds together are one stop of
 * all their axes. The last slot belongs to nobody: where all others are taken it serves all who come, and the
 * kernel cannot say who asked.
 *
 * A request names no kernel: it means whoever runs. A new kernel begins without the requests that were
 * made before it.
 * Never here: who has which slot (a lock of the file, outside), how axes stop.
 */
#include "dpram/_pages.h" /* layout and atomics */

static inline stop_slot *stop_at(void *base, uint32_t index)
{
    return (stop_slot *)(void *)((uint8_t *)base + SJ_SHM_STOPS) + index;
}

static inline const stop_slot *stop_of(const void *base, uint32_t index)
{
    return (const stop_slot *)(const void *)((const uint8_t *)base + SJ_SHM_STOPS) + index;
}

int32_t sj_stop_claim(void *base, uint32_t index, uint64_t pid)
{
    if (sj_stop_waits(base, index))
        return 0; /* of the one before, who would be told wrong */
    store(&stop_at(base, index)->pid, pid);
    return 1;
}

void sj_stop_request(void *base, uint32_t index, uint64_t halts, uint64_t quick_stops)
{
    stop_slot *at = stop_at(base, index);
    if (halts != 0)
        atomic_fetch_or_explicit(&at->halts, halts, memory_order_acq_rel);
    if (quick_stops != 0)
        atomic_fetch_or_explicit(&at->quick_stops, quick_stops, memory_order_acq_rel);
}

int32_t sj_stop_waits(const void *base, uint32_t index)
{
    return (acquire(&stop_of(base, index)->halts) | acquire(&stop_of(base, index)->quick_stops)) !=
           0;
}

/* Looks before it exchanges: a cycle without a stop writes nothing. It asks whose slot it is while a request
 * waits, since no other process claims it then; and it takes out what it saw waiting before it asked, and
 * no other set, which may be of the next process by now. */
int32_t sj_stop_take(void *base, uint32_t index, sj_stop *stop)
{
    stop_slot *at = stop_at(base, index);
    const uint64_t halts = acquire(&at->halts), quick_stops = acquire(&at->quick_stops);
    if ((halts | quick_stops) == 0)
        return 0;
    *stop = (sj_stop){0, 0, load(&at->pid)};
    if (quick_stops != 0)
        stop->quick_stops = atomic_exchange_explicit(&at->quick_stops, 0, memory_order_acq_rel);
    if (halts != 0)
        stop->halts = atomic_exchange_explicit(&at->halts, 0, memory_order_acq_rel);
    return 1;
}

void sj_stop_clear(void *base)
{
    for (uint32_t i = 0; i < SJ_STOP_SLOTS; i++) {
        store(&stop_at(base, i)->halts, 0);
        store(&stop_at(base, i)->quick_stops, 0);
    }
}
