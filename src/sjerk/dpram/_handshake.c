/* The dual-port RAM: one memory segment between a host and a motion kernel.
 *
 * Holds the layout, the four exchanges (command, feedback, ring, events), the epochs and heartbeats;
 * the atomics of the project. Payloads are bytes. Never here: what a payload means, a clock,
 * a lock, a system call, an allocation. Every function works as well on plain private memory.
 *
 *   byte 0      +---------------------+
 *               | header              |  written once by the creator; `ready` last
 *   4096        +---------------------+
 *               | host page           |  written by the host: epoch, heartbeat, ring head, flush mark
 *   8192        +---------------------+
 *               | command word        |  w | m << 2 | r << 4 | fresh << 6, written by both
 *   12288       +---------------------+
 *               | kernel page         |  written by the kernel: epoch, heartbeat, ring tail, counts
 *   16384       +---------------------+
 *               | command slots 0 1 2 |  written by the host, in slot w only
 *               +---------------------+
 *               | feedback slots 0..7 |  written by the kernel, frame n in slot n mod 8
 *               +---------------------+
 *               | ring records        |  written by the host, record n in slot n mod capacity
 *               +---------------------+
 *               | event slots         |  written by the kernel, event n in slot n mod capacity
 *               +---------------------+
 *
 * Pages have one owner so that no cache line is written by two sides, except the one word.
 * A slot is a stamp of 64 bytes and the payload, together a multiple of 64.
 *
 * Counters that must survive the death of their writer live in the segment, not in the writer:
 * a restarted side goes on where its predecessor published last, and overwrites what that one left
 * half-written. docs/explanation/handshake.md says what holds at a kill after each store.
 */
#include <stdatomic.h>                  /* its only use beside the end flag of _clock.c */
#include <stddef.h>                     /* offsetof, NULL */
#include <stdint.h>                     /* fixed widths, for both readers of the contract */
#include <string.h>                     /* memcpy, memset on private memory */
#include "dpram/_dpram.h"                    /* the contract */
#include "base/_simd.h"                      /* fetching ahead */

typedef _Atomic uint64_t word;          /* shared memory is touched in whole words only */

typedef struct {
    uint8_t magic[8];
    uint32_t major, minor;
    sj_shm_config config;
    uint64_t size, command, feedback, ring, events;  /* bytes in all; where the slots begin */
    uint64_t checksum;                  /* of everything above */
    word ready;                         /* READY, stored last */
} header_page;

typedef struct {
    word epoch;                         /* hosts so far */
    word pid;                           /* of the present host, for messages only */
    word left;                          /* the last epoch that ended in order */
    word addressed;                     /* the kernel epoch that this host speaks to */
    word timeout_ns;                    /* 0: a silent host is normal */
    uint8_t pad0[88];
    word beat_ns;
    uint8_t pad1[120];
    word published;                     /* commands begun */
    uint8_t pad2[120];
    word head;                          /* ring records published */
    word flush;                         /* records before this number are to be discarded */
} host_page;

typedef struct {
    _Atomic uint32_t word;
} command_page;

typedef struct {
    word epoch;                         /* kernels so far */
    word left;                          /* the last epoch that ended in order */
    word host_note;                     /* host epoch << 1 | its lock is held, as last looked at */
    uint8_t pad0[104];
    word beat_ns;
    uint8_t pad1[120];
    word collected;                     /* number of the newest command taken */
    uint8_t pad2[120];
    word tail;                          /* ring records taken or discarded */
    word discarded;
    uint8_t pad3[112];
    word feedback;                      /* frames published */
    uint8_t pad4[120];
    word events;                        /* events published */
} kernel_page;

/* The stamp of a slot. The checksum covers the other four words and the payload. */
typedef struct {
    word number;                        /* 1, 2, ...; 0 while a latch slot is being written */
    word host_epoch, kernel_epoch;      /* by whom and for whom */
    word checksum;
    uint8_t pad[32];
} stamp;

_Static_assert(ATOMIC_LLONG_LOCK_FREE == 2 && ATOMIC_INT_LOCK_FREE == 2,
               "atomics with a hidden lock would not work between processes");
