/* The dual-port RAM: one memory segment between a host and a motion kernel, two programs that may die at
 * any moment, at any line. Here is its layout, byte by byte, and the atomic words it is made of.
 *
 * Five exchanges lie in it, each for one need: the command (the newest one counts, _command.c), the
 * ring (every record counts, in order, _ring.c), stop requests (of any process, _stops.c), the feedback
 * (the newest frame, for any reader, _feedback.c), the events (a slow reader loses the oldest and
 * knows how many, _events.c). _lives.c holds who is there, _segment.c makes the memory and checks it,
 * _slots.c moves payloads.
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
 *               | stop requests       |  a slot for each process that stops, written by it and the kernel
 *   20480       +---------------------+
 *               | command slots 0 1 2 |  written by the host, in slot w only
 *               +---------------------+
 *               | feedback slots 0..7 |  written by the kernel, frame n in slot n mod 8
 *               +---------------------+
 *               | ring records        |  written by the host, record n in slot n mod capacity
 *               +---------------------+
 *               | event slots         |  written by the kernel, event n in slot n mod capacity
 *               +---------------------+
 *
 * Three rules make it hold. Pages have one owner, so that no cache line is written by two sides, except
 * the command word and the stop requests. A slot is a stamp of 64 bytes and the payload, together a multiple of 64; a reader
 * compares the stamp, so nothing torn is taken for whole. And counters that must survive
 * the death of their writer live in the segment, not in the writer: a restarted side goes on where
 * its predecessor published last, and overwrites what that one left half-written.
 * docs/explanation/handshake.md says what holds at a kill after each store.
 *
 * Payloads are bytes. Never here, nor in any file of this room: what a payload means, a clock, a lock, a
 * system call, an allocation. Every function works as well on plain private memory.
 */
#pragma once
#include <stdatomic.h>    /* its only use next to the end flag of _clock.c */
#include <stddef.h>       /* offsetof */
#include <stdint.h>       /* fixed widths */
#include "dpram/_dpram.h" /* the contract */

typedef _Atomic uint64_t word; /* shared memory is touched in whole words only */

typedef struct {
    uint8_t magic[8];
    uint32_t major, minor;
    sj_shm_config config;
    uint64_t size, command, feedback, ring, events; /* bytes in all; where the slots begin */
    uint64_t checksum;                              /* of everything above */
    word ready;                                     /* READY, stored last */
} header_page;

typedef struct {
    word epoch;      /* hosts so far */
    word pid;        /* of the present host, for messages only */
    word left;       /* the last epoch that ended in order */
    word addressed;  /* the kernel epoch that this host speaks to */
    word timeout_ns; /* 0: a silent host is normal */
    uint8_t pad0[88];
    word beat_ns;
    uint8_t pad1[120];
    word published; /* commands begun */
    uint8_t pad2[120];
    word head;  /* ring records published */
    word flush; /* records before this number are to be discarded */
} host_page;

typedef struct {
    _Atomic uint32_t word;
} command_page;

typedef struct {
    word epoch;     /* kernels so far */
    word left;      /* the last epoch that ended in order */
    word host_note; /* host epoch << 1 | its lock is held, as last looked at */
    uint8_t pad0[104];
    word beat_ns;
    uint8_t pad1[120];
    word collected; /* number of the newest command taken */
    uint8_t pad2[120];
    word tail; /* ring records taken or discarded */
    word discarded;
    uint8_t pad3[112];
    word feedback; /* frames published */
    uint8_t pad4[120];
    word events; /* events published */
} kernel_page;

/* A cache line each. The page has other writers than the kernel's, but only while they stop it. */
typedef struct {
    word halts, quick_stops; /* bit n: axis n; the kernel takes them out */
    word pid;                /* of the process that has the slot, for messages only */
    uint8_t pad[40];
} stop_slot;

/* The stamp of a slot. The checksum covers the other four words and the payload. */
typedef struct {
    word number;                   /* 1, 2, ...; 0 while a latch slot is being written */
    word host_epoch, kernel_epoch; /* by whom and for whom */
    word checksum;
    uint8_t pad[32];
} stamp;

