/* Synchronised moves that are held on their way: one pace of time for all their axes.
 *
 * What the interpolators still have before them becomes a track, and its pace (_pace.c) goes to rest and
 * back to 1. So the axes stay on the line in joint space that was planned, and together. At pace 1 the
 * samples are the interpolators' own, and the interpolators take over again. Never here: which moves
 * these are, stops, drives, memory of its own.
 */
#include <math.h>   /* fabs, fmax, fmin */
#include <stddef.h>
#include <stdint.h>
#include "_cycle.h"
#include "base/_double_double.h" /* double-double sums */
#include "base/_continuous.h" /* from samples to the continuous motion */

static const double NOTHING = 1e-9; /* of a limit: neither forward nor backward */

static uint64_t bit(int32_t axis) { return UINT64_C(1) << axis; }

/* ---- the track ------------------------------------------------------------------------------- */

/* The continuous motion of an interpolator at a knot ahead of it. */
typedef struct {
    continuous at;
    sj_exact jerk;                      /* of the cycle before */
    int64_t cycles, left;               /* gone; to its next knot */
    int32_t leg;
} walker;

static walker walk_from(const sj_interpolator *ip)
{
    walker w = {lemma(ip->q, ip->v, ip->a, ip->j), ip->j, 0, ip->left, ip->leg};
    if (ip->leg >= ip->count)
        w.left = ip->ahead;
    return w;
}

/* P += n V + n^2 A/2 + n^3 J/6 and so on, with what is spread over the cycles: n of it in V, and in P
 * n of its own and n (n + 1) / 2 of V's (_lemma.h). */
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
        w->left = ip->ahead - w->cycles;
    if (w->cycles >= ip->ahead) { /* settled */
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

/* What a move does by itself it may do at another pace too: a start beyond its limits, say. */
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
    return (sj_track_limits){fmin(own->velocity * override, most), own->acceleration, own->jerk,
                             -INFINITY, INFINITY, own->deceleration, own->deceleration_jerk};
}

/* Segments between the knots of all axes, from where they are to where the last one rests. -1: more
 * than a track holds. */
static int32_t lay(sj_paced *paced)
{
    sj_track *track = &paced->player.track;
    walker walkers[SJ_AXES];
    sj_track_axis out[SJ_AXES];
    int64_t left = 0;
    for (int32_t k = 0; k < paced->count; k++) {
        walkers[k] = walk_from(&paced->way[k]);
        left = paced->way[k].ahead > left ? paced->way[k].ahead : left;
    }
    while (left > 0) {
        int64_t cycles[4] = {0};
        for (int32_t k = 0; k < paced->count; k++) {
            const walker *w = &walkers[k];
            out[k] = (sj_track_axis){0.0, w->at.V.hi, w->at.A.hi, w->jerk.hi, {0.0}};
            if (w->left != INT64_MAX)
                out[k].velocity += paced->way[k].spread_q.hi;
        }
        for (int p = 0; p < 4 && left > 0; p++) {
            cycles[p] = left;
            for (int32_t k = 0; k < paced->count; k++)
                cycles[p] = walkers[k].left < cycles[p] ? walkers[k].left : cycles[p];
            for (int32_t k = 0; k < paced->count; k++) {
                continuous from = walkers[k].at;
                int32_t leg = walkers[k].leg;
                double J = leg < paced->way[k].count ? paced->way[k].legs[leg].jerk.hi : 0.0;
                walk(&paced->way[k], &walkers[k], cycles[p]);
                allow(&track->limits[k], &from, &walkers[k].at, J);
                out[k].jerk[p] = J;
            }
            left -= cycles[p];
        }
        for (int32_t k = 0; k < paced->count; k++)
            out[k].position = sample_of(&walkers[k]);
        if (sj_track_put(track, track->number + 1, cycles, left == 0, out) != SJ_TRACK_OK)
            return -1;
    }
    return 0;
}

/* ---- begin and end --------------------------------------------------------------------------- */

int32_t sj_paced_can(const sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    int32_t line = 1;
    for (int32_t k = 0; k < n; k++) {
        const sj_axis *ax = &kernel->axis[axes[k]];
        const sj_interpolator *ip = &ax->interpolator;
        if (ax->parked || ip->ahead == 0 || ip->goal_free || ip->goal != ax->goal.goal ||
            ip->goal_velocity != 0.0)
            return 0;
        line &= ax->line != 0.0; /* a stop of its own is on the line as well */
    }
    return n > 1 && !line && kernel->paced.axes == 0;
}