_Static_assert(sizeof(word) == 8 && sizeof(_Atomic uint32_t) == 4, "atomics are plain words");
_Static_assert(sizeof(sj_shm_config) == 32 && offsetof(sj_shm_config, abi) == 24, "no hidden padding");
_Static_assert(offsetof(header_page, config) == 16, "header: config");
_Static_assert(offsetof(header_page, size) == 48, "header: size");
_Static_assert(offsetof(header_page, checksum) == 88, "header: checksum");
_Static_assert(offsetof(header_page, ready) == 96, "header: ready");
_Static_assert(offsetof(host_page, beat_ns) == 128, "host: heartbeat");
_Static_assert(offsetof(host_page, published) == 256, "host: command number");
_Static_assert(offsetof(host_page, head) == 384, "host: ring head");
_Static_assert(offsetof(host_page, flush) == 392, "host: flush mark");
_Static_assert(offsetof(kernel_page, beat_ns) == 128, "kernel: heartbeat");
_Static_assert(offsetof(kernel_page, collected) == 256, "kernel: command number");
_Static_assert(offsetof(kernel_page, tail) == 384, "kernel: ring tail");
_Static_assert(offsetof(kernel_page, feedback) == 512, "kernel: frames");
_Static_assert(offsetof(kernel_page, events) == 640, "kernel: events");
_Static_assert(sizeof(stamp) == 64 && offsetof(stamp, checksum) == 24, "stamp");
_Static_assert(sizeof(header_page) <= SJ_SHM_PAGE && sizeof(host_page) <= SJ_SHM_PAGE &&
               sizeof(kernel_page) <= SJ_SHM_PAGE, "one page each");

static const uint8_t MAGIC[8] = { 's', 'j', 'e', 'r', 'k', '-', 'm', '\n' };
static const uint64_t READY = 0x7964616572ULL;
enum { MAX_BYTES = 1 << 20, MAX_CAPACITY = 1 << 20 };

/* ---- words, copies, checksums ---------------------------------------------------------------- */

static uint64_t load(const word *from) { return atomic_load_explicit(from, memory_order_relaxed); }
static uint64_t acquire(const word *from) { return atomic_load_explicit(from, memory_order_acquire); }
static void store(word *to, uint64_t value) { atomic_store_explicit(to, value, memory_order_relaxed); }
static void release(word *to, uint64_t value) { atomic_store_explicit(to, value, memory_order_release); }

/* Each step is a bijection of `sum`, so a single wrong word can never go unnoticed. */
static uint64_t mix(uint64_t sum, uint64_t value)
{
    sum = (sum ^ value) * 0x9E3779B97F4A7C15ULL;
    return sum ^ (sum >> 32);
}

static uint64_t bytes_to_word(const uint8_t *from, size_t bytes)
{
    uint64_t value = 0;
    memcpy(&value, from, bytes);
    return value;
}

/* Private bytes to shared words, relaxed. Compilers leave loops of atomics as they are: eight words a
 * turn take half as long as one. */
static void copy_in(word *to, const void *from, uint32_t bytes)
{
    const uint8_t *source = from;
    const uint32_t whole = bytes / 8;
    uint32_t i = 0;
    for (; i + 8 <= whole; i += 8) {
        const uint8_t *at = source + 8 * (size_t)i;
        word *eight = to + i;
        store(&eight[0], bytes_to_word(at, 8));
        store(&eight[1], bytes_to_word(at + 8, 8));
        store(&eight[2], bytes_to_word(at + 16, 8));
        store(&eight[3], bytes_to_word(at + 24, 8));
        store(&eight[4], bytes_to_word(at + 32, 8));
        store(&eight[5], bytes_to_word(at + 40, 8));
        store(&eight[6], bytes_to_word(at + 48, 8));
        store(&eight[7], bytes_to_word(at + 56, 8));
    }
    for (; i < whole; i++) store(&to[i], bytes_to_word(source + 8 * (size_t)i, 8));
    if (bytes % 8 != 0) store(&to[whole], bytes_to_word(source + 8 * (size_t)whole, bytes % 8));
}

