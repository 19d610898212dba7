/* The dual-port RAM in shared memory. */
#pragma once
#include <stdint.h>

/* What the payloads are is the business of the wiring; here they are bytes. */
typedef struct {
    uint32_t command_bytes;   /* one command for all axes, > 0 */
    uint32_t feedback_bytes;  /* one feedback frame, > 0 */
    uint32_t record_bytes;    /* one look-ahead record for all axes */
    uint32_t record_capacity; /* records in the ring: a power of two, or 0 for no ring */
    uint32_t event_bytes;     /* one event */
    uint32_t event_capacity;  /* events kept: a power of two >= 4, or 0 for no events */
    uint64_t abi;             /* hash of the payload layouts, given by the caller */
} sj_shm_config;

enum { SJ_SHM_MAJOR = 2, SJ_SHM_MINOR = 0, SJ_SHM_PAGE = 4096 };

enum sj_shm_status {
    SJ_SHM_OK = 0,
    SJ_SHM_NOT_READY = -1, /* still being created, or its creator died at it */
    SJ_SHM_TRUNCATED = -2, /* shorter than its header says */
    SJ_SHM_MAGIC = -3,     /* not a segment of sjerk */
    SJ_SHM_VERSION = -4,   /* another major version of the layout */
    SJ_SHM_ABI = -5,       /* other payload layouts */
    SJ_SHM_CONFIG = -6,    /* sizes out of range, or not those of the header */
    SJ_SHM_CORRUPT_HEADER = -7,
    SJ_SHM_CORRUPT_WORD = -8,     /* the command word is none of its twelve values */
    SJ_SHM_CORRUPT_DATA = -9,     /* a checksum fails: a second writer, or a wild one */
    SJ_SHM_CORRUPT_COUNTER = -10, /* a counter ran backwards or out of its ring */
    SJ_SHM_LAPPED = -11,          /* the reader was overtaken too often; ask again */
    SJ_SHM_KERNEL_RESTARTED = -12 /* the addressed kernel is gone; see sj_shm_address */
};

enum sj_shm_host_state {
    SJ_HOST_ABSENT = 0, /* none yet, or the last one left in order */
    SJ_HOST_ALIVE = 1,
    SJ_HOST_SILENT = 2, /* asked to be watched and let its time pass */
    SJ_HOST_DEAD = 3    /* lost its lock without leaving */
};

/* Where the single words lie, for tests and debuggers; the slots follow page by page. */
enum sj_shm_offset {
    SJ_SHM_HEADER = 0,     /* written once */
    SJ_SHM_HOST = 4096,    /* written by the host */
    SJ_SHM_COMMAND = 8192, /* the one word that both sides write */
    SJ_SHM_KERNEL = 12288, /* written by the kernel */
    SJ_SHM_STOPS = 16384,  /* requests of any process */
    SJ_SHM_SLOTS = 20480   /* command, feedback, ring, events; each on its own pages */
};

enum {
    SJ_SHM_FEEDBACK_SLOTS = 8,
    SJ_SHM_COLLECT_TRIES = 4,
    SJ_SHM_READ_TRIES = 64,
    SJ_STOP_SLOTS = 33
}; /* the last one is shared by all who find no other */

/* What one process asks to be stopped: bit n is axis n. */
typedef struct {
    uint64_t halts, quick_stops;
    uint64_t pid; /* 0: not known, one of those that share the last slot */
} sj_stop;

/* The segment. */
uint64_t sj_shm_size(const sj_shm_config *config); /* bytes; 0 if the config is out of range */
int32_t sj_shm_format(void *base, uint64_t size, const sj_shm_config *config);
int32_t sj_shm_check(const void *base, uint64_t size,
                     const sj_shm_config *config); /* config may be NULL */
int32_t sj_shm_read_config(const void *base, uint64_t size, sj_shm_config *config);
uint32_t sj_shm_read_version(const void *base, uint64_t size); /* major << 16 | minor, as found */

/* Who lives: epochs, heartbeats, orderly leave. Time is an argument; any monotonic nanoseconds. */
uint64_t sj_shm_begin_kernel(void *base, uint64_t now_ns); /* the new kernel epoch, >= 1 */
uint64_t sj_shm_begin_host(void *base, uint64_t pid,
                           uint64_t now_ns); /* the new host epoch, >= 1 */
