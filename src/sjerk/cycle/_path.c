/* The path in play: records of the ring become its segments, its positions those of its axes.
 *
 * One path at a time, from rest at its first way-point. Pause, hold and speed act on its feed; a halt
 * is a stop on the path, a quick stop leaves it, a goal for one of its axes takes that axis away, and
 * the others come to rest on the path. It ends on its last way-point, at rest on the path, or left.
 *
 * Never here: positions along the path (_track.c), its feed (_pace.c), drives, memory of its own.
 */
#include <float.h> /* DBL_EPSILON */
#include <math.h>  /* fabs, floor, fmax, fmin */
#include <stddef.h>
#include <stdint.h>
#include "base/_double_double.h"
#include "cycle/_axis.h"
#include "cycle/_events.h"
#include "cycle/_motion.h"
#include "cycle/_path.h"

/* How far off a path may begin: a part of what one cycle of jerk moves, and rounding. */
static const double START = 1e-3, NOISE = 2.0 * DBL_EPSILON;

/* ---- records --------------------------------------------------------------------------------- */

/* Whole turns from a position to where an axis that wraps is: the nearest, of two the one ahead. */
static sj_exact turn_of(const sj_axis *ax, double position)
{
    double wrap = ax->config.wrap, turns;
    if (!(wrap > 0.0))
        return exact_of(0.0);
    turns = floor((ax->interpolator.q.hi - position) / wrap + 0.5);
    return turns == 0.0 ? exact_of(0.0) : exact_two_product(turns, wrap);
}

static double turned(double position, sj_exact turn)
{
    return exact_add(exact_of(position), turn).hi;
}

static int32_t judge(const sj_kernel *kernel, const sj_record *record, int32_t axis)
{
    const sj_axis *ax = &kernel->axis[axis];
    double at;
    if (sj_axis_next(ax->state, SJ_TRIGGER_SYNCHRONIZE) < 0)
        return ax->following || ax->error || ax->state == SJ_AXIS_HOMING ? SJ_RESULT_STATE
                                                                         : SJ_RESULT_NOT_FOLLOWING;
    if (!ax->following || !ax->enable)
        return SJ_RESULT_NOT_FOLLOWING;
    at = record->axis[axis].position;
    at = turned(at, turn_of(ax, at));
    if (!(fabs(at - ax->interpolator.q.hi) <=
          START * ax->config.limits.jerk + NOISE * fabs(ax->interpolator.q.hi)))
        return SJ_RESULT_START;
    return SJ_RESULT_ACCEPTED;
}

static sj_track_limits limits_of(const sj_axis *ax)
{
    const sj_axis_config *config = &ax->config;
    const sj_limits *own = &config->limits;
    double acceleration = fmin(own->acceleration, own->deceleration);
    double jerk = fmin(own->jerk, own->deceleration_jerk);
    return (sj_track_limits){own->velocity,        acceleration, jerk, config->position_min,
                             config->position_max, acceleration, jerk};
}

/* A path opens: its axes are at rest on its first way-point. */
static int32_t open(sj_kernel *kernel, sj_waiting *waiting)
{
    sj_path *path = &kernel->path;
    double position[SJ_AXES];
    sj_track_limits limits[SJ_AXES];

    for (int32_t i = 0; i < kernel->axes; i++)
        if (waiting->axes & axis_bit(i)) {
            const sj_axis *ax = &kernel->axis[i];
            if (ax->following && (axis_moving(ax) || ax->held))
                return OFFER_WAIT;
        }
    if (path->axes != 0)
        return OFFER_WAIT;
    if (path->newest < waiting->record.goal_id)
        path->newest = waiting->record.goal_id;
    for (int32_t i = 0; i < kernel->axes; i++)
        if (waiting->axes & axis_bit(i)) {
            int32_t result = judge(kernel, &waiting->record, i);
            if (result != SJ_RESULT_ACCEPTED) {
                waiting->refused = i;
                return -result;
            }
        }
    path->goal_id = path->root = waiting->record.goal_id;
    path->axes = waiting->axes;
    path->cancelled = path->count = 0;
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        sj_axis_feedback *out = &kernel->feedback.axis[i];
        if ((waiting->axes & axis_bit(i)) == 0)
            continue;
        path->turn[path->count] = turn_of(ax, waiting->record.axis[i].position);
        position[path->count] = turned(waiting->record.axis[i].position, path->turn[path->count]);
        limits[path->count] = limits_of(ax);
        path->axis[path->count++] = i;
        ax->goal_id = path->goal_id;
        ax->goal.kind = SJ_GOAL_NONE;
        ax->held = 1;
        ax->reached = 0;
        out->peak_velocity = out->peak_acceleration = out->peak_jerk = 0.0;
        sj_events_trigger(kernel, i, SJ_TRIGGER_SYNCHRONIZE);
    }
    sj_track_begin(&path->player.track, path->count, position, limits);
    sj_player_begin(&path->player);
    kernel->feedback.path = (sj_path_feedback){path->goal_id, path->axes,        1, 0, 0.0, 0.0,
                                               SJ_PATH_NONE,  SJ_RESULT_ACCEPTED};
    return OFFER_TAKEN;
}