/* Of private bytes, so that what is summed is what is handed over, whoever else writes. Four sums side
 * by side, as a multiplication takes longer than a load. */
static uint64_t checksum(const void *bytes_of, uint32_t bytes, uint64_t sum)
{
    const uint8_t *from = bytes_of;
    uint64_t a = sum, b = 1, c = 2, d = 3;
    for (; bytes >= 32; bytes -= 32, from += 32) {
        a = mix(a, bytes_to_word(from, 8));
        b = mix(b, bytes_to_word(from + 8, 8));
        c = mix(c, bytes_to_word(from + 16, 8));
        d = mix(d, bytes_to_word(from + 24, 8));
    }
    for (; bytes >= 8; bytes -= 8, from += 8) a = mix(a, bytes_to_word(from, 8));
    if (bytes > 0) a = mix(a, bytes_to_word(from, bytes));
    return mix(mix(mix(a, b), c), d);
}

/* Shared words to private bytes, relaxed. */
static void copy_out(void *to, const word *from, uint32_t bytes)
{
    uint8_t *target = to;
    const uint32_t whole = bytes / 8;
    for (uint32_t i = 0; i < whole; i++) {
        const uint64_t value = load(&from[i]);
        memcpy(target + 8 * (size_t)i, &value, 8);
    }
    if (bytes % 8 != 0) {
        const uint64_t value = load(&from[whole]);
        memcpy(target + 8 * (size_t)whole, &value, bytes % 8);
    }
}

/* ---- layout ---------------------------------------------------------------------------------- */

static const header_page *header(const void *base) { return base; }
static const host_page *host_of(const void *base)
{
    return (const void *)((const uint8_t *)base + SJ_SHM_HOST);
}
static const kernel_page *kernel_of(const void *base)
{
    return (const void *)((const uint8_t *)base + SJ_SHM_KERNEL);
}
static host_page *host(void *base) { return (void *)((uint8_t *)base + SJ_SHM_HOST); }
static kernel_page *kernel(void *base) { return (void *)((uint8_t *)base + SJ_SHM_KERNEL); }
static _Atomic uint32_t *command_word(void *base)
{
    return &((command_page *)(void *)((uint8_t *)base + SJ_SHM_COMMAND))->word;
}

static uint64_t stride(uint32_t bytes) { return (sizeof(stamp) + bytes + 63) / 64 * 64; }

static uint64_t pages(uint64_t bytes)
{
    return (bytes + SJ_SHM_PAGE - 1) / SJ_SHM_PAGE * SJ_SHM_PAGE;
}

static stamp *slot(void *base, uint64_t area, uint32_t bytes, uint64_t index)
{
    return (void *)((uint8_t *)base + area + index * stride(bytes));
}
static const stamp *slot_of(const void *base, uint64_t area, uint32_t bytes, uint64_t index)
{
    return (const void *)((const uint8_t *)base + area + index * stride(bytes));
}
static word *payload(stamp *at) { return (word *)(at + 1); }
static const word *payload_of(const stamp *at) { return (const word *)(at + 1); }

static int power_of_two(uint32_t value) { return value != 0 && (value & (value - 1)) == 0; }

