/* Observing: the drives' images, the host, the clock; what is wrong becomes an event and, where one is
 * set for the cause, a reaction.
 *
 * While a drive does not follow, the commanded position is the actual one. Never here: what a reaction
 * does (_reactions.c), bit masks of drives, time.
 */
#include <math.h> /* fabs, isinf */
#include <stdint.h>
#include "cycle/_events.h"
#include "cycle/_goals.h"
#include "cycle/_inputs.h"
#include "cycle/_lookahead.h"
#include "cycle/_motion.h"
#include "cycle/_observe.h"
#include "cycle/_reactions.h"
#include "dpram/_dpram.h"

enum { PATIENCE = 3 }; /* cycles without bit 12 that are no stop */

/* ---- drives ---- */

/* The command becomes the actual position, at rest. */
static void anchor(sj_axis *ax)
{
    sj_state actual = {(double)ax->actual_counts / ax->config.counts_per_unit, 0.0, 0.0};
    sj_interpolator_start(&ax->interpolator, &actual);
    ax->goal.kind = SJ_GOAL_NONE;
    ax->held = ax->reached = ax->blends = 0;
}

/* Until a reset, as after any fault; those that home with it stop whatever the reaction is. */
static void homing_failed(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    uint64_t others = all_axes(kernel) & ~axis_bit(i), with_it = 0;
    for (int32_t k = 0; k < kernel->axes; k++)
        if (k != i && kernel->axis[k].goal_id == ax->goal_id)
            with_it |= axis_bit(k);
    sj_events_report(kernel, SJ_EVENT_FAULT, i, -1, 0.0);
    ax->error = 1;
    sj_events_trigger(kernel, i, SJ_TRIGGER_FAULT);
    sj_lookahead_stop(kernel, axis_bit(i) | with_it);
    sj_react_stop_homing(kernel, with_it);
    sj_react(kernel, SJ_CAUSE_DRIVE_FAULT, others);
}

static void observe_homing(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    int32_t outcome = sj_master_homing(&kernel->tx[i]);
    if (ax->homing <= HOMING_SETTLES || outcome == 0)
        return;
    ax->homing = 0;
    ax->homed = outcome > 0; /* not done before it follows again: until then no goal can be taken */
    if (outcome < 0)
        homing_failed(kernel, i);
}

/* Whether the drive follows the command. An enabled one that lets bit 12 fall for a few cycles at speed
 * may only have missed a SYNC: the command goes on, and so does the move. Not where bit 11 tells of a
 * limit that it keeps. One that was silent follows
 * from the cycle after: the command has to be where it is now first. */
static int32_t follows(sj_axis *ax, const sj_drive_tx *tx, int32_t stale)
{
    int32_t now = sj_master_follows_position(tx), silent = ax->unfollowed > PATIENCE;

    if (stale) {
        ax->unfollowed = PATIENCE + 1;
        return 0;
    }
    if (now || !ax->following || ax->homing || !axis_moving(ax) || !sj_master_bridging(tx)) {
        ax->unfollowed = 0;
        return now && !silent;
    }
    return ax->unfollowed++ < PATIENCE;
}

/* Told before what the drive does about it. */
static void observe_switches(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    uint32_t closed = sj_master_switches(&kernel->tx[i]), before = ax->switches;
    if (closed == before)
        return;
    ax->switches = closed;
    sj_events_report(kernel, SJ_EVENT_SWITCH, i, (int32_t)closed, before);
}

