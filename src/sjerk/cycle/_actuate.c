/* Actuating: the commanded samples as increments, what is fed forward, and the controlwords, to the drives;
 * those that are simulated run their period.
 *
 * Never here: where an axis should be, bit masks of drives but homing's start and the quick stop.
 */
#include <math.h> /* fabs, llround */
#include <stdint.h>
#include "cycle/_actuate.h"
#include "cycle/_feed_forward.h"
#include "cycle/_motion.h"
#include "drive/_drive.h"

static const double SETTLED = 1e-3; /* of the velocity limit: the motor is at rest */

/* Whether the motor still moves where the command is at rest already: without current it would coast.
 * Still for 20 ms, so that a turning point is no rest; asked for a second at most. */
static int32_t settling(const sj_kernel *kernel, sj_axis *ax, int32_t i)
{
    double T = kernel->feedback.cycle_time_s;
    double counts = fabs(kernel->tx[i].velocity_actual * T);
    double least = SETTLED * ax->config.limits.velocity * ax->config.counts_per_unit;
    ax->resting = axis_moving(ax) ? 0 : ax->resting + (ax->resting < INT32_MAX);
    ax->still = counts > least ? 0 : ax->still + (ax->still < INT32_MAX);
    return ax->still * T < 0.02 && ax->resting * T < 1.0;
}

/* A drive is disabled only at rest, its motor's too. In ErrorStop none is switched on: one that lost its
 * power or its link and comes back stays without current until somebody resets the axis. */
static int32_t wanted(const sj_kernel *kernel, sj_axis *ax, int32_t i)
{
    int32_t settles = settling(kernel, ax, i);
    int32_t allowed =
        ax->state != SJ_AXIS_ERROR_STOP || sj_master_enabled(kernel->tx[i].statusword);
    return (ax->enable && !kernel->ending && allowed) ||
           (ax->following && (axis_moving(ax) || settles));
}

static void send(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    sj_drive_rx *rx = &kernel->rx[i];
    double counts = ax->interpolator.q.hi * ax->config.counts_per_unit;

    if (ax->following)
        ax->target_counts = llround(counts);
    else if (!ax->config.external ||
             !kernel->stale[i]) /* else the last one: a frozen 6064h is none */
        ax->target_counts = ax->actual_counts;
    rx->mode = ax->homing ? SJ_MODE_HOMING : SJ_MODE_CSP;
    rx->controlword =
        sj_master_controlword(kernel->tx[i].statusword, wanted(kernel, ax, i), ax->reset == 1);
    if (ax->homing) {
        if (kernel->tx[i].mode_display == SJ_MODE_HOMING)
            rx->controlword |= SJ_CW_MODE_4;
        ax->homing += ax->homing <= HOMING_SETTLES && (rx->controlword & SJ_CW_MODE_4);
    }
    if (ax->drive_stop)
        rx->controlword = (uint16_t)(rx->controlword & ~SJ_CW_QUICK_STOP);
    rx->target_position = (int32_t)(uint32_t)(uint64_t)ax->target_counts; /* the counter wraps */
    if (ax->reset > 0)
        ax->reset--;
}

/* The drives that are simulated get what has been sent. */
static void simulate(sj_kernel *kernel)
{
    sj_drive *drives[SJ_AXES];
    const sj_drive_rx *rx[SJ_AXES];
    sj_drive_tx *tx[SJ_AXES];
    int32_t n = 0;
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        if (ax->config.ideal) {
            sj_ideal_cycle(&ax->drive, &kernel->rx[i], &kernel->tx[i]);
        } else if (!ax->config.external) {
            drives[n] = &ax->drive;
            rx[n] = &kernel->rx[i];
            tx[n++] = &kernel->tx[i];
        }
    }
    sj_drive_cycles(drives, rx, tx, n);
}

void sj_actuate(sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++) {
        send(kernel, i);
        sj_feed_forward_send(kernel, i);
    }
    simulate(kernel);
}