static int config_valid(const sj_shm_config *c)
{
    return c->command_bytes > 0 && c->command_bytes <= MAX_BYTES &&
           c->feedback_bytes > 0 && c->feedback_bytes <= MAX_BYTES &&
           (c->record_capacity == 0 || (power_of_two(c->record_capacity) && c->record_capacity <= MAX_CAPACITY &&
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
    if (!config_valid(config)) return 0;
    header_fill(&page, config);
    return page.size;
}

int32_t sj_shm_format(void *base, uint64_t size, const sj_shm_config *config)
{
    header_page *page = base;
    if (!config_valid(config) || (uintptr_t)base % sizeof(word) != 0) return SJ_SHM_CONFIG;
    if (size < sj_shm_size(config)) return SJ_SHM_TRUNCATED;
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
    if (size < SJ_SHM_SLOTS) return SJ_SHM_TRUNCATED;
    const uint64_t ready = acquire(&page->ready);
    if (ready == 0) return SJ_SHM_NOT_READY;
    if (memcmp(page->magic, MAGIC, sizeof MAGIC) != 0) return SJ_SHM_MAGIC;
    if (page->major != SJ_SHM_MAJOR) return SJ_SHM_VERSION;
    if (ready != READY || !config_valid(&page->config)) return SJ_SHM_CORRUPT_HEADER;
    header_fill(&expected, &page->config);
    expected.minor = page->minor;
    if (page->size != expected.size || page->command != expected.command || page->feedback != expected.feedback ||
        page->ring != expected.ring || page->events != expected.events)
        return SJ_SHM_CORRUPT_HEADER;
    if (page->minor == SJ_SHM_MINOR && page->checksum != expected.checksum) return SJ_SHM_CORRUPT_HEADER;
    if (size < page->size) return SJ_SHM_TRUNCATED;
    if (config != NULL) {
        if (page->config.abi != config->abi) return SJ_SHM_ABI;
        if (memcmp(&page->config, config, sizeof *config) != 0) return SJ_SHM_CONFIG;
    }
    return SJ_SHM_OK;
}

int32_t sj_shm_read_config(const void *base, uint64_t size, sj_shm_config *config)
{
    const int32_t status = sj_shm_check(base, size, NULL);
    if (status == SJ_SHM_OK) *config = header(base)->config;
    return status;
}

uint32_t sj_shm_read_version(const void *base, uint64_t size)
{
    const header_page *page = base;
    return size < SJ_SHM_PAGE ? 0 : (page->major & 0xFFFFU) << 16 | (page->minor & 0xFFFFU);
}

/* ---- who lives ------------------------------------------------------------------------------- */

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
    if (header(base)->config.record_capacity != 0 && head - tail <= header(base)->config.record_capacity) {
        store(&k->discarded, load(&k->discarded) + (head - tail));
        release(&k->tail, head);
    }
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
uint64_t sj_shm_kernel_beat(const void *base) { return acquire(&kernel_of(base)->beat_ns); }

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
    if (epoch == 0 || acquire(&h->left) == epoch) return SJ_HOST_ABSENT;
    if (note == epoch << 1) return SJ_HOST_DEAD;
    if (timeout_ns != 0 && now_ns > beat_ns && now_ns - beat_ns > timeout_ns) return SJ_HOST_SILENT;
    return SJ_HOST_ALIVE;
}

/* ---- before a cycle -------------------------------------------------------------------------- */

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
    fetch(slot_of(base, page->feedback, page->config.feedback_bytes, index),
          sizeof(stamp) + page->config.feedback_bytes);
}

/* ---- command: three slots, one word ---------------------------------------------------------- */

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
    if (kernel_epoch != acquire(&kernel(base)->epoch)) return SJ_SHM_KERNEL_RESTARTED;

    uint32_t old = atomic_load_explicit(command_word(base), memory_order_acquire), new;
    if (!word_legal(old)) return SJ_SHM_CORRUPT_WORD;

    /* Only the host moves w, so slot w is ours until the exchange below. */
    const uint64_t number = load(&h->published) + 1, host_epoch = load(&h->epoch);
    stamp *at = slot(base, page->command, page->config.command_bytes, old & 3U);
    store(&h->published, number);
    store(&at->number, number);
    store(&at->host_epoch, host_epoch);
    store(&at->kernel_epoch, kernel_epoch);
    const uint64_t sum = mix(mix(mix(0, number), host_epoch), kernel_epoch);
    store(&at->checksum, checksum(command, page->config.command_bytes, sum));
    copy_in(payload(at), command, page->config.command_bytes);

    do {                                /* the kernel collects at most once between two of ours */
        if (!word_legal(old)) return SJ_SHM_CORRUPT_WORD;
        new = word_of(old >> 2 & 3U, old & 3U, old >> 4 & 3U, 1);
    } while (!atomic_compare_exchange_weak_explicit(command_word(base), &old, new, memory_order_acq_rel,
                                                    memory_order_acquire));
    return SJ_SHM_OK;
}

