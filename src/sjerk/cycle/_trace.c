/* The trace: each cycle's items in the order of the cycle, closed by its frame; and reading them.
 *
 * Publishing is wait-free, its work bounded by the size of an item. Never here: what an item means to
 * the motion (_inputs.c takes, _events.c reports), time, memory of its own.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of payloads */
#include "cycle/_motion.h"
#include "cycle/_trace.h"
#include "dpram/_dpram.h"

void sj_trace_put(sj_kernel *kernel, int32_t kind, uint64_t number, const void *payload,
                  uint64_t bytes)
{
    if (kernel->trace == NULL)
        return;
    kernel->item.message.head = (sj_trace_head){kernel->feedback.cycle + 1, number, kind, 0};
    memcpy(kernel->item.message.payload, payload, bytes);
    sj_event_publish(kernel->trace, &kernel->item);
}

static uint32_t flags_of(const sj_axis *ax, int32_t path, int32_t feed_hold, int32_t stale)
{
    int32_t moving = ax->homing || ax->homed || (ax->following && (axis_moving(ax) || ax->held));
    return (moving ? SJ_TRACE_MOVING : 0U) | (ax->reached ? SJ_TRACE_SETTLED : 0U) |
           (ax->following ? SJ_TRACE_FOLLOWS : 0U) | (ax->held ? SJ_TRACE_HELD : 0U) |
           (ax->drive_stop ? SJ_TRACE_DRIVE_STOP : 0U) | (path ? SJ_TRACE_PATH : 0U) |
           (stale ? SJ_TRACE_STALE : 0U) | (feed_hold ? SJ_TRACE_FEED_HOLD : 0U);
}

static void write_axis(const sj_kernel *kernel, int32_t i, sj_axis_trace *out)
{
    const sj_axis *ax = &kernel->axis[i];
    const sj_interpolator *ip = &ax->interpolator;
    const sj_drive_tx *tx = &kernel->tx[i];
    out->position = ip->q.hi;
    out->velocity = ip->v.hi;
    out->acceleration = ip->a.hi;
    out->jerk = ip->j.hi;
    out->goal = kernel->feedback.axis[i].goal;
    out->limits = ax->config.limits;
    out->goal_id = ax->goal_id;
    out->target_counts = ax->target_counts;
    out->actual_counts = ax->actual_counts;
    out->velocity_actual = tx->velocity_actual;
    out->following_error = tx->following_error;
    out->statusword = tx->statusword;
    out->error_code = tx->error_code;
    out->torque_actual = tx->torque_actual;
    out->mode_display = tx->mode_display;
    out->state = (uint8_t)ax->state;
    out->flags = flags_of(ax, (int32_t)(kernel->path.axes >> i & 1),
                          (int32_t)(kernel->feedback.feed_hold >> i & 1), kernel->stale[i]);
    out->digital_inputs = tx->digital_inputs;
    out->velocity_offset = kernel->rx[i].velocity_offset;
    out->torque_offset = kernel->rx[i].torque_offset;
    out->reserved = 0;
}

void sj_trace_close(sj_kernel *kernel)
{
    sj_trace_frame *frame = kernel->frame_out != NULL ? kernel->frame_out : &kernel->item.frame;
    if (kernel->trace == NULL && kernel->frame_out == NULL)
        return;
    frame->head = (sj_trace_head){kernel->feedback.cycle, 0, SJ_TRACE_FRAME, 0};
    frame->time_ns = kernel->feedback.time_ns;
    frame->late = kernel->feedback.late;
    frame->ring_seen = kernel->ring_seen;
    frame->ring_published = kernel->ring_published;
    frame->ring_taken = kernel->ring_taken;
    frame->ring_status = kernel->ring_status;
    frame->host_state = kernel->host_state;
    frame->ending = kernel->ending;
    frame->collected = kernel->collected;
    frame->hold = kernel->hold;
    frame->reserved = 0;
    frame->override = kernel->override;
    frame->sequence = kernel->feedback.sequence;
    for (int32_t i = 0; i < kernel->axes; i++)
        write_axis(kernel, i, &frame->axis[i]);
    if (kernel->frame_out == NULL)
        sj_event_publish(kernel->trace, frame);
}

int64_t sj_trace_drain(const void *segment, uint64_t *cursor, uint64_t *missed, int64_t room,
                       void *items)
{
    uint64_t bytes, before = *missed;
    sj_shm_config config;
    int64_t n = 0;
    if (sj_shm_read_config(segment, UINT64_MAX, &config) != SJ_SHM_OK)
        return 0;
    for (bytes = config.event_bytes; n < room && *missed == before; n++) {
        int32_t status =
            sj_event_read(segment, cursor, (uint8_t *)items + (uint64_t)n * bytes, missed);
        if (status == 0)
            break;
        if (status < 0)
            return n > 0 ? n : status;
    }
    return n;
}