/* Another path takes over from a place that this one has not come to. */
static int32_t splice(sj_kernel *kernel, const sj_waiting *waiting)
{
    sj_path *path = &kernel->path;
    uint64_t axes = kernel->feedback.path.axes;
    if (path->newest < waiting->record.goal_id)
        path->newest = waiting->record.goal_id;
    if (path->axes != axes || path->cancelled || waiting->axes != axes ||
        waiting->record.number > SJ_CYCLES_MAX ||
        sj_player_cut(&path->player, (int64_t)waiting->record.number, waiting->record.cycles[0]) !=
            0)
        return -SJ_RESULT_BEGUN;
    path->goal_id = waiting->record.goal_id;
    for (int32_t k = 0; k < path->count; k++)
        kernel->axis[path->axis[k]].goal_id = path->goal_id;
    kernel->feedback.path.goal_id = path->goal_id;
    return OFFER_TAKEN;
}

static int32_t add(sj_kernel *kernel, const sj_record *record)
{
    static const int32_t result_of[] = {
        [SJ_TRACK_ORDER] = SJ_RESULT_SEGMENT,  [SJ_TRACK_LENGTH] = SJ_RESULT_SEGMENT,
        [SJ_TRACK_NUMBER] = SJ_RESULT_SEGMENT, [SJ_TRACK_BROKEN] = SJ_RESULT_SEGMENT,
        [SJ_TRACK_LIMIT] = SJ_RESULT_LIMITS,   [SJ_TRACK_POSITION] = SJ_RESULT_LIMIT};
    sj_path *path = &kernel->path;
    sj_track_axis axis[SJ_AXES];
    int32_t status;

    if (record->goal_id > path->newest)
        return -SJ_RESULT_KIND;
    if (record->goal_id != path->goal_id || path->axes == 0 || path->cancelled)
        return OFFER_TAKEN; /* of a path that is over */
    for (int32_t k = 0; k < path->count; k++) {
        const sj_axis_record *in = &record->axis[path->axis[k]];
        axis[k] = (sj_track_axis){turned(in->position, path->turn[k]),
                                  in->velocity,
                                  in->acceleration,
                                  in->last_jerk,
                                  {in->jerk[0], in->jerk[1], in->jerk[2], in->jerk[3]}};
    }
    status = record->number > SJ_CYCLES_MAX
                 ? SJ_TRACK_ORDER
                 : sj_track_add(&path->player.track, (int64_t)record->number, record->cycles,
                                record->last, axis);
    if (status == SJ_TRACK_OK)
        return OFFER_TAKEN;
    if (status == SJ_TRACK_FULL)
        return OFFER_WAIT;
    kernel->feedback.path.result = result_of[status];
    path->cancelled = 1;
    return -result_of[status];
}

int32_t sj_path_offer(sj_kernel *kernel, sj_waiting *waiting)
{
    if (waiting->record.kind == SJ_RECORD_SEGMENT)
        return add(kernel, &waiting->record);
    return waiting->record.number == 0 ? open(kernel, waiting) : splice(kernel, waiting);
}

/* ---- stops, and who takes over --------------------------------------------------------------- */

void sj_path_hand_over(sj_kernel *kernel, int32_t axis)
{
    const sj_path *path = &kernel->path;
    if ((path->axes & axis_bit(axis)) == 0 || !kernel->axis[axis].following)
        return; /* one that does not follow is where its drive is */
    for (int32_t k = 0; k < path->count; k++)
        if (path->axis[k] == axis) {
            const sj_track_limits *kept = &path->player.track.limits[k];
            sj_axis *ax = &kernel->axis[axis];
            sj_state sample;
            double jerk;
            sj_player_hand_over(&path->player, k, &sample, &jerk);
            sj_interpolator_start(&ax->interpolator, &sample);
            ax->interpolator.j = exact_of(jerk);
            /* whatever became of the axis' own since the path began */
            ax->ceiling = (sj_limits){kept->velocity, kept->acceleration, kept->jerk,
                                      kept->acceleration, kept->jerk};
            sj_axis_ceiling(ax);
        }
}

void sj_path_release(sj_kernel *kernel, uint64_t axes)
{
    sj_path *path = &kernel->path;
    if ((path->axes & axes) == 0)
        return;
    path->axes &= ~axes;
    path->cancelled = 1;
    if (path->axes == 0)
        sj_events_path(kernel, SJ_PATH_LEFT);
}