_Static_assert(ATOMIC_LLONG_LOCK_FREE == 2 && ATOMIC_INT_LOCK_FREE == 2,
               "atomics with a hidden lock would not work between processes");
_Static_assert(sizeof(word) == 8 && sizeof(_Atomic uint32_t) == 4, "atomics are plain words");
_Static_assert(sizeof(sj_shm_config) == 32 && offsetof(sj_shm_config, abi) == 24,
               "no hidden padding");
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
_Static_assert(sizeof(stop_slot) == 64 && SJ_STOP_SLOTS * sizeof(stop_slot) <= SJ_SHM_PAGE,
               "stops");
_Static_assert(sizeof(stamp) == 64 && offsetof(stamp, checksum) == 24, "stamp");
_Static_assert(sizeof(header_page) <= SJ_SHM_PAGE && sizeof(host_page) <= SJ_SHM_PAGE &&
                   sizeof(kernel_page) <= SJ_SHM_PAGE,
               "one page each");

/* ---- words ----------------------------------------------------------------------------------- */

static inline uint64_t load(const word *from)
{
    return atomic_load_explicit(from, memory_order_relaxed);
}
static inline uint64_t acquire(const word *from)
{
    return atomic_load_explicit(from, memory_order_acquire);
}
static inline void store(word *to, uint64_t value)
{
    atomic_store_explicit(to, value, memory_order_relaxed);
}
static inline void release(word *to, uint64_t value)
{
    atomic_store_explicit(to, value, memory_order_release);
}

/* ---- where things lie ------------------------------------------------------------------------ */

static inline const header_page *header(const void *base) { return base; }
static inline const host_page *host_of(const void *base)
{
    return (const void *)((const uint8_t *)base + SJ_SHM_HOST);
}
static inline const kernel_page *kernel_of(const void *base)
{
    return (const void *)((const uint8_t *)base + SJ_SHM_KERNEL);
}
static inline host_page *host(void *base) { return (void *)((uint8_t *)base + SJ_SHM_HOST); }
static inline kernel_page *kernel(void *base) { return (void *)((uint8_t *)base + SJ_SHM_KERNEL); }
static inline _Atomic uint32_t *command_word(void *base)
{
    return &((command_page *)(void *)((uint8_t *)base + SJ_SHM_COMMAND))->word;
}

static inline uint64_t stride(uint32_t bytes) { return (sizeof(stamp) + bytes + 63) / 64 * 64; }

static inline stamp *slot(void *base, uint64_t area, uint32_t bytes, uint64_t index)
{
    return (void *)((uint8_t *)base + area + index * stride(bytes));
}
static inline const stamp *slot_of(const void *base, uint64_t area, uint32_t bytes, uint64_t index)
{
    return (const void *)((const uint8_t *)base + area + index * stride(bytes));
}
static inline word *payload(stamp *at) { return (word *)(at + 1); }
static inline const word *payload_of(const stamp *at) { return (const word *)(at + 1); }

/* ---- _slots.c -------------------------------------------------------------------------------- */

/* The next value of a checksum: each step is a bijection of `sum`, so a single wrong word can never go unnoticed. */
static inline uint64_t mix(uint64_t sum, uint64_t value)
{
    sum = (sum ^ value) * 0x9E3779B97F4A7C15ULL;
    return sum ^ (sum >> 32);
}

/* A slot that is written while nobody looks there: command and ring. */
void sj_slot_fill(stamp *at, uint64_t number, uint64_t host_epoch, uint64_t kernel_epoch,
                  const void *item, uint32_t bytes);
/* 1 if the checksum fits what has been copied. */
int sj_slot_copy(const stamp *at, uint64_t number, uint64_t host_epoch, uint64_t kernel_epoch,
                 void *item, uint32_t bytes);

/* A slot that may be read while it is written: feedback and events. */
void sj_latch_publish(word *count, stamp *at, const void *item, uint32_t bytes);
int sj_latch_copy(const stamp *at, uint64_t number, void *item, uint32_t bytes);
