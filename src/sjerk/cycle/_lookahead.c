/* The look-ahead: records of the ring, each once and in order. A few are taken per cycle; one waits
 * here until no earlier record of its axes does, and is then offered to the room it is for.
 *
 * A record has the axes whose goal kind is not NONE. Whoever begins or drops a move or a path gives
 * its goal the one answer it gets; a segment has that of its path. Never here: planning, time.
 */
#include <stddef.h>
#include <stdint.h>
#include "_cycle.h"

uint64_t sj_record_bytes(int32_t axes)
{
    return offsetof(sj_record, axis) + (uint64_t)axes * sizeof(sj_axis_record);
}

void sj_ahead_start(sj_ahead *ahead)
{
    for (int32_t i = 0; i < SJ_AHEAD; i++)
        ahead->order[i] = i;
}

/* Before the command is collected: a record is never taken before a command that was given before it. */
void sj_ahead_see(sj_kernel *kernel)
{
    sj_trace_see(kernel);
    kernel->ahead.seen = kernel->ahead.stop = kernel->ring_seen;
}

/* ---- records that are not to be begun ---- */

static void answer(sj_kernel *kernel, const sj_held *held, int32_t axis, int32_t result)
{
    if (held->record.kind != SJ_RECORD_SEGMENT || result != SJ_RESULT_ACCEPTED)
        if (!held->spent)
            sj_cycle_answer(kernel, held->record.goal_id, axis, result);
}

/* A segment's path has the answer; what comes of it later is of a path that is over. */
static void drop(sj_kernel *kernel, const sj_held *held, int32_t result)
{
    if (held->record.kind == SJ_RECORD_PATH && kernel->path.newest < held->record.goal_id)
        kernel->path.newest = held->record.goal_id;
    if (held->record.kind != SJ_RECORD_SEGMENT && !held->spent)
        sj_cycle_answer(kernel, held->record.goal_id, -1, result);
}

/* Frees place i of the order. */
static void forget(sj_ahead *ahead, int32_t i)
{
    int32_t place = ahead->order[i];
    ahead->count--;
    for (; i < ahead->count; i++)
        ahead->order[i] = ahead->order[i + 1];
    ahead->order[ahead->count] = place;
}

static int32_t falls_under(const sj_drop *order, const sj_held *held)
{
    return held->number >= order->first && held->number <= order->last &&
           (held->axes & order->axes) != 0;
}

void sj_ahead_drop(sj_kernel *kernel, uint64_t axes, uint64_t first, uint64_t last, int32_t result)
{
    sj_ahead *ahead = &kernel->ahead;
    uint64_t published = kernel->ring_published;
    sj_drop order = {first, last < published ? last : published, axes, result, 0};

    if (axes == 0 || order.last < first)
        return;
    for (int32_t i = 0; i < ahead->count;) {
        sj_held *held = &ahead->held[ahead->order[i]];
        if (!falls_under(&order, held)) {
            i++;
            continue;
        }
        drop(kernel, held, result);
        if (sj_queue_drop(kernel, held))
            i++;
        else
            forget(ahead, i);
    }
    if (order.last <= kernel->ring_taken)
        return; /* none of them is still in the ring */
    if (ahead->drops == SJ_AHEAD_DROPS) { /* rather one too many: nothing moves that should not */
        sj_drop *newest = &ahead->drop[SJ_AHEAD_DROPS - 1];
        newest->first = first < newest->first ? first : newest->first;
        newest->last = order.last > newest->last ? order.last : newest->last;
        newest->axes |= axes;
        return;
    }
    ahead->drop[ahead->drops++] = order;
}

void sj_ahead_stop(sj_kernel *kernel, uint64_t axes)
{
    sj_ahead_drop(kernel, axes, 0, kernel->ahead.stop, SJ_RESULT_STOPPED);
}

/* Whether a record that has just been taken is among them; orders that all have passed are over. */
static const sj_drop *dropped(sj_ahead *ahead, const sj_held *held)
{
    int32_t kept = 0;
    for (int32_t i = 0; i < ahead->drops; i++)
        if (ahead->drop[i].last >= held->number)
            ahead->drop[kept++] = ahead->drop[i];
    ahead->drops = kept;
    for (int32_t i = 0; i < kept; i++)
        if (falls_under(&ahead->drop[i], held))
            return &ahead->drop[i];
    return NULL;
}

