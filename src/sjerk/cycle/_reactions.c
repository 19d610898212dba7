/* Reactions: the stops of the kernel and of its hosts, with all that follows from one.
 *
 * A stop of some axes means their whole goals and the path they are on; what was given for these axes
 * before the stop is dropped first, so that nothing plans for them any more, then they are taken from
 * their path or hold, then stopped. Never here: how an axis stops (_stops.c), causes (_observe.c).
 */
#include <stdint.h>
#include "cycle/_events.h"
#include "cycle/_group.h"
#include "cycle/_hold.h"
#include "cycle/_lookahead.h"
#include "cycle/_motion.h"
#include "cycle/_path.h"
#include "cycle/_reactions.h"
#include "cycle/_stops.h"

static uint64_t following(const sj_kernel *kernel, uint64_t axes)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        if (!kernel->axis[i].following)
            axes &= ~axis_bit(i);
    return axes;
}

/* The axes that a halt of these brings to rest. */
static uint64_t halted_with(const sj_kernel *kernel, uint64_t axes)
{
    uint64_t halted = axes & kernel->path.axes ? kernel->path.axes : 0;
    axes = following(kernel, axes & ~halted);
    for (int32_t i = 0; i < kernel->axes; i++) {
        int32_t group[SJ_AXES], n;
        if ((axes & axis_bit(i)) == 0)
            continue;
        n = sj_group_of(kernel, i, &axes, group);
        for (int32_t k = 0; k < n; k++)
            halted |= axis_bit(group[k]);
    }
    return halted;
}

void sj_react_halt(sj_kernel *kernel, uint64_t axes)
{
    uint64_t halted;
    if (axes == 0)
        return;
    halted = halted_with(kernel, axes);
    sj_lookahead_stop(kernel, halted);
    axes &= ~sj_path_halt(kernel, axes);
    sj_hold_hand_over(kernel, halted);
    sj_hold_release(kernel, halted);
    sj_stop_halt(kernel, axes);
}

void sj_react_quick_stop(sj_kernel *kernel, uint64_t axes, uint64_t together)
{
    uint64_t path = axes & kernel->path.axes ? kernel->path.axes : 0;
    if (axes == 0)
        return;
    sj_lookahead_stop(kernel, following(kernel, axes | path));
    sj_stop_halt(kernel, sj_path_leave(kernel, axes));
    sj_hold_hand_over(kernel, axes);
    sj_hold_release(kernel, axes);
    sj_stop_quick(kernel, axes, together);
}

void sj_react_stop_homing(sj_kernel *kernel, uint64_t axes)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        if ((axes & axis_bit(i)) && kernel->axis[i].homing) {
            sj_events_trigger(kernel, i, SJ_TRIGGER_HALT);
            kernel->axis[i].homing = 0;
            kernel->axis[i].drive_stop = 1; /* it is not driven by the planner */
        }
}

void sj_react(sj_kernel *kernel, int32_t cause, uint64_t axes)
{
    if (kernel->reaction[cause] != SJ_REACT_NONE)
        sj_react_stop_homing(kernel, axes);
    if (kernel->reaction[cause] == SJ_REACT_HALT)
        sj_react_halt(kernel, axes);
    else if (kernel->reaction[cause] == SJ_REACT_QUICK_STOP)
        sj_react_quick_stop(kernel, axes, 0);
}
