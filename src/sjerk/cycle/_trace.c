/* The trace: everything a cycle takes from outside comes through here, and is told with its cycle.
 *
 * In a replay it is given back from a recording instead. Publishing is wait-free, its work bounded by
 * the size of an item. Never here: decisions about motion, time, memory of its own.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of payloads */
#include "_cycle.h"

_Static_assert(sizeof(sj_trace_head) == 24 && sizeof(sj_axis_trace) == 128, "no hidden padding");
_Static_assert(offsetof(sj_trace_frame, axis) == 104, "no hidden padding");
_Static_assert(sizeof(sj_command) <= sizeof(((sj_trace_message *)0)->payload) &&
               sizeof(sj_record) <= sizeof(((sj_trace_message *)0)->payload), "room for each");

enum { ROW_HEAD = 16 }; /* bytes before the payload of a row */

uint64_t sj_trace_frame_bytes(int32_t axes)
{
    return offsetof(sj_trace_frame, axis) + (uint64_t)axes * sizeof(sj_axis_trace);
}

uint64_t sj_trace_item_bytes(int32_t axes)
{
    uint64_t command = sj_command_bytes(axes), record = sj_record_bytes(axes);
    uint64_t message = sizeof(sj_trace_head) + (command > record ? command : record);
    uint64_t frame = sj_trace_frame_bytes(axes);
    return frame > message ? frame : message;
}

static sj_trace_head head_of(const sj_kernel *kernel, int32_t kind, uint64_t number)
{
    return (sj_trace_head){kernel->feedback.cycle + 1, number, kind, 0};
}

static void tell(sj_kernel *kernel, int32_t kind, uint64_t number, const void *payload,
                 uint64_t bytes)
{
    if (kernel->trace == NULL)
        return;
    kernel->item.message.head = head_of(kernel, kind, number);
    memcpy(kernel->item.message.payload, payload, bytes);
    sj_event_publish(kernel->trace, &kernel->item);
}

/* ---- what is taken ---- */

/* The next row if it is of this cycle; then it is used up. */
static const uint8_t *given_row(const sj_kernel *kernel, sj_trace_rows *rows, uint64_t bytes,
                                uint64_t *number)
{
    const uint8_t *row = rows->at;
    uint64_t cycle;
    if (rows->count <= 0)
        return NULL;
    memcpy(&cycle, row, sizeof cycle);
    memcpy(number, row + sizeof cycle, sizeof *number);
    if (cycle != kernel->given.frame->head.cycle)
        return NULL;
    rows->at += ROW_HEAD + bytes;
    rows->count--;
    return row + ROW_HEAD;
}

int32_t sj_trace_host(sj_kernel *kernel, uint64_t now_ns)
{
    uint64_t before = kernel->host_epoch;
    if (kernel->given.frame != NULL)
        return kernel->given.frame->host_state;
    kernel->host_epoch = sj_shm_host_epoch(kernel->segment);
    if (kernel->host_epoch != before && sj_shm_host_left(kernel->segment) < before &&
        kernel->host_state != SJ_HOST_DEAD)
        return SJ_HOST_DEAD; /* its successor waited for its lock and was faster than the watch */
    return sj_shm_host_state(kernel->segment, now_ns);
}

void sj_trace_see(sj_kernel *kernel)
{
    const sj_trace_frame *given = kernel->given.frame;
    kernel->ring_seen = given != NULL ? given->ring_seen : sj_ring_published(kernel->segment);
    kernel->ring_published = kernel->ring_seen;
    kernel->ring_status = 0;
}

int32_t sj_trace_collect(sj_kernel *kernel)
{
    const uint64_t bytes = sj_command_bytes(kernel->axes);
    const sj_trace_frame *given = kernel->given.frame;
    uint64_t number = 0;

    if (given != NULL) {
        const uint8_t *row = given_row(kernel, &kernel->given.commands, bytes, &number);
        if (row != NULL)
            memcpy(&kernel->incoming, row, bytes);
        kernel->collected = row != NULL ? 1 : given->collected == 1 ? 0 : given->collected;
        kernel->ring_published = given->ring_published;
    } else {
        kernel->collected = sj_command_collect(kernel->segment, &kernel->incoming);
        /* after the command: it counts records that were published before it */
        kernel->ring_published = sj_ring_published(kernel->segment);
    }
    if (kernel->collected == 1)
        tell(kernel, SJ_TRACE_COMMAND, number, &kernel->incoming, bytes);
    return kernel->collected;
}

int32_t sj_trace_take(sj_kernel *kernel, sj_record *record)
{
    const uint64_t bytes = sj_record_bytes(kernel->axes);
    const sj_trace_frame *given = kernel->given.frame;
    int32_t status;

    if (given != NULL) {
        const uint8_t *row = given_row(kernel, &kernel->given.records, bytes, &kernel->ring_taken);
        if (row != NULL)
            memcpy(record, row, bytes);
        else
            kernel->ring_taken = given->ring_taken;
        status = row != NULL ? 1 : given->ring_status;
    } else {
        status = sj_ring_take(kernel->segment, record);
        kernel->ring_taken = sj_ring_taken(kernel->segment);
    }
    if (status == 1)
        tell(kernel, SJ_TRACE_RECORD, kernel->ring_taken, record, bytes);
    else
        kernel->ring_status = status;
    return status;
}

/* ---- what is given ---- */

void sj_trace_event(sj_kernel *kernel, const sj_kernel_event *event)
{
    sj_event_publish(kernel->segment, event);
    tell(kernel, SJ_TRACE_EVENT, 0, event, sizeof *event);
}

static uint32_t flags_of(const sj_axis *ax, int32_t led, int32_t paced, int32_t stale)
{
    int32_t moving = ax->homing || (ax->following && (axis_moving(ax) || ax->parked));
    return (moving ? SJ_TRACE_MOVING : 0U) | (ax->reached ? SJ_TRACE_SETTLED : 0U) |
           (ax->following ? SJ_TRACE_FOLLOWS : 0U) | (ax->parked ? SJ_TRACE_PARKED : 0U) |
           (ax->drive_stop ? SJ_TRACE_DRIVE_STOP : 0U) | (led ? SJ_TRACE_LED : 0U) |
           (stale ? SJ_TRACE_STALE : 0U) | (paced ? SJ_TRACE_PACED : 0U);
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
    out->flags = flags_of(ax, (int32_t)(kernel->path.led >> i & 1),
                          (int32_t)(kernel->feedback.paced >> i & 1), kernel->stale[i]);
    out->reserved = 0;
}

/* After the cycle has been counted. */
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
        int32_t status = sj_event_read(segment, cursor, (uint8_t *)items + (uint64_t)n * bytes, missed);
        if (status == 0)
            break;
        if (status < 0)
            return n > 0 ? n : status;
    }
    return n;
}
