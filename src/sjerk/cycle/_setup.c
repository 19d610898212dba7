/* Setting up: a kernel and its axes before the first cycle.
 *
 * Never here: what happens in a cycle.
 */
#include <math.h> /* llround */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of texts */
#include "cycle/_cycle.h"
#include "cycle/_lookahead.h"
#include "drive/_drive.h"

int32_t sj_kernel_init(sj_kernel *kernel, void *segment, int32_t axes, double cycle_time_s)
{
    if (axes < 1 || axes > SJ_AXES)
        return -1;
    *kernel = (sj_kernel){0};
    kernel->segment = segment;
    kernel->axes = axes;
    kernel->override = 1.0;
    sj_lookahead_start(&kernel->lookahead);
    kernel->reaction[SJ_CAUSE_HOST_DEATH] = SJ_REACT_HALT;
    kernel->reaction[SJ_CAUSE_HOST_SILENCE] = SJ_REACT_HALT;
    kernel->reaction[SJ_CAUSE_DRIVE_FAULT] = SJ_REACT_HALT;
    kernel->reaction[SJ_CAUSE_FOLLOWING_ERROR] = SJ_REACT_QUICK_STOP;
    kernel->reaction[SJ_CAUSE_CORRUPT] = SJ_REACT_HALT;
    kernel->reaction[SJ_CAUSE_SYNC_LOST] = SJ_REACT_HALT;
    kernel->feedback.axes = axes;
    kernel->feedback.result_axis = -1;
    kernel->feedback.cycle_time_s = cycle_time_s;
    return 0;
}

int32_t sj_kernel_axis(sj_kernel *kernel, int32_t axis, const sj_drive_config *drive,
                       const sj_axis_config *config)
{
    sj_axis *ax = &kernel->axis[axis];
    sj_axis_feedback *out = &kernel->feedback.axis[axis];
    const int64_t start = llround(config->start * config->counts_per_unit);
    ax->config = *config;
    ax->ceiling = config->limits;
    if (config->ideal) {
        ax->drive = (sj_drive){.state = SJ_STATE_SWITCH_ON_DISABLED};
        ax->drive.config.period_s = kernel->feedback.cycle_time_s;
        kernel->tx[axis].position_actual = (int32_t)start;
        sj_ideal_cycle(&ax->drive, &kernel->rx[axis], &kernel->tx[axis]);
    } else if (!config->external) {
        int32_t status = sj_drive_init(&ax->drive, drive);
        if (status != 0)
            return status;
        sj_drive_place(&ax->drive, start);
        sj_drive_cycle(&ax->drive, &kernel->rx[axis], &kernel->tx[axis]);
    }
    ax->actual_counts = kernel->tx[axis].position_actual;
    sj_interpolator_start(
        &ax->interpolator,
        &(sj_state){(double)ax->actual_counts / config->counts_per_unit, 0.0, 0.0});
    out->limits = config->limits;
    out->position_min = config->position_min;
    out->position_max = config->position_max;
    out->counts_per_unit = config->counts_per_unit;
    out->wrap = config->wrap;
    out->external = config->external;
    memcpy(out->unit, config->unit, sizeof out->unit);
    memcpy(out->name, config->name, sizeof out->name);
    return 0;
}
