/* The look-ahead: moves and pieces of paths that were given before their turn.
 *
 * A host writes them as records into the ring of the dual-port RAM, each once and in order. A cycle
 * takes a few of them, so that a full ring does not make one cycle long: SJ_LOOKAHEAD_TAKES at most,
 * and SJ_LOOKAHEAD_PASSES that are dropped as they come. SJ_LOOKAHEAD records at most wait here; the
 * others stay in the ring.
 *
 * Turns. A record has the axes whose goal kind is not NONE. Its turn comes when no earlier record of
 * one of its axes waits. So chains of different axes do not delay each other though they share one
 * ring. In its turn it is offered once per cycle to the queue (a move) or to the path (its opening, a
 * segment), until that file takes or refuses it.
 *
 * Order with commands. Of commands only the newest counts; they overtake the ring. Two counters keep
 * the order: `seen`, how far the ring went before the command was collected, so that no record is
 * taken before a command that was given before it; and `stop`, the last record that the host had
 * given when it commanded a stop, so that a stop drops what was given before it and nothing else.
 *
 * Dropping. Records first .. last of some axes are not begun. Those that wait are answered at once;
 * for those in the ring the order is remembered until they have come. A move that the one before
 * blends into cannot be dropped at once where that one is too near to its goal: it stays, answered,
 * until its axes have passed the goal, and then brings them to rest.
 *
 * A move or a path gets one answer, a segment has that of its path. Never here: planning, time.
 */
#include <stddef.h>
#include <stdint.h>
#include "cycle/_events.h"
#include "cycle/_inputs.h"
#include "cycle/_lookahead.h"
#include "cycle/_motion.h"
#include "cycle/_override.h"
#include "cycle/_path.h"
#include "cycle/_queue.h"

void sj_lookahead_start(sj_lookahead *lookahead)
{
    for (int32_t i = 0; i < SJ_LOOKAHEAD; i++)
        lookahead->order[i] = i;
}

void sj_lookahead_see(sj_kernel *kernel)
{
    sj_inputs_ring(kernel);
    kernel->lookahead.seen = kernel->lookahead.stop = kernel->ring_seen;
}

/* ---- records that are not to be begun ---- */

static void answer(sj_kernel *kernel, const sj_waiting *waiting, int32_t axis, int32_t result)
{
    if (waiting->record.kind != SJ_RECORD_SEGMENT || result != SJ_RESULT_ACCEPTED)
        if (!waiting->spent)
            sj_events_answer(kernel, waiting->record.goal_id, axis, result);
}

/* The answer of a segment is that of its path. A path that was dropped was never open: the segments
 * of it that still come are known by its goal id. */
static void drop(sj_kernel *kernel, const sj_waiting *waiting, int32_t result)
{
    if (waiting->record.kind == SJ_RECORD_PATH && kernel->path.newest < waiting->record.goal_id)
        kernel->path.newest = waiting->record.goal_id;
    if (waiting->record.kind != SJ_RECORD_SEGMENT && !waiting->spent)
        sj_events_answer(kernel, waiting->record.goal_id, -1, result);
}

/* Frees the place of record i in the order. */
static void forget(sj_lookahead *lookahead, int32_t i)
{
    int32_t place = lookahead->order[i];
    lookahead->count--;
    for (; i < lookahead->count; i++)
        lookahead->order[i] = lookahead->order[i + 1];
    lookahead->order[lookahead->count] = place;
}

static int32_t falls_under(const sj_drop *order, const sj_waiting *waiting)
{
    return waiting->number >= order->first && waiting->number <= order->last &&
           (waiting->axes & order->axes) != 0;
}

void sj_lookahead_drop(sj_kernel *kernel, uint64_t axes, uint64_t first, uint64_t last,
                       int32_t result)
{
    sj_lookahead *lookahead = &kernel->lookahead;
    uint64_t published = kernel->ring_published;
    sj_drop order = {first, last < published ? last : published, axes, result, 0};

    if (axes == 0 || order.last < first)
        return;
    for (int32_t i = 0; i < lookahead->count;) {
        sj_waiting *waiting = &lookahead->waiting[lookahead->order[i]];
        if (!falls_under(&order, waiting)) {
            i++;
            continue;
        }
        drop(kernel, waiting, result);
        if (sj_queue_drop(kernel, waiting))
            i++;
        else
            forget(lookahead, i);
    }
    if (order.last <= kernel->ring_taken)
        return; /* none of them is still in the ring */
    if (lookahead->drops == SJ_LOOKAHEAD_DROPS) {
        /* rather one record too many is dropped: nothing moves that should not */
        sj_drop *newest = &lookahead->drop[SJ_LOOKAHEAD_DROPS - 1];
        newest->first = first < newest->first ? first : newest->first;
        newest->last = order.last > newest->last ? order.last : newest->last;
        newest->axes |= axes;
        return;
    }
    lookahead->drop[lookahead->drops++] = order;
}

