/* The inputs: all that a cycle takes from outside comes through here, and is written to the trace with
 * the number of its cycle. In a replay it is given back from a recording instead, so the same cycle
 * comes out, bit for bit. Never here: decisions about motion, time, memory of its own.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of payloads */
#include "cycle/_inputs.h"
#include "cycle/_trace.h"
#include "dpram/_dpram.h"

enum { ROW_HEAD = 16 }; /* bytes before the payload of a row */

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

int32_t sj_inputs_host(sj_kernel *kernel, uint64_t now_ns)
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

void sj_inputs_ring(sj_kernel *kernel)
{
    const sj_trace_frame *given = kernel->given.frame;
    kernel->ring_seen = given != NULL ? given->ring_seen : sj_ring_published(kernel->segment);
    kernel->ring_published = kernel->ring_seen;
    kernel->ring_status = 0;
}

int32_t sj_inputs_command(sj_kernel *kernel)
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
        sj_trace_put(kernel, SJ_TRACE_COMMAND, number, &kernel->incoming, bytes);
    return kernel->collected;
}

int32_t sj_inputs_stop(sj_kernel *kernel, uint32_t *slot, sj_stop *stop)
{
    uint64_t number = SJ_STOP_SLOTS;
    if (kernel->given.frame != NULL) {
        const uint8_t *row = given_row(kernel, &kernel->given.stops, sizeof *stop, &number);
        if (row == NULL)
            return 0;
        memcpy(stop, row, sizeof *stop);
    } else {
        while (*slot < SJ_STOP_SLOTS && !sj_stop_take(kernel->segment, *slot, stop))
            ++*slot;
        if (*slot == SJ_STOP_SLOTS)
            return 0;
        number = (*slot)++;
    }
    sj_trace_put(kernel, SJ_TRACE_STOP, number, stop, sizeof *stop);
    return 1;
}

int32_t sj_inputs_record(sj_kernel *kernel, sj_record *record)
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
        sj_trace_put(kernel, SJ_TRACE_RECORD, kernel->ring_taken, record, bytes);
    else
        kernel->ring_status = status;
    return status;
}