int32_t sj_command_collect(void *base, void *command)
{
    const header_page *page = header(base);
    kernel_page *k = kernel(base);
    uint32_t old = atomic_load_explicit(command_word(base), memory_order_acquire);
    for (int32_t tries = 0;; tries++) {
        if (!word_legal(old)) return SJ_SHM_CORRUPT_WORD;
        if (old >> 6 == 0 || tries == SJ_SHM_COLLECT_TRIES) return 0;
        const uint32_t new = word_of(old & 3U, old >> 4 & 3U, old >> 2 & 3U, 0);
        if (atomic_compare_exchange_weak_explicit(command_word(base), &old, new, memory_order_acq_rel,
                                                  memory_order_acquire)) {
            old = new;
            break;
        }
    }
    const stamp *at = slot(base, page->command, page->config.command_bytes, old >> 4 & 3U);
    const uint64_t number = load(&at->number), host_epoch = load(&at->host_epoch);
    const uint64_t kernel_epoch = load(&at->kernel_epoch);
    if (kernel_epoch < load(&k->epoch)) return 0;   /* meant for an earlier kernel */
    const uint64_t sum = mix(mix(mix(0, number), host_epoch), kernel_epoch);
    copy_out(command, payload_of(at), page->config.command_bytes);
    if (checksum(command, page->config.command_bytes, sum) != load(&at->checksum)) return SJ_SHM_CORRUPT_DATA;
    if (number <= load(&k->collected)) return SJ_SHM_CORRUPT_COUNTER;
    release(&k->collected, number);
    return 1;
}

uint64_t sj_command_published(const void *base) { return load(&host_of(base)->published); }
uint64_t sj_command_collected(const void *base) { return acquire(&kernel_of(base)->collected); }

/* ---- latched slots: what feedback and events share ------------------------------------------- */

/* Item n = *count + 1. A slot under the pen has number 0, so a reader cannot take it for whole; the
 * count moves last, so whoever dies in here leaves all that was published before in place. */
static void latch_publish(word *count, stamp *at, const void *item, uint32_t bytes)
{
    const uint64_t number = load(count) + 1;
    store(&at->number, 0);
    atomic_thread_fence(memory_order_release);  /* the 0 is seen before any of the payload */
    copy_in(payload(at), item, bytes);
    release(&at->number, number);
    release(count, number);
}

/* 1 if the slot held item `number` from the first word copied to the last. */
static int latch_copy(const stamp *at, uint64_t number, void *item, uint32_t bytes)
{
    if (acquire(&at->number) != number) return 0;
    copy_out(item, payload_of(at), bytes);
    atomic_thread_fence(memory_order_acquire);  /* pairs with the fence of the writer */
    return load(&at->number) == number;
}

/* ---- feedback -------------------------------------------------------------------------------- */

void sj_feedback_publish(void *base, const void *feedback)
{
    const header_page *page = header(base);
    word *count = &kernel(base)->feedback;
    const uint64_t index = (load(count) + 1) % SJ_SHM_FEEDBACK_SLOTS;
    latch_publish(count, slot(base, page->feedback, page->config.feedback_bytes, index), feedback,
                  page->config.feedback_bytes);
}

int32_t sj_feedback_read(const void *base, void *feedback, uint64_t *sequence)
{
    const header_page *page = header(base);
    for (int32_t tries = 0; tries < SJ_SHM_READ_TRIES; tries++) {
        const uint64_t number = acquire(&kernel_of(base)->feedback);
        if (number == 0) return 0;
        const stamp *at =
            slot_of(base, page->feedback, page->config.feedback_bytes, number % SJ_SHM_FEEDBACK_SLOTS);
        if (latch_copy(at, number, feedback, page->config.feedback_bytes)) {
            *sequence = number;
            return 1;
        }
    }
    return SJ_SHM_LAPPED;
}

uint64_t sj_feedback_latest(const void *base) { return acquire(&kernel_of(base)->feedback); }

/* ---- ring ------------------------------------------------------------------------------------ */

