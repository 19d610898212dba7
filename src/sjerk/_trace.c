/* The trace: everything a cycle takes from outside comes through here, and is told with its cycle.
 *
 * In a replay it is given back from a recording instead. Publishing is wait-free, its work bounded by
 * the size of an item. Never here: decisions about motion, time, memory of its own.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of payloads */
#include "_kernel.h"
#include "_cycle.h"

_Static_assert(sizeof(sj_trace_head) == 16 && sizeof(sj_axis_trace) == 128, "no hidden padding");
_Static_assert(offsetof(sj_trace_frame, axis) == 64, "no hidden padding");
_Static_assert(offsetof(sj_trace_message, command) == 16, "no hidden padding");

uint64_t sj_trace_frame_bytes(int32_t axes)
{
    return offsetof(sj_trace_frame, axis) + (uint64_t)axes * sizeof(sj_axis_trace);
}

static uint64_t message_bytes(int32_t axes)
{
    return offsetof(sj_trace_message, command) + sj_command_bytes(axes);
}

uint64_t sj_trace_item_bytes(int32_t axes)
{
    uint64_t frame = sj_trace_frame_bytes(axes), message = message_bytes(axes);
    return frame > message ? frame : message;
}

static sj_trace_head head_of(const sj_kernel *kernel, int32_t kind)
{
    return (sj_trace_head){kernel->feedback.cycle + 1, kind, 0};
}

static void tell(sj_kernel *kernel, int32_t kind, const void *payload, uint64_t bytes)
{
    if (kernel->trace == NULL)
        return;
    kernel->item.message.head = head_of(kernel, kind);
    memcpy(&kernel->item.message.command, payload, bytes);
    sj_event_publish(kernel->trace, &kernel->item);
}

/* ---- what is taken ---- */

int32_t sj_trace_host(sj_kernel *kernel, uint64_t now_ns)
{
    if (kernel->given.frame != NULL)
        return kernel->given.frame->host_state;
    return sj_shm_host_state(kernel->segment, now_ns);
}

static int32_t given_command(sj_kernel *kernel)
{
    sj_trace_given *given = &kernel->given;
    if (given->frame->collected == 1) {
        if (given->count <= 0)
            return 0; /* a command is missing: the frame will differ */
        memcpy(&kernel->incoming, given->messages, sj_command_bytes(kernel->axes));
        given->messages += given->message_bytes;
        given->count--;
    }
    return given->frame->collected;
}

int32_t sj_trace_collect(sj_kernel *kernel)
{
    int32_t status = kernel->given.frame != NULL
                         ? given_command(kernel)
                         : sj_command_collect(kernel->segment, &kernel->incoming);
    kernel->collected = status;
    if (status == 1)
        tell(kernel, SJ_TRACE_COMMAND, &kernel->incoming, sj_command_bytes(kernel->axes));
    return status;
}

/* ---- what is given ---- */

void sj_trace_event(sj_kernel *kernel, const sj_kernel_event *event)
{
    sj_event_publish(kernel->segment, event);
    tell(kernel, SJ_TRACE_EVENT, event, sizeof *event);
}

static uint32_t flags_of(const sj_axis *ax)
{
    int32_t moving = ax->homing || (ax->following && (axis_moving(ax) || ax->parked));
    return (moving ? SJ_TRACE_MOVING : 0U) | (ax->reached ? SJ_TRACE_SETTLED : 0U) |
           (ax->following ? SJ_TRACE_FOLLOWS : 0U) | (ax->parked ? SJ_TRACE_PARKED : 0U) |
           (ax->drive_stop ? SJ_TRACE_DRIVE_STOP : 0U);
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
    out->flags = flags_of(ax);
    out->reserved = 0;
}

/* After the cycle has been counted. */
void sj_trace_close(sj_kernel *kernel)
{
    sj_trace_frame *frame = kernel->frame_out != NULL ? kernel->frame_out : &kernel->item.frame;
    if (kernel->trace == NULL && kernel->frame_out == NULL)
        return;
    frame->head = (sj_trace_head){kernel->feedback.cycle, SJ_TRACE_FRAME, 0};
    frame->time_ns = kernel->feedback.time_ns;
    frame->late = kernel->feedback.late;
    frame->host_state = kernel->host_state;
    frame->ending = kernel->ending;
    frame->collected = kernel->collected;
    frame->hold = kernel->hold;
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
        int32_t status = sj_event_read(segment, cursor, (uint8_t *)items + (uint64_t)n * bytes, missed);
        if (status == 0)
            break;
        if (status < 0)
            return n > 0 ? n : status;
    }
    return n;
}
