/* The feed hold: synchronised moves come to rest on the path that was planned for them, and go on
 * from there, by one feed for all their axes.
 *
 * A hold that gives each axis a stop of its own would bend the path. Here the axes keep their path in
 * joint space: what the interpolators still have before them is laid down as a track, the motion P(s)
 * over the path's own time s, in cycles. The feed s' is planned like any velocity (_pace.c): it goes
 * from 1 to 0, stays there, and goes back to 1 when the hold ends. So
 *
 *   v = P' s'        a = P'' s'^2 + P' s''        j = P''' s'^3 + 3 P'' s' s'' + P' s'''
 *
 * and a change of feed is begun only once the differences of the positions have been checked against
 * the limits of the move, over all of it. What the move itself does beyond these limits, because it
 * began so, it may do under the hold as well.
 *
 * At feed 1, on a whole cycle, the samples are the planned ones bit for bit: the planned
 * interpolators run along, and each takes over where it is, as if no hold had been. Until then
 * velocity, acceleration and jerk of the samples are the differences of their positions.
 *
 * A move can be held so where two axes or more arrive together, at rest, not on a straight line. All
 * others are held by stops of their own (sj_hold_by_stop): a stop of one axis, or one stop for all of
 * a straight line, is on the path anyway. Several moves that a hold finds under way share one feed.
 *
 * Never here: which moves these are (_override.c), how a feed is found (_pace.c), drives, memory of
 * its own.
 */
#include <math.h> /* fabs, fmax, fmin, INFINITY */
#include <stdint.h>
#include "base/_double_double.h"
#include "cycle/_hold.h"
#include "cycle/_motion.h"
#include "cycle/_stops.h"

static const double NOTHING = 1e-9; /* of a limit: neither forward nor backward */

/* ---- the track ------------------------------------------------------------------------------- */

/* The continuous motion of an interpolator at a knot that it has not come to yet. */
typedef struct {
    continuous at;
    sj_exact jerk;        /* of the cycle before */
    int64_t cycles, left; /* gone; to its next knot */
    int32_t leg;
} walker;

static walker walk_from(const sj_interpolator *ip)
{
    walker w = {lemma(ip->q, ip->v, ip->a, ip->j), ip->j, 0, ip->left, ip->leg};
    if (ip->leg >= ip->count)
        w.left = ip->cycles_left;
    return w;
}

/* P += n V + n^2 A/2 + n^3 J/6 and so on, with what is spread over the cycles: n of it in V, and in P
 * n of its own and n (n + 1) / 2 of V's (_continuous.h). */
static void walk(const sj_interpolator *ip, walker *w, int64_t cycles)
{
    double n = (double)cycles;
    sj_exact J = w->leg < ip->count ? ip->legs[w->leg].jerk : exact_of(0.0), sum;
    sum = exact_add(exact_half(w->at.A), exact_scale(exact_divide(J, 6.0), n));
    sum = exact_add(w->at.V, exact_scale(sum, n));
    sum = exact_add(sum, exact_add(ip->spread_q, exact_scale(ip->spread_v, 0.5 * (n + 1.0))));
    w->at.P = exact_add(w->at.P, exact_scale(sum, n));
    sum = exact_add(w->at.A, exact_scale(exact_half(J), n));
    w->at.V = exact_add(w->at.V, exact_scale(exact_add(sum, ip->spread_v), n));
    w->at.A = exact_add(w->at.A, exact_scale(J, n));
    w->jerk = J;
    w->cycles += cycles;
    w->left -= cycles;
    if (w->left == 0 && w->leg < ip->count && ++w->leg < ip->count)
        w->left = ip->legs[w->leg].cycles;
    else if (w->left == 0)
        w->left = ip->cycles_left - w->cycles;
    if (w->cycles >= ip->cycles_left) { /* settled */
        w->at = (continuous){exact_of(ip->goal), exact_of(0.0), exact_of(0.0)};
        w->jerk = exact_of(0.0);
        w->left = INT64_MAX;
    }
}

/* The sample there: q = P - V/2 + A/3 - j/8. */
static double sample_of(const walker *w)
{
    sj_exact q = exact_subtract(w->at.P, exact_half(w->at.V));
    q = exact_add(q, exact_divide(w->at.A, 3.0));
    return exact_subtract(q, exact_scale(w->jerk, 0.125)).hi;
}