static void observe(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    const sj_drive_tx *tx = &kernel->tx[i];
    uint32_t change = (uint32_t)tx->position_actual - (uint32_t)ax->actual_counts;
    int32_t followed = ax->following, stale = ax->config.external && kernel->stale[i];
    int32_t fault = sj_master_fault(tx->statusword) || stale;

    ax->actual_counts += (int32_t)change;
    observe_switches(kernel, i);
    ax->following = follows(ax, tx, stale);
    ax->drive_stop |= stale && sj_master_enabled(tx->statusword); /* it may still hear us */
    if (!ax->following) {
        if (followed && !ax->homing) /* what waits behind a homing waits on */
            sj_lookahead_stop(kernel, axis_bit(i));
        if (followed && axis_moving(ax))
            sj_events_report(kernel, SJ_EVENT_ANCHOR, i, tx->statusword, 0.0);
        anchor(ax);
    } else if (ax->homed) {
        ax->homed = 0;
        sj_goal_homed(kernel, i);
    }
    if (ax->drive_stop && !sj_master_enabled(tx->statusword) && !sj_master_stopping(tx->statusword))
        ax->drive_stop = 0;
    if (ax->homing && sj_master_enabled(tx->statusword))
        observe_homing(kernel, i);
    ax->error |= stale; /* its drive may go on as if nothing had been: until a reset */
    if (fault && ax->state != SJ_AXIS_ERROR_STOP) {
        int32_t lost = stale || sj_master_lost(tx->error_code);
        sj_events_report(kernel, lost ? SJ_EVENT_SYNC : SJ_EVENT_FAULT, i,
                         stale ? 0 : tx->error_code, 0.0);
        sj_events_trigger(kernel, i, SJ_TRIGGER_FAULT);
        ax->homing = ax->homed = 0;
        sj_react(kernel, lost ? SJ_CAUSE_SYNC_LOST : SJ_CAUSE_DRIVE_FAULT,
                 all_axes(kernel) & ~axis_bit(i));
    }
    if (!fault && !ax->error && ax->state == SJ_AXIS_ERROR_STOP)
        sj_events_trigger(kernel, i, SJ_TRIGGER_RESET);
    if (ax->following && ax->state == SJ_AXIS_DISABLED)
        sj_events_trigger(kernel, i, SJ_TRIGGER_POWER_ON);
    if (!ax->following && !(ax->state == SJ_AXIS_HOMING && sj_master_enabled(tx->statusword))) {
        sj_events_trigger(kernel, i, SJ_TRIGGER_POWER_OFF);
        ax->homing = ax->homed = 0; /* else it would begin anew with its power */
    }
    if (ax->following && !ax->homing && !axis_moving(ax) && !ax->held &&
        ax->state > SJ_AXIS_STANDSTILL)
        sj_events_trigger(kernel, i, SJ_TRIGGER_DONE);
}

static void watch_following(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    double error;
    if (!ax->following || ax->error || isinf(ax->config.following_limit))
        return;
    error = (double)(ax->target_counts - ax->actual_counts) / ax->config.counts_per_unit;
    if (fabs(error) <= ax->config.following_limit)
        return;
    sj_events_report(kernel, SJ_EVENT_FOLLOWING, i, 0, error);
    sj_react(kernel, SJ_CAUSE_FOLLOWING_ERROR, all_axes(kernel));
    if (kernel->reaction[SJ_CAUSE_FOLLOWING_ERROR] != SJ_REACT_NONE) {
        ax->error = 1;
        sj_events_trigger(kernel, i, SJ_TRIGGER_FAULT);
    }
}

void sj_observe_drives(sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        observe(kernel, i);
    for (int32_t i = 0; i < kernel->axes; i++)
        watch_following(kernel, i);
}

/* ---- host, clock, end ---- */

void sj_observe_rest(sj_kernel *kernel, uint64_t now_ns)
{
    int32_t host = sj_inputs_host(kernel, now_ns);
    if (host != kernel->host_state) { /* once; the next host may move on */
        sj_events_report(kernel, SJ_EVENT_HOST, -1, host, kernel->host_state);
        if (host == SJ_HOST_DEAD)
            sj_react(kernel, SJ_CAUSE_HOST_DEATH, all_axes(kernel));
        else if (host == SJ_HOST_SILENT)
            sj_react(kernel, SJ_CAUSE_HOST_SILENCE, all_axes(kernel));
        kernel->host_state = host;
    }
    if (kernel->feedback.late != kernel->late) {
        sj_events_report(kernel, SJ_EVENT_LATE, -1, 0,
                         (double)(kernel->feedback.late - kernel->late));
        kernel->late = kernel->feedback.late;
        sj_react(kernel, SJ_CAUSE_OVERRUN, all_axes(kernel));
    }
    if (kernel->ending && !kernel->ended) {
        sj_react_stop_homing(kernel, all_axes(kernel));
        sj_react_halt(kernel, all_axes(kernel));
    }
    kernel->ended += kernel->ending && kernel->ended < INT32_MAX;
    kernel->feedback.ending = kernel->ending;
}