void sj_shm_leave_host(void *base); /* an orderly end, so that it is not taken for a death */
void sj_shm_leave_kernel(void *base);
int32_t sj_shm_kernel_left(const void *base); /* 1: the last kernel ended in order */
uint64_t sj_shm_kernel_epoch(const void *base);
uint64_t sj_shm_host_epoch(const void *base);
uint64_t sj_shm_host_pid(const void *base);
uint64_t sj_shm_address(void *base); /* host: from now on speak to the present kernel; its epoch */
void sj_shm_watch_host(void *base, uint64_t timeout_ns,
                       uint64_t now_ns); /* host: watch me; 0: do not */
void sj_shm_beat_host(void *base, uint64_t now_ns);
uint64_t sj_shm_host_beat(const void *base);
void sj_shm_note_host(void *base, uint64_t host_epoch,
                      int32_t lock_held); /* kernel side, outside the cycle */
int32_t sj_shm_host_state(const void *base,
                          uint64_t now_ns); /* in the cycle: enum sj_shm_host_state */

/* Command: host to kernel, latest value. Publish: 0 or < 0. Collect: 1 fresh, 0 none, < 0 corrupt
 * (what `command` points to is then undefined). Neither waits; collect is wait-free. */
int32_t sj_command_publish(void *base, const void *command);
int32_t sj_command_collect(void *base, void *command);
uint64_t sj_command_published(const void *base); /* commands begun since creation */
uint64_t sj_command_collected(const void *base); /* number of the newest command the kernel took */

/* Stop requests: any process to the kernel, at once, beside the host. Claim, under the lock of the slot: 1,
 * or 0 while a request of the slot's last process waits to be taken. Take, in the cycle: 1 a stop, 0 none. */
int32_t sj_stop_claim(void *base, uint32_t index, uint64_t pid);
void sj_stop_request(void *base, uint32_t index, uint64_t halts, uint64_t quick_stops);
int32_t sj_stop_waits(const void *base, uint32_t index); /* 1: not taken yet */
int32_t sj_stop_take(void *base, uint32_t index, sj_stop *stop);

/* Feedback: kernel to many, latest value. Read: 1 a frame and its number, 0 nothing published yet. */
void sj_feedback_publish(void *base, const void *feedback);
int32_t sj_feedback_read(const void *base, void *feedback, uint64_t *sequence);
uint64_t sj_feedback_latest(const void *base); /* number of the newest frame; cheap to poll */

/* Ring: host to kernel, every record once and in order. Publish: 1 all of them, 0 no room for all,
 * < 0. Take: 1 a record, 0 empty, < 0 corrupt (and stays so until flushed). */
int32_t sj_ring_publish(void *base, const void *records, uint32_t count);
int32_t sj_ring_take(void *base, void *record);
void sj_ring_flush(void *base); /* host: discard what was published before this call */
uint64_t sj_ring_published(const void *base); /* records published since creation */
uint64_t sj_ring_taken(const void *base);     /* records taken or discarded since creation */
uint64_t sj_ring_discarded(const void *base); /* of these, flushed or meant for an earlier kernel */
uint32_t sj_ring_waiting(const void *base);   /* records the kernel can still take */

/* Events: kernel to many, the newest overwrite the oldest. Read: 1 the event after *cursor, 0 none;
 * *missed grows by exactly the events that were overwritten unread. Start with *cursor = 0 or latest. */
void sj_event_publish(void *base, const void *event);
int32_t sj_event_read(const void *base, uint64_t *cursor, void *event, uint64_t *missed);
uint64_t sj_event_latest(const void *base);

/* For C only. */

uint64_t sj_shm_host_left(const void *base); /* the last host epoch that ended in order */
uint64_t sj_shm_addressed(const void *base);
void sj_stop_clear(void *base); /* a new kernel: what was asked of the one before */
void sj_shm_beat_kernel(void *base, uint64_t now_ns);
/* Kernel side, just before a cycle: what its exchanges touch, into the caches. */
void sj_shm_warm(const void *base);
