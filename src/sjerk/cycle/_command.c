/* The command of the host, the newest one: its levels, edges and goal. And stops that others ask for.
 *
 * Edges are counters: each is acted on once, whatever was overwritten in between. A stop, whoever
 * asked for it, wins over a goal that came in the same cycle. Never here: how a goal is planned, who stops with whom, memory.
 */
#include <math.h> /* isfinite */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcmp of limits, memcpy of a command */
#include "cycle/_axis.h"
#include "cycle/_command.h"
#include "cycle/_events.h"
#include "cycle/_goals.h"
#include "cycle/_inputs.h"
#include "cycle/_lookahead.h"
#include "cycle/_motion.h"
#include "cycle/_override.h"
#include "cycle/_path.h"
#include "cycle/_reactions.h"

static void take_limits(sj_kernel *kernel, int32_t i, const sj_limits *limits)
{
    sj_axis *ax = &kernel->axis[i];
    const double part[] = {limits->velocity, limits->acceleration, limits->jerk,
                           limits->deceleration, limits->deceleration_jerk};
    int32_t result = SJ_RESULT_ACCEPTED;
    for (size_t k = 0; k < sizeof part / sizeof *part; k++)
        if (!(part[k] > 0.0 && isfinite(part[k])))
            result = SJ_RESULT_PLAN;
    if (limits->velocity > ax->config.velocity_max * (1.0 + 1e-9))
        result = SJ_RESULT_SPEED;
    if (result == SJ_RESULT_ACCEPTED) {
        ax->config.limits = kernel->feedback.axis[i].limits = *limits;
        sj_axis_ceiling(ax);
    }
    sj_events_report(kernel, SJ_EVENT_LIMITS, i, result, 0.0);
}

static void stop_axes(sj_kernel *kernel, uint64_t halts, uint64_t quick_stops, uint64_t together)
{
    sj_react_stop_homing(kernel, halts | quick_stops);
    sj_react_halt(kernel, halts & ~quick_stops);
    sj_react_quick_stop(kernel, quick_stops, together);
}

/* Levels and counters of all axes. Returns whether it brought a stop. */
static int32_t take_axes(sj_kernel *kernel)
{
    uint64_t halts = 0, quick_stops = 0, together = 0, disabled = 0;
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis_command *in = &kernel->command.axis[i];
        sj_axis *ax = &kernel->axis[i];
        sj_axis_feedback *out = &kernel->feedback.axis[i];
        halts |= (uint64_t)(in->halts != ax->halts) << i;
        quick_stops |= (uint64_t)(in->quick_stops != ax->quick_stops) << i;
        together |= (uint64_t)(in->together != 0) << i;
        disabled |= (uint64_t)(ax->enable && !in->enable) << i;
        if (in->resets != ax->resets) {
            ax->reset = 2; /* one cycle low, then the edge */
            ax->error = 0;
        }
        if (in->limit_sets != ax->limit_sets)
            take_limits(kernel, i, &in->limits);
        ax->enable = out->enable = in->enable;
        ax->halts = out->halts = in->halts;
        ax->quick_stops = out->quick_stops = in->quick_stops;
        ax->resets = out->resets = in->resets;
        ax->limit_sets = out->limit_sets = in->limit_sets;
    }
    kernel->lookahead.stop = kernel->command.stop_records;
    sj_lookahead_stop(kernel, halts | quick_stops | disabled);
    stop_axes(kernel, halts, quick_stops, together);
    sj_react_halt(kernel, disabled & ~(halts | quick_stops)); /* a drive is disabled at rest only */
    return (halts | quick_stops) != 0;
}

static void tell_stop(sj_kernel *kernel, uint64_t axes, int32_t how, uint64_t pid)
{
    if (axes == all_axes(kernel))
        sj_events_report(kernel, SJ_EVENT_STOP, -1, how, (double)pid);
    for (int32_t i = 0; i < kernel->axes && axes != all_axes(kernel); i++)
        if (axes & axis_bit(i))
            sj_events_report(kernel, SJ_EVENT_STOP, i, how, (double)pid);
}

/* Stops that were asked for beside the host. They mean all that the host has given so far, since
 * nobody knows which of two processes was first. Returns whether there was one. */