/* What a move does by itself it may do at another feed too: a start beyond its limits, say. */
static void allow(sj_track_limits *most, const continuous *from, const continuous *to, double J)
{
    double v0 = from->V.hi, v1 = to->V.hi, a0 = from->A.hi, a1 = to->A.hi;
    double turn = a0 * a1 < 0.0 ? v0 - a0 * a0 / (2.0 * J) : v1, near = NOTHING * most->velocity;
    double up = fmax(0.0, fmax(a0, a1)), down = fmax(0.0, fmax(-a0, -a1));
    int32_t forward = fmax(fmax(v0, v1), turn) > near, backward = fmin(fmin(v0, v1), turn) < -near;
    double drives = fmax(forward ? up : 0.0, backward ? down : 0.0);
    double brakes = fmax(forward ? down : 0.0, backward ? up : 0.0);
    most->velocity = fmax(most->velocity, fmax(fabs(turn), fmax(fabs(v0), fabs(v1))));
    most->acceleration = fmax(most->acceleration, drives);
    most->deceleration = fmax(most->deceleration, brakes);
    if (drives > NOTHING * most->acceleration)
        most->jerk = fmax(most->jerk, fabs(J));
    if (brakes > NOTHING * most->deceleration)
        most->deceleration_jerk = fmax(most->deceleration_jerk, fabs(J));
}

static sj_track_limits limits_of(const sj_axis *ax, double override)
{
    const sj_limits *own = &ax->goal.limits;
    double most = fmax(own->velocity, ax->config.limits.velocity);
    return (sj_track_limits){fmin(own->velocity * override, most),
                             own->acceleration,
                             own->jerk,
                             -INFINITY,
                             INFINITY,
                             own->deceleration,
                             own->deceleration_jerk};
}

/* Segments between the knots of all axes, from where they are to where the last one comes to rest. -1:
 * more than a track holds. */
static int32_t lay_track(sj_feed_hold *hold)
{
    sj_track *track = &hold->player.track;
    walker walkers[SJ_AXES];
    sj_track_axis out[SJ_AXES];
    int64_t left = 0;
    for (int32_t k = 0; k < hold->count; k++) {
        walkers[k] = walk_from(&hold->planned[k]);
        left = hold->planned[k].cycles_left > left ? hold->planned[k].cycles_left : left;
    }
    while (left > 0) {
        int64_t cycles[4] = {0};
        for (int32_t k = 0; k < hold->count; k++) {
            const walker *w = &walkers[k];
            out[k] = (sj_track_axis){0.0, w->at.V.hi, w->at.A.hi, w->jerk.hi, {0.0}};
            if (w->left != INT64_MAX)
                out[k].velocity += hold->planned[k].spread_q.hi;
        }
        for (int p = 0; p < 4 && left > 0; p++) {
            cycles[p] = left;
            for (int32_t k = 0; k < hold->count; k++)
                cycles[p] = walkers[k].left < cycles[p] ? walkers[k].left : cycles[p];
            for (int32_t k = 0; k < hold->count; k++) {
                continuous from = walkers[k].at;
                int32_t leg = walkers[k].leg;
                double J = leg < hold->planned[k].count ? hold->planned[k].legs[leg].jerk.hi : 0.0;
                walk(&hold->planned[k], &walkers[k], cycles[p]);
                allow(&track->limits[k], &from, &walkers[k].at, J);
                out[k].jerk[p] = J;
            }
            left -= cycles[p];
        }
        for (int32_t k = 0; k < hold->count; k++)
            out[k].position = sample_of(&walkers[k]);
        if (sj_track_put(track, track->number + 1, cycles, left == 0, out) != SJ_TRACK_OK)
            return -1;
    }
    return 0;
}

/* ---- begin and end --------------------------------------------------------------------------- */

int32_t sj_hold_possible(const sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    int32_t line = 1;
    for (int32_t k = 0; k < n; k++) {
        const sj_axis *ax = &kernel->axis[axes[k]];
        const sj_interpolator *ip = &ax->interpolator;
        if (ax->held || ip->cycles_left == 0 || ip->goal_free || ip->goal != ax->goal.goal ||
            ip->goal_velocity != 0.0)
            return 0;
        line &= ax->line != 0.0; /* a stop of its own is on the line as well */
    }
    return n > 1 && !line && kernel->feed_hold.axes == 0;
}

int32_t sj_hold_begin(sj_kernel *kernel, uint64_t axes, double planned)
{
    sj_feed_hold *hold = &kernel->feed_hold;
    double position[SJ_AXES];
    sj_track_limits limits[SJ_AXES];

    hold->count = 0;
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if ((axes & axis_bit(i)) == 0)
            continue;
        position[hold->count] = ax->interpolator.q.hi;
        limits[hold->count] = limits_of(ax, planned);
        hold->planned[hold->count] = ax->interpolator;
        hold->axis[hold->count++] = i;
    }
    sj_track_begin(&hold->player.track, hold->count, position, limits);
    if (lay_track(hold) != 0)
        return 0;
    sj_player_begin(&hold->player);
    sj_player_enter(&hold->player);
    hold->at = 0;
    hold->override = planned;
    hold->axes = axes;
    for (int32_t k = 0; k < hold->count; k++)
        kernel->axis[hold->axis[k]].held = 1;
    return 1;
}

