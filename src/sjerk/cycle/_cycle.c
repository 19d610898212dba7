/* One cycle of the kernel, top to bottom in the order of the data: observe, take the command and what
 * waits behind it, move, actuate, publish.
 *
 * Never here: equations, decisions about motion, time, memory of its own.
 */
#include <stdint.h>
#include "cycle/_actuate.h"
#include "cycle/_command.h"
#include "cycle/_cycle.h"
#include "cycle/_goals.h"
#include "cycle/_hold.h"
#include "cycle/_lookahead.h"
#include "cycle/_motion.h"
#include "cycle/_observe.h"
#include "cycle/_path.h"
#include "cycle/_publish.h"
#include "cycle/_reactions.h"
#include "cycle/_trace.h"

static const double END_WAIT_S = 2.0; /* of an axis at rest, for its drive outside to be disabled */

/* Records of the ring: taken, then begun where it is their turn. */
static void look_ahead(sj_kernel *kernel)
{
    if (sj_lookahead_take(kernel))
        sj_react(kernel, SJ_CAUSE_CORRUPT, all_axes(kernel));
    sj_lookahead_offer(kernel);
}

/* The axes that a path or a feed hold drives; those that have lost it halt. */
static void follow_paths(sj_kernel *kernel)
{
    sj_react_halt(kernel, sj_path_watch(kernel));
    sj_react_halt(kernel, sj_path_step(kernel));
    sj_react_halt(kernel, sj_hold_step(kernel));
}

/* Loops of their own: the processor works at several axes at once where each waits for its sums. */
static void interpolate(sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        if (ax->following && ((kernel->path.axes | kernel->feed_hold.axes) >> i & 1) == 0) {
            int32_t ahead = ax->interpolator.cycles_left > 0;
            sj_interpolator_step(&ax->interpolator);
            if (ahead)
                sj_goal_reached(kernel, i);
        }
    }
}

void sj_kernel_cycle(sj_kernel *kernel, uint64_t now_ns)
{
    kernel->feedback.time_ns = now_ns;
    sj_lookahead_see(kernel);
    sj_observe_drives(kernel);
    sj_observe_rest(kernel, now_ns);
    sj_command_take(kernel);
    look_ahead(kernel);
    follow_paths(kernel);
    interpolate(kernel);
    sj_actuate(kernel);
    sj_publish_keep(kernel);
    kernel->feedback.cycle++;
    sj_trace_close(kernel);
    if (!kernel->quiet)
        sj_publish(kernel);
}

void sj_kernel_step(sj_kernel *kernel) { sj_kernel_cycle(kernel, 0); }

void sj_kernel_cycles(sj_kernel *kernel, int64_t cycles)
{
    while (cycles-- > 0)
        sj_kernel_cycle(kernel, 0);
}

/* A drive that is still enabled: those outside get the time to answer, if anything of them comes. */
static int32_t still_enabled(const sj_kernel *kernel, int32_t i)
{
    const sj_axis *ax = &kernel->axis[i];
    int32_t waited = ax->resting < kernel->ended ? ax->resting : kernel->ended;
    if (!sj_master_enabled(kernel->tx[i].statusword))
        return 0;
    return !ax->config.external ||
           (!kernel->stale[i] && waited * kernel->feedback.cycle_time_s < END_WAIT_S);
}

int32_t sj_kernel_at_rest(const sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        if ((kernel->axis[i].following && axis_moving(&kernel->axis[i])) ||
            still_enabled(kernel, i))
            return 0;
    return 1;
}
