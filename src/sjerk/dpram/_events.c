/* The events, kernel to many: a ring that overwrites its oldest; a reader knows how many it has missed.
 *
 * Event n lies in slot n mod capacity. The newest capacity - 1 are kept for readers, since one slot
 * may be under the pen.
 * Never here: a wait of the kernel for a reader.
 */
#include "dpram/_pages.h" /* layout and atomics */

void sj_event_publish(void *base, const void *event)
{
    const header_page *page = header(base);
    word *count = &kernel(base)->events;
    if (page->config.event_capacity == 0)
        return;
    const uint64_t index = (load(count) + 1) & (page->config.event_capacity - 1);
    sj_latch_publish(count, slot(base, page->events, page->config.event_bytes, index), event,
                     page->config.event_bytes);
}

int32_t sj_event_read(const void *base, uint64_t *cursor, void *event, uint64_t *missed)
{
    const header_page *page = header(base);
    const uint64_t capacity = page->config.event_capacity;
    uint64_t number = *cursor + 1;
    for (uint64_t tries = 0; tries < SJ_SHM_READ_TRIES; tries++) {
        const uint64_t latest = acquire(&kernel_of(base)->events);
        if (number > latest)
            return *cursor > latest ? SJ_SHM_CORRUPT_COUNTER : 0;
        /* The slot of event latest + 1 - capacity may be under the pen; after each lap keep further away. */
        const uint64_t keep = capacity - 1 > tries ? capacity - 1 - tries : 1;
        if (latest - number >= keep)
            number = latest - keep + 1;
        const stamp *at =
            slot_of(base, page->events, page->config.event_bytes, number & (capacity - 1));
        if (sj_latch_copy(at, number, event, page->config.event_bytes)) {
            *missed += number - *cursor - 1;
            *cursor = number;
            return 1;
        }
    }
    return SJ_SHM_LAPPED;
}

uint64_t sj_event_latest(const void *base) { return acquire(&kernel_of(base)->events); }
