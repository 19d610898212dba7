/* The feedback, kernel to many: a latch of SJ_SHM_FEEDBACK_SLOTS slots; the newest frame counts.
 *
 * Never here: a wait of the kernel; a reader that is overtaken looks again.
 */
#include "dpram/_pages.h" /* layout and atomics */

void sj_feedback_publish(void *base, const void *feedback)
{
    const header_page *page = header(base);
    word *count = &kernel(base)->feedback;
    const uint64_t index = (load(count) + 1) % SJ_SHM_FEEDBACK_SLOTS;
    sj_latch_publish(count, slot(base, page->feedback, page->config.feedback_bytes, index),
                     feedback, page->config.feedback_bytes);
}

int32_t sj_feedback_read(const void *base, void *feedback, uint64_t *sequence)
{
    const header_page *page = header(base);
    for (int32_t tries = 0; tries < SJ_SHM_READ_TRIES; tries++) {
        const uint64_t number = acquire(&kernel_of(base)->feedback);
        if (number == 0)
            return 0;
        const stamp *at = slot_of(base, page->feedback, page->config.feedback_bytes,
                                  number % SJ_SHM_FEEDBACK_SLOTS);
        if (sj_latch_copy(at, number, feedback, page->config.feedback_bytes)) {
            *sequence = number;
            return 1;
        }
    }
    return SJ_SHM_LAPPED;
}

uint64_t sj_feedback_latest(const void *base) { return acquire(&kernel_of(base)->feedback); }