/* ---- the ring ---- */

static uint64_t axes_of(const sj_kernel *kernel, const sj_record *record)
{
    uint64_t axes = 0;
    for (int32_t i = 0; i < kernel->axes; i++)
        axes |= (uint64_t)(record->axis[i].goal.kind != SJ_GOAL_NONE) << i;
    return axes;
}

/* 1 taken, 2 taken and dropped, 0 none, < 0 spoilt; told once, and no record is taken until the host flushes the ring. */
static int32_t take(sj_kernel *kernel)
{
    sj_ahead *ahead = &kernel->ahead;
    sj_held *held = &ahead->held[ahead->order[ahead->count]];
    int32_t status = sj_trace_take(kernel, &held->record);
    const sj_drop *order;
    int32_t result;

    if (status < 0) {
        if (!kernel->feedback.ring_spoilt) {
            kernel->feedback.corrupt++;
            sj_cycle_tell(kernel, SJ_EVENT_SPOILT, -1, status, 0.0);
            sj_cycle_react(kernel, SJ_CAUSE_SPOILT, sj_cycle_all(kernel));
        }
        kernel->feedback.ring_spoilt = 1;
        return status;
    }
    kernel->feedback.ring_spoilt = 0;
    if (status == 0)
        return 0;
    held->number = kernel->ring_taken;
    held->axes = axes_of(kernel, &held->record);
    held->passing = 0;
    held->share = 1.0;
    held->spent = 0;
    held->refused = -1;
    result = held->record.kind == SJ_RECORD_MOVE ? sj_queue_judge(kernel, held)
                                                 : SJ_RESULT_ACCEPTED;
    order = dropped(ahead, held);
    if (order != NULL) {
        drop(kernel, held, order->result);
        return 2;
    }
    if (kernel->ending)
        drop(kernel, held, SJ_RESULT_STOPPED);
    else if (held->axes == 0)
        answer(kernel, held, -1, SJ_RESULT_KIND);
    else if (result != SJ_RESULT_ACCEPTED)
        answer(kernel, held, held->refused, result);
    else
        ahead->count++;
    return 1;
}

/* ---- whose turn it is ---- */

/* Each room: OFFER_WAIT, OFFER_TAKEN, or -(enum sj_result). */
static int32_t offer(sj_kernel *kernel, sj_held *held)
{
    switch (held->record.kind) {
    case SJ_RECORD_MOVE:
        return sj_queue_offer(kernel, held);
    case SJ_RECORD_PATH:
    case SJ_RECORD_SEGMENT:
        return sj_path_offer(kernel, held);
    default:
        return -SJ_RESULT_KIND;
    }
}

void sj_ahead_take(sj_kernel *kernel)
{
    sj_ahead *ahead = &kernel->ahead;
    uint64_t waiting = 0; /* axes of earlier records */
    int32_t takes = 0, passes = 0;

    while (takes < SJ_AHEAD_TAKES && passes < SJ_AHEAD_PASSES && ahead->count < SJ_AHEAD) {
        uint64_t taken = kernel->ring_taken;
        int32_t status;
        if (taken == ahead->seen || (takes + passes > 0 && taken > ahead->seen))
            break;
        status = take(kernel);
        if (status < 0)
            break;
        passes += status == 2;
        takes += status != 2;
    }
    for (int32_t i = 0; i < ahead->count;) {
        sj_held *held = &ahead->held[ahead->order[i]];
        int32_t said = (held->axes & waiting) ? OFFER_WAIT : offer(kernel, held);
        if (said == OFFER_WAIT) {
            waiting |= held->axes;
            i++;
            continue;
        }
        answer(kernel, held, held->refused, said < 0 ? -said : SJ_RESULT_ACCEPTED);
        if (held->record.kind == SJ_RECORD_MOVE)
            waiting |= held->axes; /* planned enough for one cycle */
        forget(ahead, i);
    }
}
