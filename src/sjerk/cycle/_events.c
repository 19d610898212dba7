/* Events: what the kernel reports besides its frames, each once and with the cycle it belongs to.
 *
 * The states of an axis change here, since every change is an event. Never here: decisions about
 * motion, time.
 */
#include <stdint.h>
#include "cycle/_events.h"
#include "cycle/_trace.h"
#include "dpram/_dpram.h"

static void report(sj_kernel *kernel, int32_t kind, uint64_t goal_id, int32_t axis, int32_t code,
                   double value)
{
    const sj_kernel_event event = {
        kernel->feedback.cycle + 1, kernel->feedback.time_ns, goal_id, value, kind, axis, code, 0};
    sj_event_publish(kernel->segment, &event);
    sj_trace_put(kernel, SJ_TRACE_EVENT, 0, &event, sizeof event);
}

void sj_events_report(sj_kernel *kernel, int32_t kind, int32_t axis, int32_t code, double value)
{
    uint64_t goal_id = axis >= 0 ? kernel->axis[axis].goal_id : kernel->goal_id;
    report(kernel, kind, goal_id, axis, code, value);
}

void sj_events_answer(sj_kernel *kernel, uint64_t goal_id, int32_t axis, int32_t result)
{
    report(kernel, SJ_EVENT_GOAL, goal_id, axis, result, 0.0);
}

void sj_events_reached(sj_kernel *kernel, uint64_t goal_id)
{
    report(kernel, SJ_EVENT_REACHED, goal_id, -1, 0, 0.0);
}

void sj_events_path(sj_kernel *kernel, int32_t state)
{
    sj_path_feedback *out = &kernel->feedback.path;
    if (out->state == state)
        return;
    out->state = state;
    report(kernel, SJ_EVENT_PATH, kernel->path.goal_id, -1, state, (double)out->number);
}

int32_t sj_events_trigger(sj_kernel *kernel, int32_t axis, int32_t trigger)
{
    sj_axis *ax = &kernel->axis[axis];
    int32_t next = sj_axis_next(ax->state, trigger), before = ax->state;
    if (next < 0)
        return -1;
    ax->state = next;
    if (next != before)
        sj_events_report(kernel, SJ_EVENT_STATE, axis, next, before);
    return 0;
}
