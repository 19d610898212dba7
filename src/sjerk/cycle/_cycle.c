/* One cycle of the kernel, top to bottom in the order of the data: observe the drives, collect the
 * command, watch, plan (_goals.c, _stops.c), interpolate, drive, publish.
 *
 * Never here: equations, time, memory of its own, bit masks of drives.
 */
#include <math.h>   /* llround, isfinite */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of a command */
#include "_cycle.h"

static const double SETTLED = 1e-3; /* of the velocity limit: the motor rests */

enum { HOMING_SETTLES = 4 }; /* cycles until a drive's answer is about this homing, not the last */

uint64_t sj_command_bytes(int32_t axes)
{
    return offsetof(sj_command, axis) + (uint64_t)axes * sizeof(sj_axis_command);
}

uint64_t sj_feedback_bytes(int32_t axes)
{
    return offsetof(sj_feedback, axis) + (uint64_t)axes * sizeof(sj_axis_feedback);
}

uint64_t sj_feedback_times(void)
{
    return offsetof(sj_feedback, cycle);
}

/* 0, or -1: the number of axes is out of range. Then every axis must be set. */
int32_t sj_kernel_init(sj_kernel *kernel, void *segment, int32_t axes, double cycle_time_s)
{
    if (axes < 1 || axes > SJ_AXES)
        return -1;
    *kernel = (sj_kernel){0};
    kernel->segment = segment;
    kernel->axes = axes;
    kernel->override = 1.0;
    sj_ahead_start(&kernel->ahead);
    kernel->reaction[SJ_CAUSE_HOST_DEATH] = SJ_REACT_HALT;
    kernel->reaction[SJ_CAUSE_HOST_SILENCE] = SJ_REACT_HALT;
    kernel->reaction[SJ_CAUSE_DRIVE_FAULT] = SJ_REACT_HALT;
    kernel->reaction[SJ_CAUSE_FOLLOWING_ERROR] = SJ_REACT_QUICK_STOP;
    kernel->reaction[SJ_CAUSE_SPOILT] = SJ_REACT_HALT;
    kernel->reaction[SJ_CAUSE_SYNC_LOST] = SJ_REACT_HALT;
    kernel->feedback.axes = axes;
    kernel->feedback.result_axis = -1;
    kernel->feedback.cycle_time_s = cycle_time_s;
    return 0;
}

/* As sj_drive_init. */
int32_t sj_kernel_axis(sj_kernel *kernel, int32_t axis, const sj_drive_config *drive,
                       const sj_axis_config *config)
{
    sj_axis *ax = &kernel->axis[axis];
    sj_axis_feedback *out = &kernel->feedback.axis[axis];
    ax->config = *config;
    ax->ceiling = config->limits;
    if (config->ideal) {
        ax->drive = (sj_drive){.state = SJ_STATE_SWITCH_ON_DISABLED};
        ax->drive.config.period_s = kernel->feedback.cycle_time_s;
        sj_ideal_cycle(&ax->drive, &kernel->rx[axis], &kernel->tx[axis]);
    } else if (!config->external) {
        int32_t status = sj_drive_init(&ax->drive, drive);
        if (status != 0)
            return status;
        sj_drive_cycle(&ax->drive, &kernel->rx[axis], &kernel->tx[axis]);
    }
    ax->actual_counts = kernel->tx[axis].position_actual;
    sj_interpolator_start(&ax->interpolator,
                          &(sj_state){(double)ax->actual_counts / config->counts_per_unit, 0.0, 0.0});
    out->limits = config->limits;
    out->position_min = config->position_min;
    out->position_max = config->position_max;
    out->counts_per_unit = config->counts_per_unit;
    out->wrap = config->wrap;
    out->external = config->external;
    memcpy(out->unit, config->unit, sizeof out->unit);
    return 0;
}

/* ---- events, states, reactions ---- */

void sj_cycle_tell(sj_kernel *kernel, int32_t kind, int32_t axis, int32_t code, double value)
{
    sj_kernel_event event = {kernel->feedback.cycle + 1, kernel->feedback.time_ns,
                             axis >= 0 ? kernel->axis[axis].goal_id : kernel->goal_id, value,
                             kind, axis, code, 0};
    sj_trace_event(kernel, &event);
}

int32_t sj_cycle_trigger(sj_kernel *kernel, int32_t axis, int32_t trigger)
{
    sj_axis *ax = &kernel->axis[axis];
    int32_t next = sj_axis_next(ax->state, trigger), before = ax->state;
    if (next < 0)
        return -1;
    ax->state = next;
    if (next != before)
        sj_cycle_tell(kernel, SJ_EVENT_STATE, axis, next, before);
    return 0;
}

