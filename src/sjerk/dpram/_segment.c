/* The segment: made once, checked by each process that opens it; what a cycle will touch, fetched ahead.
 *
 * Its memory is whole once `ready` is stored, last.
 * Never here: names, files, permissions (dpram/ in Python has them).
 */
#include <string.h>       /* memcpy, memset on private memory */
#include "base/_simd.h"   /* fetching ahead */
#include "dpram/_pages.h" /* layout and atomics */

static const uint8_t MAGIC[8] = {'s', 'j', 'e', 'r', 'k', '-', 'm', '\n'};
static const uint64_t READY = 0x7964616572ULL;
enum { MAX_BYTES = 1 << 20, MAX_CAPACITY = 1 << 20 };

static uint64_t pages(uint64_t bytes)
{
    return (bytes + SJ_SHM_PAGE - 1) / SJ_SHM_PAGE * SJ_SHM_PAGE;
}

static int power_of_two(uint32_t value) { return value != 0 && (value & (value - 1)) == 0; }

static int config_valid(const sj_shm_config *c)
{
    return c->command_bytes > 0 && c->command_bytes <= MAX_BYTES && c->feedback_bytes > 0 &&
           c->feedback_bytes <= MAX_BYTES &&
           (c->record_capacity == 0 ||
            (power_of_two(c->record_capacity) && c->record_capacity <= MAX_CAPACITY &&
             c->record_bytes > 0 && c->record_bytes <= MAX_BYTES)) &&
           (c->event_capacity == 0 || (power_of_two(c->event_capacity) && c->event_capacity >= 4 &&
                                       c->event_capacity <= MAX_CAPACITY && c->event_bytes > 0 &&
                                       c->event_bytes <= MAX_BYTES));
}

/* The whole header of a valid config, but for `ready`. */
static void header_fill(header_page *page, const sj_shm_config *config)
{
    memcpy(page->magic, MAGIC, sizeof MAGIC);
    page->major = SJ_SHM_MAJOR;
    page->minor = SJ_SHM_MINOR;
    page->config = *config;
    page->command = SJ_SHM_SLOTS;
    page->feedback = page->command + pages(3 * stride(config->command_bytes));
    page->ring = page->feedback + pages(SJ_SHM_FEEDBACK_SLOTS * stride(config->feedback_bytes));
    page->events = page->ring + pages(config->record_capacity * stride(config->record_bytes));
    page->size = page->events + pages(config->event_capacity * stride(config->event_bytes));
    uint64_t sum = 0;
    for (size_t at = 0; at < offsetof(header_page, checksum); at += 8) {
        uint64_t value;
        memcpy(&value, (const uint8_t *)page + at, 8);
        sum = mix(sum, value);
    }
    page->checksum = sum;
}

uint64_t sj_shm_size(const sj_shm_config *config)
{
    header_page page;
    if (!config_valid(config))
        return 0;
    header_fill(&page, config);
    return page.size;
}

int32_t sj_shm_format(void *base, uint64_t size, const sj_shm_config *config)
{
    header_page *page = base;
    if (!config_valid(config) || (uintptr_t)base % sizeof(word) != 0)
        return SJ_SHM_CONFIG;
    if (size < sj_shm_size(config))
        return SJ_SHM_TRUNCATED;
    store(&page->ready, 0);
    memset((uint8_t *)base + SJ_SHM_HOST, 0, sj_shm_size(config) - SJ_SHM_HOST);
    header_fill(page, config);
    atomic_store_explicit(command_word(base), 0U | 1U << 2 | 2U << 4, memory_order_relaxed);
    release(&page->ready, READY);
    return SJ_SHM_OK;
}

int32_t sj_shm_check(const void *base, uint64_t size, const sj_shm_config *config)
{
    const header_page *page = base;
    header_page expected;
    if (size < SJ_SHM_SLOTS)
        return SJ_SHM_TRUNCATED;
    const uint64_t ready = acquire(&page->ready);
    if (ready == 0)
        return SJ_SHM_NOT_READY;
    if (memcmp(page->magic, MAGIC, sizeof MAGIC) != 0)
        return SJ_SHM_MAGIC;
    if (page->major != SJ_SHM_MAJOR)
        return SJ_SHM_VERSION;
    if (ready != READY || !config_valid(&page->config))
        return SJ_SHM_CORRUPT_HEADER;
    header_fill(&expected, &page->config);
    expected.minor = page->minor;
    if (page->size != expected.size || page->command != expected.command ||
        page->feedback != expected.feedback || page->ring != expected.ring ||
        page->events != expected.events)
        return SJ_SHM_CORRUPT_HEADER;
    if (page->minor == SJ_SHM_MINOR && page->checksum != expected.checksum)
        return SJ_SHM_CORRUPT_HEADER;
    if (size < page->size)
        return SJ_SHM_TRUNCATED;
    if (config != NULL) {
        if (page->config.abi != config->abi)
            return SJ_SHM_ABI;
        if (memcmp(&page->config, config, sizeof *config) != 0)
            return SJ_SHM_CONFIG;
    }
    return SJ_SHM_OK;
}

int32_t sj_shm_read_config(const void *base, uint64_t size, sj_shm_config *config)
{
    const int32_t status = sj_shm_check(base, size, NULL);
    if (status == SJ_SHM_OK)
        *config = header(base)->config;
    return status;
}

uint32_t sj_shm_read_version(const void *base, uint64_t size)
{
    const header_page *page = base;
    return size < SJ_SHM_PAGE ? 0 : (page->major & 0xFFFFU) << 16 | (page->minor & 0xFFFFU);
}

/* The words that every cycle looks at, and the slot that the next frame goes to. */
void sj_shm_warm(const void *base)
{
    const header_page *page = header(base);
    const host_page *h = host_of(base);
    const kernel_page *k = kernel_of(base);
    const uint64_t index = (load(&k->feedback) + 1) % SJ_SHM_FEEDBACK_SLOTS;
    fetch(page, sizeof *page);
    fetch(h, sizeof *h);
    fetch(k, sizeof *k);
    fetch((const uint8_t *)base + SJ_SHM_COMMAND, sizeof(command_page));
    fetch((const uint8_t *)base + SJ_SHM_STOPS, SJ_STOP_SLOTS * sizeof(stop_slot));
    fetch(slot_of(base, page->feedback, page->config.feedback_bytes, index),
          sizeof(stamp) + page->config.feedback_bytes);
}
