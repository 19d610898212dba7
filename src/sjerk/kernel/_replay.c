/* Virtual time: the same cycle as in a process, by a script or from a recording, without a clock.
 *
 * Never here: anything that a cycle decides.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcmp of frames */
#include "cycle/_cycle.h"
#include "cycle/_trace_items.h"
#include "kernel/_clock.h"

/* ---- by a script ---- */

/* One cycle into `frame`, or into nothing; loud: the feedback is published as well. */
static void cycle_into(sj_kernel *kernel, uint64_t now_ns, void *frame, int32_t loud)
{
    kernel->frame_out = frame;
    kernel->quiet = !loud;
    sj_kernel_cycle(kernel, now_ns);
    kernel->frame_out = NULL;
    kernel->quiet = 0;
}

void sj_virtual_run(sj_kernel *kernel, int64_t cycles, uint64_t now_ns, uint64_t period_ns,
                    void *frames)
{
    const uint64_t bytes = sj_trace_frame_bytes(kernel->axes);
    uint8_t *at = frames;
    for (int64_t i = 0; i < cycles; i++, now_ns += period_ns) {
        cycle_into(kernel, now_ns, at, i == cycles - 1);
        if (at != NULL)
            at += bytes;
    }
}

/* ---- from a recording ---- */

/* What the drives outside the kernel said, as far as a cycle looks at it. */
static void give_image(sj_kernel *kernel, const sj_trace_frame *frame)
{
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis_trace *axis = &frame->axis[i];
        sj_drive_tx *tx = &kernel->tx[i];
        if (!kernel->axis[i].config.external)
            continue;
        tx->statusword = axis->statusword;
        tx->mode_display = axis->mode_display;
        tx->error_code = axis->error_code;
        tx->position_actual = (int32_t)(uint32_t)(uint64_t)axis->actual_counts; /* it wraps */
        tx->velocity_actual = axis->velocity_actual;
        tx->following_error = axis->following_error;
        tx->torque_actual = axis->torque_actual;
        tx->digital_inputs = axis->digital_inputs;
        kernel->stale[i] = (axis->flags & SJ_TRACE_STALE) != 0;
    }
}

int64_t sj_virtual_replay(sj_kernel *kernel, int64_t cycles, const void *frames,
                          int64_t command_count, const void *commands, int64_t record_count,
                          const void *records, int64_t stop_count, const void *stops)
{
    const uint64_t bytes = sj_trace_frame_bytes(kernel->axes);
    const uint8_t *at = frames;
    int64_t i = 0;

    kernel->given = (sj_trace_given){
        NULL, {commands, command_count}, {records, record_count}, {stops, stop_count}};
    for (; i < cycles; i++, at += bytes) {
        const sj_trace_frame *frame = (const void *)at;
        kernel->given.frame = frame;
        kernel->feedback.late = frame->late;
        kernel->ending = frame->ending;
        give_image(kernel, frame);
        cycle_into(kernel, frame->time_ns, &kernel->item.frame, 0);
        if (memcmp(&kernel->item.frame, frame, bytes) != 0)
            break;
    }
    kernel->given = (sj_trace_given){0};
    return i;
}