int32_t sj_paced_begin(sj_kernel *kernel, uint64_t axes, double planned)
{
    sj_paced *paced = &kernel->paced;
    double position[SJ_AXES];
    sj_track_limits limits[SJ_AXES];

    paced->count = 0;
    for (int32_t i = 0; i < kernel->axes; i++) {
        const sj_axis *ax = &kernel->axis[i];
        if ((axes & bit(i)) == 0)
            continue;
        position[paced->count] = ax->interpolator.q.hi;
        limits[paced->count] = limits_of(ax, planned);
        paced->way[paced->count] = ax->interpolator;
        paced->axis[paced->count++] = i;
    }
    sj_track_begin(&paced->player.track, paced->count, position, limits);
    if (lay(paced) != 0)
        return 0;
    sj_player_begin(&paced->player);
    sj_player_enter(&paced->player);
    paced->at = 0;
    paced->override = planned;
    paced->axes = axes;
    for (int32_t k = 0; k < paced->count; k++)
        kernel->axis[paced->axis[k]].parked = 1; /* on its way, moving or not */
    return 1;
}

void sj_paced_hand_over(sj_kernel *kernel, uint64_t axes)
{
    const sj_paced *paced = &kernel->paced;
    if (paced->player.cycle == 0 || paced->player.plain > 0)
        return; /* at pace 1 they are their own */
    for (int32_t k = 0; k < paced->count; k++) {
        sj_interpolator *ip = &kernel->axis[paced->axis[k]].interpolator;
        sj_state sample;
        double jerk;
        if ((paced->axes & axes & bit(paced->axis[k])) == 0)
            continue;
        sj_player_hand_over(&paced->player, k, &sample, &jerk);
        sj_interpolator_start(ip, &sample);
        ip->j = exact_of(jerk);
    }
}

void sj_paced_release(sj_kernel *kernel, uint64_t axes)
{
    sj_paced *paced = &kernel->paced;
    for (int32_t k = 0; k < paced->count; k++)
        if (paced->axes & axes & bit(paced->axis[k]))
            kernel->axis[paced->axis[k]].parked = 0;
    paced->axes &= ~axes;
}

/* ---- one cycle ------------------------------------------------------------------------------- */

/* The move as it was planned; this cycle is its next. */
static void give_back(sj_kernel *kernel, int32_t k)
{
    kernel->axis[kernel->paced.axis[k]].interpolator = kernel->paced.way[k];
    sj_paced_release(kernel, bit(kernel->paced.axis[k]));
}

static void lead(sj_kernel *kernel, int32_t k)
{
    const sj_player *player = &kernel->paced.player;
    sj_interpolator *ip = &kernel->axis[kernel->paced.axis[k]].interpolator;
    if (player->plain > 0) {
        *ip = kernel->paced.way[k];
        sj_interpolator_step(ip);
        return;
    }
    sj_interpolator_start(ip, &(sj_state){player->run.past[0][k], player->velocity[k],
                                          player->acceleration[k]});
    ip->j = exact_of(player->jerk[k]);
}

void sj_paced_step(sj_kernel *kernel)
{
    sj_paced *paced = &kernel->paced;
    sj_player *player = &paced->player;
    int32_t held = goal_held(kernel);
    double rest;

    for (int32_t k = 0; k < paced->count && paced->axes != 0; k++)
        if (!kernel->axis[paced->axis[k]].following)
            paced->axes &= ~bit(paced->axis[k]);
    kernel->feedback.paced = paced->axes;
    if (paced->axes == 0)
        return;
    player->wish = held && player->cycle >= SJ_PACE_SEEN ? 0.0 : 1.0;
    if (sj_player_step(player) == SJ_PACE_LOST) { /* its track is whole: never */
        sj_stop_halt(kernel, paced->axes);
        return;
    }
    for (int64_t whole = sj_player_place(player, &rest); paced->at < whole - 1; paced->at++)
        for (int32_t k = 0; k < paced->count; k++)
            sj_interpolator_step(&paced->way[k]);
    for (int32_t k = 0; k < paced->count; k++)
        if (paced->axes & bit(paced->axis[k])) {
            if (paced->way[k].ahead <= 1 || (player->plain > 0 && !held))
                give_back(kernel, k);
            else
                lead(kernel, k);
        }
    kernel->feedback.paced = paced->axes;
}