uint64_t sj_path_halt(sj_kernel *kernel, uint64_t axes)
{
    sj_path *path = &kernel->path;
    uint64_t driven = path->axes;
    if ((axes & driven) == 0)
        return 0;
    path->cancelled = 1;
    for (int32_t k = 0; k < path->count; k++)
        if (driven & axis_bit(path->axis[k]))
            sj_events_trigger(kernel, path->axis[k], SJ_TRIGGER_HALT);
    return driven;
}

/* All its axes go on by themselves, each from its state on the path. */
static uint64_t let_go(sj_kernel *kernel)
{
    uint64_t driven = kernel->path.axes;
    for (int32_t i = 0; i < kernel->axes; i++)
        if (driven & axis_bit(i)) {
            sj_path_hand_over(kernel, i);
            kernel->axis[i].held = 0;
        }
    sj_path_release(kernel, driven);
    return driven;
}

uint64_t sj_path_leave(sj_kernel *kernel, uint64_t axes)
{
    return axes & kernel->path.axes ? let_go(kernel) & ~axes : 0;
}

/* ---- one cycle ------------------------------------------------------------------------------- */

/* 0 .. 2; 1 is the path as it was planned. */
static double commanded_feed(const sj_kernel *kernel)
{
    const sj_path_command *command = &kernel->command.path;
    double feed = kernel->override;
    if (kernel->path.cancelled || kernel->hold)
        return 0.0;
    if (command->goal_id != kernel->path.root)
        return feed;
    if (command->pause || !(command->speed >= 0.0))
        return 0.0;
    return fmin(feed * command->speed, 2.0);
}

static void end(sj_kernel *kernel, int32_t state)
{
    sj_path *path = &kernel->path;
    for (int32_t k = 0; k < path->count; k++) {
        sj_axis *ax = &kernel->axis[path->axis[k]];
        if ((path->axes & axis_bit(path->axis[k])) == 0)
            continue;
        sj_interpolator_start(&ax->interpolator,
                              &(sj_state){path->player.run.past[0][k], 0.0, 0.0});
        ax->held = 0;
        ax->reached = state == SJ_PATH_DONE && !path->cancelled;
    }
    path->axes = 0;
    sj_events_path(kernel, state);
}

static void put_samples(sj_kernel *kernel)
{
    sj_path *path = &kernel->path;
    const sj_player *player = &path->player;
    for (int32_t k = 0; k < path->count; k++) {
        sj_interpolator *ip = &kernel->axis[path->axis[k]].interpolator;
        if ((path->axes & axis_bit(path->axis[k])) == 0)
            continue;
        sj_interpolator_start(
            ip, &(sj_state){player->run.past[0][k], player->velocity[k], player->acceleration[k]});
        ip->j = exact_of(player->jerk[k]);
    }
}

static void report_place(sj_kernel *kernel)
{
    const sj_player *player = &kernel->path.player;
    const sj_track *track = &player->track;
    sj_path_feedback *out = &kernel->feedback.path;
    double rest;
    int64_t at = sj_player_place(player, &rest), segment = player->run.cursor.segment;
    const sj_track_segment *in;
    out->known = track->number;
    out->speed = fmax(0.0, sj_player_speed(player)); /* of a sample: half a cycle may be less */
    if (!player->begun || segment < track->first)
        return;
    in = &track->segment[segment % track->capacity];
    out->number = in->number;
    out->cycle = (double)(at - in->begin) + rest;
}

uint64_t sj_path_watch(sj_kernel *kernel)
{
    const sj_path *path = &kernel->path;
    const sj_path_command *command = &kernel->command.path;
    for (int32_t k = 0; k < path->count && path->axes != 0; k++)
        if (!kernel->axis[path->axis[k]].following)
            sj_path_release(kernel, axis_bit(path->axis[k]));
    return command->goal_id == path->root && command->cancel && !path->cancelled ? path->axes : 0;
}

uint64_t sj_path_step(sj_kernel *kernel)
{
    sj_path *path = &kernel->path;
    sj_player *player = &path->player;
    int32_t status;

    if (path->axes == 0)
        return 0;
    player->wish = commanded_feed(kernel);
    status = sj_player_step(player);
    report_place(kernel);
    if (status == SJ_PACE_LOST)
        return let_go(kernel);
    put_samples(kernel);
    if (status == SJ_PACE_DONE)
        end(kernel, SJ_PATH_DONE);
    else if (path->cancelled && status == SJ_PACE_RESTS && player->rests >= 3)
        end(kernel, SJ_PATH_STOPPED);
    else if (path->cancelled)
        sj_events_path(kernel, SJ_PATH_STOPS);
    else if (status == SJ_PACE_STARVES && player->begun)
        sj_events_path(kernel, SJ_PATH_STARVES);
    else if (player->begun || status == SJ_PACE_RESTS)
        sj_events_path(kernel, status == SJ_PACE_RESTS && player->wish == 0.0 ? SJ_PATH_PAUSED
                                                                              : SJ_PATH_RUNS);
    return 0;
}
