/* The command, host to kernel: three slots and one word; the newest one counts.
 *
 * The host writes in slot w, the kernel reads from slot r, the one in the middle, m, changes hands.
 * The word holds the whole permutation and whether m is fresh, so that no side keeps its place
 * anywhere else:
 *     host      fill slot w; exchange w and m, set fresh
 *     kernel    fresh? exchange m and r, clear fresh; read slot r
 * Never here: a wait; the kernel needs SJ_SHM_COLLECT_TRIES exchanges at most.
 */
#include "dpram/_pages.h" /* layout and atomics */

/* w, m, r are a permutation of 0, 1, 2: the slot of the writer, the middle, the slot of the reader. */
static int word_legal(uint32_t value)
{
    const uint32_t w = value & 3U, m = value >> 2 & 3U, r = value >> 4 & 3U;
    return value < 128 && w < 3 && m < 3 && r < 3 && w != m && m != r && r != w;
}

static uint32_t word_of(uint32_t w, uint32_t m, uint32_t r, uint32_t fresh)
{
    return w | m << 2 | r << 4 | fresh << 6;
}

int32_t sj_command_publish(void *base, const void *command)
{
    const header_page *page = header(base);
    host_page *h = host(base);
    const uint64_t kernel_epoch = load(&h->addressed);
    if (kernel_epoch != acquire(&kernel(base)->epoch))
        return SJ_SHM_KERNEL_RESTARTED;

    uint32_t old = atomic_load_explicit(command_word(base), memory_order_acquire), new;
    if (!word_legal(old))
        return SJ_SHM_CORRUPT_WORD;

    /* Only the host moves w, so slot w is ours until the exchange below. */
    const uint64_t number = load(&h->published) + 1, host_epoch = load(&h->epoch);
    stamp *at = slot(base, page->command, page->config.command_bytes, old & 3U);
    store(&h->published, number);
    sj_slot_fill(at, number, host_epoch, kernel_epoch, command, page->config.command_bytes);

    do { /* the kernel collects at most once between two of ours */
        if (!word_legal(old))
            return SJ_SHM_CORRUPT_WORD;
        new = word_of(old >> 2 & 3U, old & 3U, old >> 4 & 3U, 1);
    } while (!atomic_compare_exchange_weak_explicit(command_word(base), &old, new,
                                                    memory_order_acq_rel, memory_order_acquire));
    return SJ_SHM_OK;
}

int32_t sj_command_collect(void *base, void *command)
{
    const header_page *page = header(base);
    kernel_page *k = kernel(base);
    uint32_t old = atomic_load_explicit(command_word(base), memory_order_acquire);
    for (int32_t tries = 0;; tries++) {
        if (!word_legal(old))
            return SJ_SHM_CORRUPT_WORD;
        if (old >> 6 == 0 || tries == SJ_SHM_COLLECT_TRIES)
            return 0;
        const uint32_t new = word_of(old & 3U, old >> 4 & 3U, old >> 2 & 3U, 0);
        if (atomic_compare_exchange_weak_explicit(command_word(base), &old, new,
                                                  memory_order_acq_rel, memory_order_acquire)) {
            old = new;
            break;
        }
    }
    const stamp *at = slot(base, page->command, page->config.command_bytes, old >> 4 & 3U);
    const uint64_t number = load(&at->number), host_epoch = load(&at->host_epoch);
    const uint64_t kernel_epoch = load(&at->kernel_epoch);
    if (kernel_epoch < load(&k->epoch))
        return 0; /* meant for an earlier kernel */
    if (!sj_slot_copy(at, number, host_epoch, kernel_epoch, command, page->config.command_bytes))
        return SJ_SHM_CORRUPT_DATA;
    if (number <= load(&k->collected))
        return SJ_SHM_CORRUPT_COUNTER;
    release(&k->collected, number);
    return 1;
}

uint64_t sj_command_published(const void *base) { return load(&host_of(base)->published); }
uint64_t sj_command_collected(const void *base) { return acquire(&kernel_of(base)->collected); }