void sj_cycle_answer(sj_kernel *kernel, uint64_t goal_id, int32_t axis, int32_t result)
{
    sj_kernel_event event = {kernel->feedback.cycle + 1, kernel->feedback.time_ns, goal_id, 0.0,
                             SJ_EVENT_GOAL, axis, result, 0};
    sj_trace_event(kernel, &event);
}

void sj_cycle_reached(sj_kernel *kernel, uint64_t goal_id)
{
    sj_kernel_event event = {kernel->feedback.cycle + 1, kernel->feedback.time_ns, goal_id, 0.0,
                             SJ_EVENT_REACHED, -1, 0, 0};
    sj_trace_event(kernel, &event);
}

uint64_t sj_cycle_all(const sj_kernel *kernel)
{
    return kernel->axes == 64 ? UINT64_MAX : (UINT64_C(1) << kernel->axes) - 1;
}

void sj_cycle_react(sj_kernel *kernel, int32_t cause, uint64_t axes)
{
    if (kernel->reaction[cause] == SJ_REACT_HALT)
        sj_stop_halt(kernel, axes);
    else if (kernel->reaction[cause] == SJ_REACT_QUICK_STOP)
        sj_stop_quick(kernel, axes, 0);
}

/* ---- observe ---- */

/* The command becomes the actual position, at rest. */
static void anchor(sj_axis *ax)
{
    sj_state actual = {(double)ax->actual_counts / ax->config.counts_per_unit, 0.0, 0.0};
    sj_interpolator_start(&ax->interpolator, &actual);
    ax->goal.kind = SJ_GOAL_NONE;
    ax->parked = ax->reached = ax->onward = 0;
}

static void observe_homing(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    int32_t outcome = sj_master_homing(&kernel->tx[i]);
    if (ax->homing <= HOMING_SETTLES || outcome == 0)
        return;
    if (outcome < 0)
        sj_cycle_tell(kernel, SJ_EVENT_FAULT, i, -1, 0.0);
    ax->reached = outcome > 0;
    ax->homing = 0;
}

static void observe(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    const sj_drive_tx *tx = &kernel->tx[i];
    uint32_t change = (uint32_t)tx->position_actual - (uint32_t)ax->actual_counts;
    int32_t followed = ax->following, stale = ax->config.external && kernel->stale[i];
    int32_t fault = sj_master_fault(tx->statusword) || stale;
    int32_t homed = ax->reached && ax->state == SJ_AXIS_HOMING;

    ax->actual_counts += (int32_t)change;
    ax->following = sj_master_follows_position(tx) && !stale;
    if (!ax->following) {
        if (followed)
            sj_ahead_stop(kernel, UINT64_C(1) << i);
        if (followed && axis_moving(ax))
            sj_cycle_tell(kernel, SJ_EVENT_ANCHOR, i, tx->statusword, 0.0);
        anchor(ax);
        ax->reached = homed;
    }
    if (ax->drive_stop && !sj_master_enabled(tx->statusword) && !sj_master_stopping(tx->statusword))
        ax->drive_stop = 0;
    if (ax->homing && sj_master_enabled(tx->statusword))
        observe_homing(kernel, i);
    ax->error |= stale; /* its drive may go on as if nothing had been: until a reset */
    if (fault && ax->state != SJ_AXIS_ERROR_STOP) {
        int32_t lost = stale || sj_master_lost(tx->error_code);
        sj_cycle_tell(kernel, lost ? SJ_EVENT_SYNC : SJ_EVENT_FAULT, i, stale ? 0 : tx->error_code,
                      0.0);
        sj_cycle_trigger(kernel, i, SJ_TRIGGER_FAULT);
        ax->homing = 0;
        sj_cycle_react(kernel, lost ? SJ_CAUSE_SYNC_LOST : SJ_CAUSE_DRIVE_FAULT,
                       sj_cycle_all(kernel) & ~(UINT64_C(1) << i));
    }
    if (!fault && !ax->error && ax->state == SJ_AXIS_ERROR_STOP)
        sj_cycle_trigger(kernel, i, SJ_TRIGGER_RESET);
    if (ax->following && ax->state == SJ_AXIS_DISABLED)
        sj_cycle_trigger(kernel, i, SJ_TRIGGER_POWER_ON);
    if (!ax->following && !(ax->state == SJ_AXIS_HOMING && sj_master_enabled(tx->statusword)))
        sj_cycle_trigger(kernel, i, SJ_TRIGGER_POWER_OFF);
    if (ax->following && !ax->homing && !axis_moving(ax) && !ax->parked &&
        ax->state > SJ_AXIS_STANDSTILL)
        sj_cycle_trigger(kernel, i, SJ_TRIGGER_DONE);
}