void sj_lookahead_stop(sj_kernel *kernel, uint64_t axes)
{
    sj_lookahead_drop(kernel, axes, 0, kernel->lookahead.stop, SJ_RESULT_STOPPED);
}

/* The order under which a record that has just been taken is dropped, or NULL. Orders whose last record
 * has come are forgotten. */
static const sj_drop *dropped(sj_lookahead *lookahead, const sj_waiting *waiting)
{
    int32_t kept = 0;
    for (int32_t i = 0; i < lookahead->drops; i++)
        if (lookahead->drop[i].last >= waiting->number)
            lookahead->drop[kept++] = lookahead->drop[i];
    lookahead->drops = kept;
    for (int32_t i = 0; i < kept; i++)
        if (falls_under(&lookahead->drop[i], waiting))
            return &lookahead->drop[i];
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
enum { TAKE_NONE = 0, TAKE_TAKEN = 1, TAKE_DROPPED = 2, TAKE_CORRUPT = 3 };

/* A ring that is corrupt is reported once; no record is taken until the host flushes it. */
static int32_t take(sj_kernel *kernel)
{
    sj_lookahead *lookahead = &kernel->lookahead;
    sj_waiting *waiting = &lookahead->waiting[lookahead->order[lookahead->count]];
    int32_t status = sj_inputs_record(kernel, &waiting->record);
    const sj_drop *order;
    int32_t result;

    if (status < 0) {
        if (!kernel->feedback.ring_corrupt) {
            kernel->feedback.corrupt++;
            sj_events_report(kernel, SJ_EVENT_CORRUPT, -1, status, 0.0);
        }
        kernel->feedback.ring_corrupt = 1;
        return TAKE_CORRUPT;
    }
    kernel->feedback.ring_corrupt = 0;
    if (status == 0)
        return TAKE_NONE;
    waiting->number = kernel->ring_taken;
    waiting->axes = axes_of(kernel, &waiting->record);
    waiting->blending = 0;
    waiting->share = 1.0;
    waiting->spent = 0;
    waiting->refused = -1;
    result = waiting->record.kind == SJ_RECORD_MOVE ? sj_queue_judge(kernel, waiting)
                                                    : SJ_RESULT_ACCEPTED;
    order = dropped(lookahead, waiting);
    if (order != NULL) {
        drop(kernel, waiting, order->result);
        return TAKE_DROPPED;
    }
    if (kernel->ending)
        drop(kernel, waiting, SJ_RESULT_STOPPED);
    else if (waiting->axes == 0)
        answer(kernel, waiting, -1, SJ_RESULT_KIND);
    else if (result != SJ_RESULT_ACCEPTED)
        answer(kernel, waiting, waiting->refused, result);
    else
        lookahead->count++;
    return TAKE_TAKEN;
}

int32_t sj_lookahead_take(sj_kernel *kernel)
{
    const sj_lookahead *lookahead = &kernel->lookahead;
    int32_t takes = 0, passes = 0;

    while (takes < SJ_LOOKAHEAD_TAKES && passes < SJ_LOOKAHEAD_PASSES &&
           lookahead->count < SJ_LOOKAHEAD) {
        uint64_t taken = kernel->ring_taken;
        int32_t known = kernel->feedback.ring_corrupt, status;
        if (taken == lookahead->seen || (takes + passes > 0 && taken > lookahead->seen))
            break;
        status = take(kernel);
        if (status == TAKE_CORRUPT)
            return !known;
        passes += status == TAKE_DROPPED;
        takes += status != TAKE_DROPPED;
    }
    return 0;
}

/* ---- whose turn it is ---- */

static int32_t offer(sj_kernel *kernel, sj_waiting *waiting)
{
    int32_t said;
    switch (waiting->record.kind) {
    case SJ_RECORD_MOVE:
        said = sj_queue_offer(kernel, waiting);
        if (said == OFFER_TAKEN && !waiting->spent)
            sj_override_hold(kernel);
        return said;
    case SJ_RECORD_PATH:
    case SJ_RECORD_SEGMENT: return sj_path_offer(kernel, waiting);
    default: return -SJ_RESULT_KIND;
    }
}

void sj_lookahead_offer(sj_kernel *kernel)
{
    sj_lookahead *lookahead = &kernel->lookahead;
    uint64_t earlier = 0; /* axes of records before */

    for (int32_t i = 0; i < lookahead->count;) {
        sj_waiting *waiting = &lookahead->waiting[lookahead->order[i]];
        int32_t said = (waiting->axes & earlier) ? OFFER_WAIT : offer(kernel, waiting);
        if (said == OFFER_WAIT) {
            earlier |= waiting->axes;
            i++;
            continue;
        }
        answer(kernel, waiting, waiting->refused, said < 0 ? -said : SJ_RESULT_ACCEPTED);
        if (waiting->record.kind == SJ_RECORD_MOVE)
            earlier |= waiting->axes; /* planned enough for one cycle */
        forget(lookahead, i);
    }
}