void sj_hold_by_stop(sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    sj_stop_together(kernel, axes, n);
    for (int32_t k = 0; k < n; k++) { /* unless it stops on its goal */
        sj_axis *ax = &kernel->axis[axes[k]];
        ax->held = ax->interpolator.goal_free || ax->interpolator.cycles_left == 0;
    }
}

void sj_hold_hand_over(sj_kernel *kernel, uint64_t axes)
{
    const sj_feed_hold *hold = &kernel->feed_hold;
    if (hold->player.cycle == 0 || hold->player.plain > 0)
        return; /* at feed 1 they are their own */
    for (int32_t k = 0; k < hold->count; k++) {
        sj_interpolator *ip = &kernel->axis[hold->axis[k]].interpolator;
        sj_state sample;
        double jerk;
        if ((hold->axes & axes & axis_bit(hold->axis[k])) == 0)
            continue;
        sj_player_hand_over(&hold->player, k, &sample, &jerk);
        sj_interpolator_start(ip, &sample);
        ip->j = exact_of(jerk);
    }
}

void sj_hold_release(sj_kernel *kernel, uint64_t axes)
{
    sj_feed_hold *hold = &kernel->feed_hold;
    for (int32_t k = 0; k < hold->count; k++)
        if (hold->axes & axes & axis_bit(hold->axis[k]))
            kernel->axis[hold->axis[k]].held = 0;
    hold->axes &= ~axes;
}

/* ---- one cycle ------------------------------------------------------------------------------- */

/* The move as it was planned; this cycle is its next. */
static void give_back(sj_kernel *kernel, int32_t k)
{
    kernel->axis[kernel->feed_hold.axis[k]].interpolator = kernel->feed_hold.planned[k];
    sj_hold_release(kernel, axis_bit(kernel->feed_hold.axis[k]));
}

static void put_sample(sj_kernel *kernel, int32_t k)
{
    const sj_player *player = &kernel->feed_hold.player;
    sj_interpolator *ip = &kernel->axis[kernel->feed_hold.axis[k]].interpolator;
    if (player->plain > 0) {
        *ip = kernel->feed_hold.planned[k];
        sj_interpolator_step(ip);
        return;
    }
    sj_interpolator_start(
        ip, &(sj_state){player->run.past[0][k], player->velocity[k], player->acceleration[k]});
    ip->j = exact_of(player->jerk[k]);
}

/* At rest in the last half cycle of the track: a sample shows the path half a cycle late, so here each
 * is the goal, and the move is over though the hold lasts. */
static int32_t over(const sj_feed_hold *hold)
{
    const sj_player *player = &hold->player;
    double rest, to_go = (double)(player->track.end - sj_player_place(player, &rest));
    if (to_go - rest > 0.5)
        return 0;
    for (int32_t k = 0; k < hold->count; k++)
        if (player->velocity[k] != 0.0 || player->acceleration[k] != 0.0 || player->jerk[k] != 0.0)
            return 0;
    return player->rests > 0;
}

uint64_t sj_hold_step(sj_kernel *kernel)
{
    sj_feed_hold *hold = &kernel->feed_hold;
    sj_player *player = &hold->player;
    int32_t held = goal_held(kernel);
    double rest;

    for (int32_t k = 0; k < hold->count && hold->axes != 0; k++)
        if (!kernel->axis[hold->axis[k]].following)
            hold->axes &= ~axis_bit(hold->axis[k]);
    kernel->feedback.feed_hold = hold->axes;
    if (hold->axes == 0)
        return 0;
    player->wish = held && player->cycle >= SJ_PACE_SEEN ? 0.0 : 1.0;
    if (sj_player_step(player) == SJ_PACE_LOST)
        return hold->axes; /* its track is whole: never */
    for (int64_t whole = sj_player_place(player, &rest); hold->at < whole - 1; hold->at++)
        for (int32_t k = 0; k < hold->count; k++)
            sj_interpolator_step(&hold->planned[k]);
    for (int32_t k = 0; k < hold->count && over(hold); k++)
        while (hold->planned[k].cycles_left > 1)
            sj_interpolator_step(&hold->planned[k]);
    for (int32_t k = 0; k < hold->count; k++)
        if (hold->axes & axis_bit(hold->axis[k])) {
            if (hold->planned[k].cycles_left <= 1 || (player->plain > 0 && !held))
                give_back(kernel, k);
            else
                put_sample(kernel, k);
        }
    kernel->feedback.feed_hold = hold->axes;
    return 0;
}