static int32_t take_stops(sj_kernel *kernel)
{
    const uint64_t all = all_axes(kernel), before = kernel->lookahead.stop;
    uint64_t halts = 0, quick_stops = 0;
    uint32_t slot = 0;
    sj_stop stop;

    while (sj_inputs_stop(kernel, &slot, &stop)) {
        tell_stop(kernel, stop.halts & all, SJ_REACT_HALT, stop.pid);
        tell_stop(kernel, stop.quick_stops & all, SJ_REACT_QUICK_STOP, stop.pid);
        halts |= stop.halts & all;
        quick_stops |= stop.quick_stops & all;
    }
    if ((halts | quick_stops) == 0)
        return 0;
    kernel->lookahead.stop = kernel->ring_published;
    sj_lookahead_stop(kernel, halts | quick_stops);
    stop_axes(kernel, halts, quick_stops, 0);
    kernel->lookahead.stop = before;
    return 1;
}

static int32_t same_goal(const sj_axis_goal *x, const sj_axis_goal *y)
{
    return x->kind == y->kind && x->goal == y->goal && x->goal_velocity == y->goal_velocity &&
           memcmp(&x->limits, &y->limits, sizeof x->limits) == 0;
}

/* A goal for all its axes or for none; stopped: it came with a stop. */
static void take_goal(sj_kernel *kernel, int32_t stopped)
{
    const sj_command *command = &kernel->command;
    sj_feedback *feedback = &kernel->feedback;
    int32_t result = stopped ? SJ_RESULT_STOPPED : SJ_RESULT_ACCEPTED, changed = 0;
    uint64_t chosen = 0;
    sj_goal_set set;

    kernel->goal_id = set.id = command->goal_id;
    set.least_cycles = command->least_cycles;
    set.synchronization = command->synchronization;
    set.n = 0;
    set.refused = -1;
    for (int32_t i = 0; i < kernel->axes && result == SJ_RESULT_ACCEPTED; i++) {
        sj_axis *ax = &kernel->axis[i];
        sj_axis_goal *goal = &set.goal[set.n];
        if (command->axis[i].goal.kind == SJ_GOAL_NONE)
            continue;
        *goal = command->axis[i].goal;
        sj_path_hand_over(kernel, i);
        if (goal->kind == SJ_GOAL_RELATIVE) {
            goal->kind = SJ_GOAL_ABSOLUTE;
            goal->goal += ax->interpolator.q.hi;
            changed = 1;
        }
        result = sj_axis_judge(ax, goal);
        if (result != SJ_RESULT_ACCEPTED)
            set.refused = i;
        changed |= !same_goal(&ax->goal, goal) || goal->kind == SJ_GOAL_HOME;
        set.axes[set.n++] = i;
        chosen |= axis_bit(i);
    }
    if (result == SJ_RESULT_ACCEPTED && changed) {
        result = sj_goal_begin(kernel, &set);
        if (result == SJ_RESULT_ACCEPTED)
            sj_override_hold(kernel);
    }
    if (result == SJ_RESULT_ACCEPTED)
        sj_path_release(kernel, chosen);
    if (result == SJ_RESULT_ACCEPTED)
        sj_lookahead_drop(kernel, chosen, 0, command->goal_records, SJ_RESULT_SUPERSEDED);
    for (int32_t i = 0; i < set.n && result == SJ_RESULT_ACCEPTED; i++)
        kernel->axis[set.axes[i]].goal_id = command->goal_id;
    feedback->result_goal_id = command->goal_id;
    feedback->result = result;
    feedback->result_axis = set.refused;
    sj_events_answer(kernel, command->goal_id, set.refused, result);
}

void sj_command_take(sj_kernel *kernel)
{
    sj_command *command = &kernel->command;
    int32_t stopped = kernel->ending;
    int32_t fresh = sj_inputs_command(kernel);

    stopped |= take_stops(kernel);
    if (fresh < 0) {
        kernel->feedback.corrupt++;
        sj_events_report(kernel, SJ_EVENT_CORRUPT, -1, fresh, 0.0);
        sj_react(kernel, SJ_CAUSE_CORRUPT, all_axes(kernel));
    } else if (fresh == 1) {
        memcpy(command, &kernel->incoming, sj_command_bytes(kernel->axes));
        stopped |= take_axes(kernel);
        if (command->cancels != kernel->cancels)
            sj_lookahead_drop(kernel, command->cancel_axes, command->cancel_from,
                              command->cancel_to, SJ_RESULT_SUPERSEDED);
        kernel->cancels = command->cancels;
        sj_override_set(kernel, command->override, command->hold != 0);
        if (command->goal_id != kernel->goal_id)
            take_goal(kernel, stopped);
        kernel->feedback.sequence = command->sequence;
    }
}
