/* Payloads into slots and out of them: copies by atomic words, checksums, the latch.
 *
 * Payloads are copied as relaxed atomic words, because a plain copy next to a writer is a data race by
 * definition, whatever a later check says. A checksum covers the stamp's words and the payload; it
 * is taken of private bytes, so that what is summed is what is handed over.
 * Never here: which slot, which number.
 */
#include <string.h>       /* memcpy of private words */
#include "dpram/_pages.h" /* layout and atomics */

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
    for (; i < whole; i++)
        store(&to[i], bytes_to_word(source + 8 * (size_t)i, 8));
    if (bytes % 8 != 0)
        store(&to[whole], bytes_to_word(source + 8 * (size_t)whole, bytes % 8));
}

/* Of private bytes, so that what is summed is what is handed over, even if another one writes. Four sums side
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
    for (; bytes >= 8; bytes -= 8, from += 8)
        a = mix(a, bytes_to_word(from, 8));
    if (bytes > 0)
        a = mix(a, bytes_to_word(from, bytes));
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

static uint64_t stamp_sum(uint64_t number, uint64_t host_epoch, uint64_t kernel_epoch)
{
    return mix(mix(mix(0, number), host_epoch), kernel_epoch);
}

void sj_slot_fill(stamp *at, uint64_t number, uint64_t host_epoch, uint64_t kernel_epoch,
                  const void *item, uint32_t bytes)
{
    store(&at->number, number);
    store(&at->host_epoch, host_epoch);
    store(&at->kernel_epoch, kernel_epoch);
    store(&at->checksum, checksum(item, bytes, stamp_sum(number, host_epoch, kernel_epoch)));
    copy_in(payload(at), item, bytes);
}

int sj_slot_copy(const stamp *at, uint64_t number, uint64_t host_epoch, uint64_t kernel_epoch,
                 void *item, uint32_t bytes)
{
    copy_out(item, payload_of(at), bytes);
    return checksum(item, bytes, stamp_sum(number, host_epoch, kernel_epoch)) ==
           load(&at->checksum);
}

/* Item n = *count + 1. A slot under the pen has number 0, so a reader cannot take it for whole; the
 * count moves last, so a writer that dies in here leaves in place all that was published before. */
void sj_latch_publish(word *count, stamp *at, const void *item, uint32_t bytes)
{
    const uint64_t number = load(count) + 1;
    store(&at->number, 0);
    atomic_thread_fence(memory_order_release); /* the 0 is seen before any of the payload */
    copy_in(payload(at), item, bytes);
    release(&at->number, number);
    release(count, number);
}

/* 1 if the slot held item `number` from the first word copied to the last. */
int sj_latch_copy(const stamp *at, uint64_t number, void *item, uint32_t bytes)
{
    if (acquire(&at->number) != number)
        return 0;
    copy_out(item, payload_of(at), bytes);
    atomic_thread_fence(memory_order_acquire); /* pairs with the fence of the writer */
    return load(&at->number) == number;
}
