/* The look-ahead: records of the ring, each once and in order. A few are taken per cycle; one waits
 * here until no earlier record of its axes does, and is then offered to the room it is for.
 *
 * A record has the axes whose goal kind is not NONE. Whoever begins or drops a move or a path gives
 * its goal the one answer it gets; a segment has that of its path. Never here: planning, time.
 */
#include <stddef.h>
#include <stdint.h>
#include "cycle/_events.h"
#include "cycle/_inputs.h"
#include "cycle/_lookahead.h"
#include "cycle/_motion.h"
#include "cycle/_path.h"
#include "cycle/_queue.h"

void sj_lookahead_start(sj_ahead *ahead)
{
    for (int32_t i = 0; i < SJ_AHEAD; i++)
        ahead->order[i] = i;
}

/* Before the command is collected: a record is never taken before a command that was given before it. */
void sj_lookahead_see(sj_kernel *kernel)
{
    sj_inputs_ring(kernel);
    kernel->ahead.seen = kernel->ahead.stop = kernel->ring_seen;
}

/* ---- records that are not to be begun ---- */

static void answer(sj_kernel *kernel, const sj_held *held, int32_t axis, int32_t result)
{
    if (held->record.kind != SJ_RECORD_SEGMENT || result != SJ_RESULT_ACCEPTED)
        if (!held->spent)
            sj_events_answer(kernel, held->record.goal_id, axis, result);
}

/* A segment's path has the answer; what comes of it later is of a path that is over. */
static void drop(sj_kernel *kernel, const sj_held *held, int32_t result)
{
    if (held->record.kind == SJ_RECORD_PATH && kernel->path.newest < held->record.goal_id)
        kernel->path.newest = held->record.goal_id;
    if (held->record.kind != SJ_RECORD_SEGMENT && !held->spent)
        sj_events_answer(kernel, held->record.goal_id, -1, result);
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

void sj_lookahead_drop(sj_kernel *kernel, uint64_t axes, uint64_t first, uint64_t last,
                       int32_t result)
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

void sj_lookahead_stop(sj_kernel *kernel, uint64_t axes)
{
    sj_lookahead_drop(kernel, axes, 0, kernel->ahead.stop, SJ_RESULT_STOPPED);
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

/* What taking one record came to. */
enum { TAKE_NONE = 0, TAKE_TAKEN = 1, TAKE_DROPPED = 2, TAKE_SPOILT = 3 };

/* A ring that is spoilt is reported once; no record is taken until the host flushes it. */
static int32_t take(sj_kernel *kernel)
{
    sj_ahead *ahead = &kernel->ahead;
    sj_held *held = &ahead->held[ahead->order[ahead->count]];
    int32_t status = sj_inputs_record(kernel, &held->record);
    const sj_drop *order;
    int32_t result;

    if (status < 0) {
        if (!kernel->feedback.ring_spoilt) {
            kernel->feedback.corrupt++;
            sj_events_report(kernel, SJ_EVENT_SPOILT, -1, status, 0.0);
        }
        kernel->feedback.ring_spoilt = 1;
        return TAKE_SPOILT;
    }
    kernel->feedback.ring_spoilt = 0;
    if (status == 0)
        return TAKE_NONE;
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
        return TAKE_DROPPED;
    }
    if (kernel->ending)
        drop(kernel, held, SJ_RESULT_STOPPED);
    else if (held->axes == 0)
        answer(kernel, held, -1, SJ_RESULT_KIND);
    else if (result != SJ_RESULT_ACCEPTED)
        answer(kernel, held, held->refused, result);
    else
        ahead->count++;
    return TAKE_TAKEN;
}

int32_t sj_lookahead_take(sj_kernel *kernel)
{
    const sj_ahead *ahead = &kernel->ahead;
    int32_t takes = 0, passes = 0;

    while (takes < SJ_AHEAD_TAKES && passes < SJ_AHEAD_PASSES && ahead->count < SJ_AHEAD) {
        uint64_t taken = kernel->ring_taken;
        int32_t spoilt = kernel->feedback.ring_spoilt, status;
        if (taken == ahead->seen || (takes + passes > 0 && taken > ahead->seen))
            break;
        status = take(kernel);
        if (status == TAKE_SPOILT)
            return !spoilt;
        passes += status == TAKE_DROPPED;
        takes += status != TAKE_DROPPED;
    }
    return 0;
}

/* ---- whose turn it is ---- */

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

void sj_lookahead_offer(sj_kernel *kernel)
{
    sj_ahead *ahead = &kernel->ahead;
    uint64_t waiting = 0; /* axes of earlier records */

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