int32_t sj_ring_publish(void *base, const void *records, uint32_t count)
{
    const header_page *page = header(base);
    const uint32_t bytes = page->config.record_bytes, capacity = page->config.record_capacity;
    host_page *h = host(base);
    const uint64_t kernel_epoch = load(&h->addressed), host_epoch = load(&h->epoch);
    if (kernel_epoch != acquire(&kernel(base)->epoch)) return SJ_SHM_KERNEL_RESTARTED;
    const uint64_t head = load(&h->head), used = head - acquire(&kernel(base)->tail);
    if (used > capacity) return SJ_SHM_CORRUPT_COUNTER;
    if (count > capacity - used) return 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint64_t number = head + i + 1;
        stamp *at = slot(base, page->ring, bytes, (head + i) & (capacity - 1));
        store(&at->number, number);
        store(&at->host_epoch, host_epoch);
        store(&at->kernel_epoch, kernel_epoch);
        const uint64_t sum = mix(mix(mix(0, number), host_epoch), kernel_epoch);
        const uint8_t *record = (const uint8_t *)records + (size_t)i * bytes;
        store(&at->checksum, checksum(record, bytes, sum));
        copy_in(payload(at), record, bytes);
    }
    release(&h->head, head + count);    /* the whole batch, or none of it */
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
    if (head - tail > capacity || (flush > tail && flush - tail > head - tail)) return SJ_SHM_CORRUPT_COUNTER;
    if (flush > tail) {
        store(&k->discarded, load(&k->discarded) + (flush - tail));
        tail = flush;
        release(&k->tail, tail);
    }
    for (; tail != head; tail++) {      /* at most `capacity` rounds, and only after a restart */
        const stamp *at = slot_of(base, page->ring, bytes, tail & (capacity - 1));
        const uint64_t number = load(&at->number), host_epoch = load(&at->host_epoch);
        const uint64_t kernel_epoch = load(&at->kernel_epoch);
        if (kernel_epoch < epoch && number == tail + 1) {   /* meant for an earlier kernel */
            store(&k->discarded, load(&k->discarded) + 1);
            release(&k->tail, tail + 1);
            continue;
        }
        const uint64_t sum = mix(mix(mix(0, number), host_epoch), kernel_epoch);
        copy_out(record, payload_of(at), bytes);
        if (checksum(record, bytes, sum) != load(&at->checksum)) return SJ_SHM_CORRUPT_DATA;
        if (number != tail + 1) return SJ_SHM_CORRUPT_COUNTER;
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

/* ---- events ---------------------------------------------------------------------------------- */

void sj_event_publish(void *base, const void *event)
{
    const header_page *page = header(base);
    word *count = &kernel(base)->events;
    if (page->config.event_capacity == 0) return;
    const uint64_t index = (load(count) + 1) & (page->config.event_capacity - 1);
    latch_publish(count, slot(base, page->events, page->config.event_bytes, index), event,
                  page->config.event_bytes);
}

int32_t sj_event_read(const void *base, uint64_t *cursor, void *event, uint64_t *missed)
{
    const header_page *page = header(base);
    const uint64_t capacity = page->config.event_capacity;
    uint64_t number = *cursor + 1;
    for (uint64_t tries = 0; tries < SJ_SHM_READ_TRIES; tries++) {
        const uint64_t latest = acquire(&kernel_of(base)->events);
        if (number > latest) return *cursor > latest ? SJ_SHM_CORRUPT_COUNTER : 0;
        /* The slot of event latest + 1 - capacity may be under the pen; after each lap keep further away. */
        const uint64_t keep = capacity - 1 > tries ? capacity - 1 - tries : 1;
        if (latest - number >= keep) number = latest - keep + 1;
        const stamp *at = slot_of(base, page->events, page->config.event_bytes, number & (capacity - 1));
        if (latch_copy(at, number, event, page->config.event_bytes)) {
            *missed += number - *cursor - 1;
            *cursor = number;
            return 1;
        }
    }
    return SJ_SHM_LAPPED;
}

uint64_t sj_event_latest(const void *base) { return acquire(&kernel_of(base)->events); }