/* ---- collect ---- */

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
        sj_goal_ceiling(ax);
    }
    sj_cycle_tell(kernel, SJ_EVENT_LIMITS, i, result, 0.0);
}

/* A homing drive is stopped by its own quick stop: the planner does not lead it. */
static void stop_homing(sj_kernel *kernel, uint64_t axes, int32_t trigger)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        if ((axes >> i & 1) && kernel->axis[i].homing) {
            sj_cycle_trigger(kernel, i, trigger);
            kernel->axis[i].homing = 0;
            kernel->axis[i].drive_stop = 1;
        }
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
    kernel->ahead.stop = kernel->command.stop_records;
    sj_ahead_stop(kernel, halts | quick_stops | disabled);
    stop_homing(kernel, halts | quick_stops, SJ_TRIGGER_HALT);
    sj_stop_halt(kernel, halts & ~quick_stops);
    sj_stop_quick(kernel, quick_stops, together);
    return (halts | quick_stops) != 0;
}

static void take_override(sj_kernel *kernel)
{
    double override = kernel->command.override;
    int32_t hold = kernel->command.hold != 0;
    if (!(override >= 0.0 && override <= 2.0))
        override = kernel->override;
    double planned = kernel->override;
    if (override == planned && hold == kernel->hold)
        return;
    kernel->override = override;
    kernel->hold = hold;
    sj_goal_again(kernel, planned);
}

/* Edges are counters: each is acted on once, whatever was overwritten in between. */
static void collect(sj_kernel *kernel)
{
    sj_command *command = &kernel->command;
    int32_t stopped = kernel->ending;
    int32_t fresh = sj_trace_collect(kernel);

    if (fresh < 0) {
        kernel->feedback.corrupt++;
        sj_cycle_tell(kernel, SJ_EVENT_SPOILT, -1, fresh, 0.0);
        sj_cycle_react(kernel, SJ_CAUSE_SPOILT, sj_cycle_all(kernel));
    } else if (fresh == 1) {
        memcpy(command, &kernel->incoming, sj_command_bytes(kernel->axes));
        stopped |= take_axes(kernel);
        if (command->cancels != kernel->cancels)
            sj_ahead_drop(kernel, command->cancel_axes, command->cancel_from, command->cancel_to,
                          SJ_RESULT_SUPERSEDED);
        kernel->cancels = command->cancels;
        take_override(kernel);
        if (command->goal_id != kernel->goal_id)
            sj_goal_take(kernel, stopped);
        kernel->feedback.sequence = command->sequence;
    }
}

/* ---- watch ---- */

static void watch_following(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    double error;
    if (!ax->following || ax->error || isinf(ax->config.following_limit))
        return;
    error = (double)(ax->target_counts - ax->actual_counts) / ax->config.counts_per_unit;
    if (fabs(error) <= ax->config.following_limit)
        return;
    sj_cycle_tell(kernel, SJ_EVENT_FOLLOWING, i, 0, error);
    sj_cycle_react(kernel, SJ_CAUSE_FOLLOWING_ERROR, sj_cycle_all(kernel));
    if (kernel->reaction[SJ_CAUSE_FOLLOWING_ERROR] != SJ_REACT_NONE) {
        ax->error = 1;
        sj_cycle_trigger(kernel, i, SJ_TRIGGER_FAULT);
    }
}

static void watch(sj_kernel *kernel, uint64_t now_ns)
{
    int32_t host = sj_trace_host(kernel, now_ns);
    if (host != kernel->host_state) { /* once; the next host may move on */
        sj_cycle_tell(kernel, SJ_EVENT_HOST, -1, host, kernel->host_state);
        if (host == SJ_HOST_DEAD)
            sj_cycle_react(kernel, SJ_CAUSE_HOST_DEATH, sj_cycle_all(kernel));
        else if (host == SJ_HOST_SILENT)
            sj_cycle_react(kernel, SJ_CAUSE_HOST_SILENCE, sj_cycle_all(kernel));
        kernel->host_state = host;
    }
    if (kernel->feedback.late != kernel->late) {
        sj_cycle_tell(kernel, SJ_EVENT_LATE, -1, 0, (double)(kernel->feedback.late - kernel->late));
        kernel->late = kernel->feedback.late;
        sj_cycle_react(kernel, SJ_CAUSE_OVERRUN, sj_cycle_all(kernel));
    }
    if (kernel->ending && !kernel->ended) {
        kernel->ended = 1;
        stop_homing(kernel, sj_cycle_all(kernel), SJ_TRIGGER_HALT);
        sj_stop_halt(kernel, sj_cycle_all(kernel));
    }
    kernel->feedback.ending = kernel->ending;
}

