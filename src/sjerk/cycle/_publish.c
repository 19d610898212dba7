/* Publishing: the feedback of a cycle.
 *
 * Never here: decisions, the trace's frame (_trace.c).
 */
#include <math.h> /* fabs */
#include <stdint.h>
#include "cycle/_motion.h"
#include "cycle/_publish.h"
#include "dpram/_dpram.h"

static void keep_peak(double *peak, double x)
{
    if (fabs(x) > *peak)
        *peak = fabs(x);
}

/* The largest magnitudes, and the goal even when it is over. */
static void keep(const sj_axis *ax, sj_axis_feedback *out)
{
    keep_peak(&out->peak_velocity, ax->interpolator.v.hi);
    keep_peak(&out->peak_acceleration, ax->interpolator.a.hi);
    keep_peak(&out->peak_jerk, ax->interpolator.j.hi);
    if (ax->goal.kind == SJ_GOAL_ABSOLUTE)
        out->goal = ax->goal.goal;
}

/* What may be another in every cycle; levels and limits are written where they are taken. */
static void report(const sj_kernel *kernel, int32_t i, sj_axis_feedback *out)
{
    const sj_axis *ax = &kernel->axis[i];
    const sj_interpolator *ip = &ax->interpolator;
    const sj_drive_tx *tx = &kernel->tx[i];
    out->position = ip->q.hi;
    out->velocity = ip->v.hi;
    out->acceleration = ip->a.hi;
    out->jerk = ip->j.hi;
    out->actual_position = (double)ax->actual_counts / ax->config.counts_per_unit;
    out->actual_velocity =
        tx->velocity_actual * kernel->feedback.cycle_time_s / ax->config.counts_per_unit;
    out->goal_id = ax->goal_id;
    out->target_counts = ax->target_counts;
    out->actual_counts = ax->actual_counts;
    out->following_error = tx->following_error;
    out->statusword = tx->statusword;
    out->error_code = tx->error_code;
    out->digital_inputs = tx->digital_inputs;
    out->velocity_offset = kernel->rx[i].velocity_offset;
    out->torque_offset = kernel->rx[i].torque_offset;
    out->moving = ax->homing || ax->homed || (ax->following && (axis_moving(ax) || ax->held));
    out->settled = ax->reached;
    out->follows = ax->following;
    out->enabled = sj_master_enabled(tx->statusword);
    out->fault = sj_master_fault(tx->statusword);
    out->state = ax->state;
}

void sj_publish_keep(sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        keep(&kernel->axis[i], &kernel->feedback.axis[i]);
}

void sj_publish(sj_kernel *kernel)
{
    sj_feedback *feedback = &kernel->feedback;
    for (int32_t i = 0; i < kernel->axes; i++)
        report(kernel, i, &feedback->axis[i]);
    feedback->override = kernel->override;
    feedback->hold = kernel->hold;
    feedback->kernel_epoch = sj_shm_kernel_epoch(kernel->segment);
    sj_shm_beat_kernel(kernel->segment, feedback->time_ns);
    sj_feedback_publish(kernel->segment,
                        kernel->own_loop ? (const void *)&feedback->cycle : feedback);
}