/* ---- interpolate, drive ---- */

/* Whether the motor still moves where the command rests already: without current it would coast.
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

/* A drive is disabled only at rest, its motor's too. */
static int32_t wanted(const sj_kernel *kernel, sj_axis *ax, int32_t i)
{
    int32_t settles = settling(kernel, ax, i);
    return (ax->enable && !kernel->ending) || (ax->following && (axis_moving(ax) || settles));
}

static void send(sj_kernel *kernel, int32_t i)
{
    sj_axis *ax = &kernel->axis[i];
    sj_drive_rx *rx = &kernel->rx[i];
    double counts = ax->interpolator.q.hi * ax->config.counts_per_unit;

    ax->target_counts = ax->following ? llround(counts) : ax->actual_counts;
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

static void keep_peak(double *peak, double x)
{
    if (fabs(x) > *peak)
        *peak = fabs(x);
}

/* What needs every cycle, whoever reads: the largest magnitudes, and the goal even when it is over. */
static void keep(const sj_axis *ax, sj_axis_feedback *out)
{
    keep_peak(&out->peak_velocity, ax->interpolator.v.hi);
    keep_peak(&out->peak_acceleration, ax->interpolator.a.hi);
    keep_peak(&out->peak_jerk, ax->interpolator.j.hi);
    if (ax->goal.kind == SJ_GOAL_ABSOLUTE)
        out->goal = ax->goal.goal;
}

/* What may be another in every cycle; levels and limits are told where they are taken. */
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
    out->moving = ax->homing || (ax->following && (axis_moving(ax) || ax->parked));
    out->settled = ax->reached;
    out->follows = ax->following;
    out->enabled = sj_master_enabled(tx->statusword);
    out->fault = sj_master_fault(tx->statusword);
    out->state = ax->state;
}

/* Loops of their own: the processor works at several axes at once where each waits for its sums. */
static void interpolate(sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        if (ax->following && ((kernel->path.led | kernel->paced.axes) >> i & 1) == 0) {
            int32_t ahead = ax->interpolator.ahead > 0;
            sj_interpolator_step(&ax->interpolator);
            if (ahead)
                sj_goal_reached(kernel, i);
        }
    }
}

static void publish(sj_kernel *kernel)
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

/* Top to bottom in the order of the data. now_ns: the begin of the cycle, any monotonic clock. */
void sj_kernel_cycle(sj_kernel *kernel, uint64_t now_ns)
{
    kernel->feedback.time_ns = now_ns;
    sj_ahead_see(kernel);
    for (int32_t i = 0; i < kernel->axes; i++)
        observe(kernel, i);
    for (int32_t i = 0; i < kernel->axes; i++)
        watch_following(kernel, i);
    watch(kernel, now_ns);
    collect(kernel);
    sj_ahead_take(kernel);
    sj_path_step(kernel);
    sj_paced_step(kernel);
    interpolate(kernel);
    for (int32_t i = 0; i < kernel->axes; i++)
        send(kernel, i);
    simulate(kernel);
    for (int32_t i = 0; i < kernel->axes; i++)
        keep(&kernel->axis[i], &kernel->feedback.axis[i]);
    kernel->feedback.cycle++;
    sj_trace_close(kernel);
    if (!kernel->quiet)
        publish(kernel);
}

void sj_kernel_step(sj_kernel *kernel)
{
    sj_kernel_cycle(kernel, 0);
}

void sj_kernel_cycles(sj_kernel *kernel, int64_t cycles)
{
    while (cycles-- > 0)
        sj_kernel_cycle(kernel, 0);
}

int32_t sj_kernel_at_rest(const sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        if ((kernel->axis[i].following && axis_moving(&kernel->axis[i])) ||
            (sj_master_enabled(kernel->tx[i].statusword) && !kernel->axis[i].config.external))
            return 0;
    return 1;
}
