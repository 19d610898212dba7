/* The pace of a path in play: how fast it is passed, and that its limits are kept meanwhile.
 *
 * The place on the path, s in path cycles, is a motion of its own: speed 1 is the path as planned, its
 * samples bit for bit where s is whole. A change of speed is a plan for s. Candidates for it, hardest
 * first, are run ahead over their whole way, and the first, second and third differences of all axes'
 * positions held against the limits; only then one is taken over. A constant speed up to 1 needs no
 * check (docs/explanation/path_in_play.md), so waiting is always allowed.
 * The work of a cycle is bounded: SJ_PACE_CHECKS. Never here: drives, commands, memory of its own.
 */
#include <float.h> /* DBL_EPSILON */
#include <math.h>  /* fabs, floor */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of positions */
#include "planner/_planner.h"
#include "trajectory/_pace.h"
#include "base/_double_double.h" /* double-double sums */
#include "base/_math.h"          /* whole powers */
#include "base/_continuous.h"    /* from samples to the continuous motion and back */

enum {
    RUNGS = 24,    /* candidates from hard to soft */
    SHARES = 4,    /* of a change of speed that cannot be had at once */
    TAIL = 3,      /* cycles in which differences still feel a motion's end */
    STRIDE = 128,  /* cycles by which a stay above speed 1 is prolonged */
    NEAR = 256,    /* a stop that is further off need not be put off yet */
    PATIENCE = 64, /* cycles until what was not found is looked for again */
    DELAY = 2,     /* cycles at least for a check longer than one cycle's */
    DELAYS = 1024,
    SHORT = 16 /* cycles of a change that need not be less */
};
enum { IDLE, FIRST, STAY, SECOND, SETTLED };
static const double WITHIN = 1.0 + 6e-10, HARDEST = 16.0, SOFTER = 0.75;
static const double share_of[SHARES] = {1.0, 0.5, 0.25, 0.1};

/* ---- one cycle of a run ---------------------------------------------------------------------- */

static void pace_start(sj_pace *pace, int64_t origin, double speed)
{
    sj_interpolator_start(&pace->s, &(sj_state){0.0, speed, 0.0});
    pace->origin = origin;
}

/* Whether it passes the path cycle by cycle, as planned. */
static int32_t is_plain(const sj_pace *pace)
{
    const sj_interpolator *s = &pace->s;
    return s->cycles_left == 0 && s->v.hi == 1.0 && s->v.lo == 0.0 && s->q.lo == 0.0 &&
           s->q.hi == floor(s->q.hi);
}

static void pace_step(sj_pace *pace)
{
    sj_interpolator *s = &pace->s;
    sj_interpolator_step(s);
    if (s->cycles_left ==
        0) { /* whole cycles into `origin`, so that s stays small and its bits fine */
        double whole = floor(s->q.hi);
        s->q = exact_subtract(s->q, exact_of(whole));
        pace->origin += (int64_t)whole;
    }
}

/* Path cycles; the difference to a whole number far out would lose bits, so in two parts. */
static double ahead_of(const sj_pace *pace, int64_t cycle)
{
    return (double)(cycle - pace->origin) - pace->s.q.hi;
}

/* Positions at the place of the pace; -1: it is not known. */
static int32_t place(const sj_track *track, sj_run *run, double *position, double *velocity,
                     double *acceleration, double *jerk)
{
    const sj_pace *pace = &run->pace;
    size_t bytes = (size_t)track->axes * sizeof(double);
    double half = is_plain(pace) ? 1.0 : 0.5, whole = floor(pace->s.q.hi - half);
    double cycles = pace->s.q.hi - half - whole;
    int64_t cell = pace->origin + (int64_t)whole;

    if (cell < 0) { /* not begun: where it is */
        memcpy(position, run->past[0], bytes);
        return track->count > 0 ? 0 : -1;
    }
    if (track->whole && ahead_of(pace, track->end) <= 0.0) {
        memcpy(position, track->way_point, bytes);
        return 0;
    }
    if (sj_cursor_seek(track, cell, &run->cursor) != 0)
        return -1;
    cycles += (double)(cell - run->cursor.begin);
    if (half == 1.0)
        sj_cursor_sample(track, &run->cursor, cell - run->cursor.begin + 1,
                         &(sj_follow_samples){position, velocity, acceleration, jerk});
    else
        sj_cursor_position(track, &run->cursor, cycles, position);
    return 0;
}

static void remember(const sj_track *track, sj_run *run, const double *position)
{
    size_t bytes = (size_t)track->axes * sizeof(double);
    memcpy(run->past[3], run->past[2], bytes);
    memcpy(run->past[2], run->past[1], bytes);
    memcpy(run->past[1], run->past[0], bytes);
    memcpy(run->past[0], position, bytes);
}

/* The limit of a change: of driving, of braking, or of the larger where it is neither or both. */
static double most_of(int32_t drives, int32_t brakes, double driving, double braking)
{
    return drives == brakes ? fmax(driving, braking) : drives ? driving : braking;
}

/* Whether a next position keeps all limits, by its differences to the last three. */
static int32_t keeps(const sj_track *track, const sj_run *run, const double *position)
{
    int32_t broken = 0;
    for (int32_t k = 0; k < track->axes; k++) {
        const sj_track_limits *most = &track->limits[k];
        double x = position[k], x1 = run->past[0][k], x2 = run->past[1][k], x3 = run->past[2][k];
        double noise = 8.0 * DBL_EPSILON * fabs(x), first = x - x1, before = x1 - x2;
        double second = first - before, last = before - (x2 - x3), third = second - last;
        double now = second * (x - x2), then = last * (x1 - x3);
        broken |= !(fabs(first) <= most->velocity * WITHIN + noise);
        broken |= !(fabs(second) <=
                    most_of(now > 0.0, now < 0.0, most->acceleration, most->deceleration) * WITHIN +
                        noise);
        broken |= !(fabs(third) <= most_of(now > 0.0 || then > 0.0, now < 0.0 || then < 0.0,
                                           most->jerk, most->deceleration_jerk) *
                                           WITHIN +
                                       noise);
    }
    return !broken;
}

/* ---- candidates ------------------------------------------------------------------------------ */

/* From where the pace is to another speed, wherever that is; to speed 1 on a whole path cycle. */
static int32_t plan_change(sj_pace *pace, double to, const sj_limits *limits, double *way)
{
    continuous at = lemma(pace->s.q, pace->s.v, pace->s.a, pace->s.j);
    sj_limits most = *limits;
    sj_plan plan;
    double distance = 0.0, v = at.V.hi, a = at.A.hi, goal;

    most.velocity = fmax(fmax(to, 1.0), fabs(at.V.hi) + fabs(a) + 1e-9);
    if (sj_plan_velocity(v, a, to, &most, &plan) != SJ_PLAN_OK)
        return -1;
    for (int32_t i = 0; i < plan.count; i++) {
        double n = (double)plan.phase[i].cycles, j = plan.phase[i].jerk;
        distance += n * (v + n * (a / 2.0 + n * j / 6.0));
        v += n * (a + n * j / 2.0);
        a += n * j;
    }
    *way = distance;
    if (to != 1.0)
        return sj_interpolator_load(&pace->s, &plan, 0.0, to, 1) == SJ_LOAD_OK ? 0 : -1;
    if (plan.count == 0 && pace->s.q.lo == 0.0 && pace->s.q.hi == floor(pace->s.q.hi))
        return -1;
    most.velocity = fmax(1.0, at.V.hi + fmax(0.0, at.A.hi * fabs(at.A.hi) / (2.0 * most.jerk)));
    goal = floor(at.P.hi + distance + 0.5) + 1.0;
    if (sj_plan_move(lemma_distance(&at, goal, 1.0), at.V.hi, at.A.hi, 1.0, &most, &plan) !=
        SJ_PLAN_OK)
        return -1;
    *way = goal - at.P.hi;
    return sj_interpolator_load(&pace->s, &plan, goal, 1.0, 0) == SJ_LOAD_OK ? 0 : -1;
}

static sj_limits rung_of(const sj_player *player, int32_t rung)
{
    double factor = HARDEST * whole_power(SOFTER, rung);
    double a = fmin(0.5, factor * player->hardest_a), j = fmin(0.5, factor * player->hardest_j);
    return (sj_limits){1.0, a, j, a, j};
}

/* Cycles of the path known ahead. */
static double known_ahead(const sj_player *player)
{
    return ahead_of(&player->run.pace, player->track.end);
}

/* Whether what is known is so little that a stop must be kept at hand. */
static int32_t is_lean(const sj_player *player)
{
    sj_limits soft = rung_of(player, RUNGS - 1);
    double v = fmax(1.0, player->run.pace.s.v.hi);
    if (player->track.whole)
        return 0;
    return known_ahead(player) <
           0.6 * v * (v / soft.acceleration + soft.acceleration / soft.jerk) + NEAR;
}

static int32_t moves(const sj_pace *pace) { return pace->s.cycles_left > 0 || pace->s.v.hi != 0.0; }

/* ---- what to look for ------------------------------------------------------------------------ */

/* Whether a stop must be found, or put off: less is known than soft stops need. */
static int32_t wants_stop(const sj_player *player)
{
    if (player->next_kind == SJ_SEARCH_NONE)
        return is_lean(player);
    return player->next_kind == SJ_SEARCH_STOP && player->track.end > player->next_known &&
           player->next_at - player->cycle < NEAR;
}

static int32_t wanted(const sj_player *player, double *to)
{
    double end = player->run.pace.s.goal_velocity, wish = player->wish;
    int32_t settled = player->run.pace.s.cycles_left == 0, kind = player->next_kind;

    *to = wish;
    if (kind == SJ_SEARCH_CHANGE)
        return SJ_SEARCH_NONE; /* found; it begins in a moment */
    if (end > 1.0 && wish > 1.0)
        return wish == player->away && player->next_at - player->cycle < 2 * STRIDE
                   ? SJ_SEARCH_STAY
                   : SJ_SEARCH_NONE;
    if (end == 1.0 && wish > 1.0 && !is_lean(player))
        return settled && kind == SJ_SEARCH_NONE ? SJ_SEARCH_AWAY : SJ_SEARCH_NONE;
    wish = fmin(wish, 1.0);
    if (wish < 1.0)
        wish = fmin(wish, player->below);
    *to = wish;
    if (end > 1.0)
        return SJ_SEARCH_CHANGE;
    if (player->starves && wish > 0.0 && player->track.end == player->next_known)
        return SJ_SEARCH_NONE;
    if (end != wish)
        return SJ_SEARCH_CHANGE;
    if (!settled)
        return kind == SJ_SEARCH_NONE && player->run.pace.s.cycles_left > SHORT ? SJ_SEARCH_SOONER
                                                                                : SJ_SEARCH_NONE;
    return end > 0.0 && wants_stop(player) ? SJ_SEARCH_STOP : SJ_SEARCH_NONE;
}

/* ---- one candidate --------------------------------------------------------------------------- */

/* The next candidate; after the last one nothing is left to try. Slower: a part of it hard before all of
 * it softly, since the rest is looked for on the way. */
static void go_softer(const sj_player *player, sj_search *search)
{
    int32_t rungs = search->kind == SJ_SEARCH_SOONER ? player->rung - 1 : RUNGS;
    int32_t slower =
        search->kind == SJ_SEARCH_CHANGE && search->to < player->run.pace.s.goal_velocity;
    search->stage = IDLE;
    if (slower || search->kind == SJ_SEARCH_SOONER) {
        if (++search->share < SHARES)
            return;
        search->share = 0;
        search->spent = ++search->rung >= rungs;
    } else {
        if (++search->rung < rungs)
            return;
        search->rung = 0;
        search->spent = ++search->share >= SHARES;
    }
    if (search->spent)
        search->rung = search->share = 0;
}

/* Let the trial run so many cycles as it does now, unchecked; -1: over a place that is not known. */
static int32_t run_ahead(const sj_track *track, sj_search *search, int64_t cycles, int32_t *work)
{
    double position[SJ_AXES], unused[3][SJ_AXES];
    sj_run *run = &search->run;
    for (int64_t left = cycles; left > 0; left--) {
        sj_interpolator *s = &run->pace.s;
        if (s->cycles_left == 0 && left > TAIL + 1) { /* at a constant speed, at once */
            s->q = exact_add(s->q, exact_scale(s->v, (double)(left - TAIL - 1)));
            left = TAIL + 1;
        }
        pace_step(&run->pace);
        *work -= 1;
        if (left > TAIL)
            continue;
        if (place(track, run, position, unused[0], unused[1], unused[2]) != 0)
            return -1;
        remember(track, run, position);
        *work -= track->axes;
    }
    search->cycle += cycles;
    return 0;
}

/* When the candidate begins: a stop as late as what is known allows. -1: not in time. */
static int64_t delay_of(const sj_player *player, const sj_limits *limits)
{
    const sj_search *search = &player->search;
    sj_pace stop = player->run.pace;
    double way, room;
    if (search->kind == SJ_SEARCH_STAY)
        return player->next_at - player->cycle;
    if (search->kind != SJ_SEARCH_STOP)
        return search->delay;
    if (plan_change(&stop, 0.0, limits, &way) != 0)
        return -1;
    room = known_ahead(player) - way - 2.0;
    if (room < 0.0)
        return -1;
    room = (1.0 - share_of[SHARES - 1 - search->share] + share_of[SHARES - 1]) * room;
    return (int64_t)fmin(room / player->run.pace.s.v.hi, 1e15);
}

/* Begin a candidate: its place and time, and its first plan; -1: it is none. */
static int32_t set_up(sj_player *player, int32_t *work)
{
    sj_search *search = &player->search;
    sj_limits limits = rung_of(player, search->rung);
    double from = player->run.pace.s.goal_velocity, to = 0.0, way;
    int64_t delay = delay_of(player, &limits);

    *work -= SJ_PACE_PLAN;
    if (delay < 0)
        return -1;
    search->run = player->run;
    search->cycle = player->cycle;
    search->begin = player->cycle + delay;
    search->second_at = -1;
    if (search->kind != SJ_SEARCH_STAY && search->kind != SJ_SEARCH_STOP) {
        if (player->next_kind != SJ_SEARCH_NONE && search->begin >= player->next_at)
            return -1;
        if (search->kind == SJ_SEARCH_SOONER && search->share > 0)
            from = player->run.pace.s.v.hi; /* a part of what is left */
        if (search->kind == SJ_SEARCH_SOONER && search->share > 0 && search->to >= from)
            return -1;
        to = from + (search->to - from) * share_of[search->share];
        if ((to > player->below && to < 1.0) || (to > 1.0 && search->kind != SJ_SEARCH_AWAY))
            return -1; /* no speed that can last */
    }
    if (run_ahead(&player->track, search, delay, work) != 0)
        return -1;
    if (search->kind == SJ_SEARCH_STAY) {
        search->stage = STAY;
        search->left = STRIDE;
        return 0;
    }
    if (plan_change(&search->run.pace, to, &limits, &way) != 0)
        return -1;
    if (search->kind == SJ_SEARCH_SOONER && /* a tenth sooner, or not worth it */
        (double)(delay + search->run.pace.s.cycles_left) >
            0.9 * share_of[search->share] * (double)player->run.pace.s.cycles_left)
        return -1;
    search->first = search->run.pace;
    search->stage = FIRST;
    return 0;
}

/* Whether a second plan belongs to it: back to 1, or to rest where little is known ahead. */
static int32_t has_second(const sj_player *player)
{
    const sj_search *search = &player->search;
    if (search->kind == SJ_SEARCH_AWAY)
        return 1;
    return (search->kind == SJ_SEARCH_CHANGE || search->kind == SJ_SEARCH_SOONER) &&
           search->run.pace.s.goal_velocity > 0.0 && is_lean(player);
}

/* One stage after the other; 1: run to its end, 0: goes on, -1: no. */
static int32_t enter_stage(sj_player *player, int32_t *work)
{
    sj_search *search = &player->search;
    sj_limits limits = rung_of(player, search->rung);
    sj_pace *pace = &search->run.pace;
    double to = search->kind == SJ_SEARCH_CHANGE ? 0.0 : 1.0, way;

    if (search->stage == FIRST && pace->s.cycles_left == 0) {
        search->stage = has_second(player) ? STAY : SETTLED;
        search->left = search->stage == SETTLED         ? TAIL
                       : search->kind == SJ_SEARCH_AWAY ? STRIDE
                                                        : 0;
        search->reach = pace->origin + (int64_t)pace->s.q.hi + TAIL + 1;
    }
    if (search->stage == STAY && search->left == 0) {
        *work -= SJ_PACE_PLAN;
        if (plan_change(pace, to, &limits, &way) != 0)
            return -1;
        search->second = *pace;
        search->second_at = search->cycle;
        search->stage = SECOND;
    }
    if (search->stage == SECOND && pace->s.cycles_left == 0) {
        search->stage = SETTLED;
        search->left = TAIL;
        if (search->kind != SJ_SEARCH_CHANGE)
            search->reach = pace->origin + (int64_t)pace->s.q.hi + TAIL + 1;
    }
    return search->stage == SETTLED && search->left == 0;
}

/* One cycle of the candidate; -1: it breaks a limit, goes backward or where nothing is known. */
static int32_t advance(sj_player *player, int32_t *work)
{
    sj_search *search = &player->search;
    sj_run *run = &search->run;
    double position[SJ_AXES], unused[3][SJ_AXES];
    int64_t origin = run->pace.origin;
    double to_go = ahead_of(&run->pace, origin);

    pace_step(&run->pace);
    *work -= player->track.axes;
    search->cycle++;
    search->left--;
    if (ahead_of(&run->pace, origin) > to_go + 1e-13 ||
        place(&player->track, run, position, unused[0], unused[1], unused[2]) != 0 ||
        !keeps(&player->track, run, position))
        return -1;
    remember(&player->track, run, position);
    return 0;
}

/* What was found is taken over when its time comes. */
static void adopt(sj_player *player)
{
    sj_search *search = &player->search;
    player->after_at = -1;
    player->next_at = search->begin;
    player->next = search->first;
    player->next_kind = search->kind;
    if (search->kind == SJ_SEARCH_STAY) {
        player->next = search->second;
        player->next_at = search->second_at;
        player->next_kind = SJ_SEARCH_AWAY;
    } else if (search->second_at >= 0) {
        player->after = search->second;
        player->after_at = search->second_at;
    }
    if (search->kind == SJ_SEARCH_SOONER)
        player->next_kind = SJ_SEARCH_CHANGE;
    if (search->kind == SJ_SEARCH_CHANGE || search->kind == SJ_SEARCH_SOONER)
        player->next_rung = search->rung;
    if (search->kind == SJ_SEARCH_AWAY) {
        player->away = search->to;
        player->next_kind = SJ_SEARCH_CHANGE;
    }
    player->next_known = player->track.end;
    if (search->kind != SJ_SEARCH_STOP && search->reach > player->checked)
        player->checked = search->reach;
    search->kind = SJ_SEARCH_NONE;
    search->delay = 0;
}

/* ---- one cycle ------------------------------------------------------------------------------- */

static void restart(sj_player *player, int32_t kind, double to)
{
    sj_search *search = &player->search;
    search->kind = kind;
    search->to = to;
    search->known = player->track.end;
    search->rung = search->share = search->spent = 0;
    search->stage = IDLE;
    search->delay = 0;
}

/* Whether looking again can find something that was not found before. */
static int32_t is_worth(const sj_player *player)
{
    const sj_search *search = &player->search;
    if (search->known != player->track.end)
        return 1;
    if (search->kind == SJ_SEARCH_CHANGE && moves(&player->run.pace))
        return 1;
    return (search->kind == SJ_SEARCH_AWAY || search->kind == SJ_SEARCH_SOONER) &&
           player->cycle >= search->again;
}

static void look(sj_player *player)
{
    sj_search *search = &player->search;
    int32_t work = SJ_PACE_CHECKS;
    double to;
    int32_t kind = wanted(player, &to);

    if (kind != search->kind || to != search->to)
        restart(player, kind, to);
    if (kind == SJ_SEARCH_NONE)
        return;
    if (search->spent) {
        if (!is_worth(player))
            return;
        restart(player, kind, to);
    }
    if (search->stage != IDLE && search->begin < player->cycle) { /* more work than time: later */
        int64_t cycles = search->first.s.cycles_left +
                         (search->second_at < 0 ? 0 : search->second.s.cycles_left);
        int64_t need = DELAY + 3 * cycles * player->track.axes / (2 * SJ_PACE_CHECKS);
        search->stage = IDLE;
        search->delay = need > 2 * search->delay ? need : 2 * search->delay;
        search->delay = search->delay < DELAYS ? search->delay : DELAYS;
    }
    while (work > 0 && !search->spent) {
        int32_t done = 0;
        if (search->stage == IDLE && set_up(player, &work) != 0) {
            go_softer(player, search);
            continue;
        }
        while (work > 0 && done == 0) {
            done = advance(player, &work);
            if (done == 0)
                done = enter_stage(player, &work);
        }
        if (done == 1) {
            adopt(player);
            return;
        }
        if (done < 0)
            go_softer(player, search);
    }
    if (search->spent)
        search->again =
            player->cycle + (search->kind == SJ_SEARCH_SOONER ? PATIENCE / 8 : PATIENCE);
}

void sj_player_begin(sj_player *player)
{
    const sj_track *track = &player->track;
    size_t bytes = (size_t)track->axes * sizeof(double);
    player->run.cursor = (sj_cursor){0};
    player->run.cursor.segment = -1;
    player->search = (sj_search){0};
    pace_start(&player->run.pace, 0, 0.0);
    player->hardest_a = player->hardest_j = INFINITY;
    player->below = 1.0;
    for (int32_t k = 0; k < track->axes; k++) {
        const sj_track_limits *most = &track->limits[k];
        player->hardest_a = fmin(player->hardest_a, most->acceleration / most->velocity);
        player->hardest_a = fmin(player->hardest_a, most->deceleration / most->velocity);
        player->hardest_j = fmin(player->hardest_j, most->jerk / most->velocity);
        player->hardest_j = fmin(player->hardest_j, most->deceleration_jerk / most->velocity);
        /* a constant speed between may see 3 % of a cycle's jerk more than the highest velocity */
        player->below = fmin(player->below, 1.0 - 0.035 * most->jerk / most->velocity);
        player->velocity[k] = player->acceleration[k] = player->jerk[k] = 0.0;
    }
    player->below = fmax(player->below, 0.1);
    for (int i = 0; i < 4; i++)
        memcpy(player->run.past[i], track->way_point, bytes);
    player->wish = player->away = 1.0;
    player->cycle = player->plain = player->checked = 0;
    player->next_kind = SJ_SEARCH_NONE;
    player->next_at = player->after_at = player->next_known = -1;
    player->begun = player->starves = player->rung = player->next_rung = 0;
    player->rests = TAIL;
}

void sj_player_enter(sj_player *player)
{
    pace_start(&player->run.pace, 0, 1.0);
    player->begun = 1;
    player->rests = 0;
}

/* The first cycle: at full speed at once where enough is known, or a stop has been found. */
static int32_t begins(sj_player *player)
{
    if (player->track.count == 0)
        return 0;
    if (player->wish < 1.0) {
        player->begun = 1;
        return 1;
    }
    pace_start(&player->run.pace, 0, 1.0);
    if (is_lean(player))
        look(player);
    if (is_lean(player) && player->next_kind != SJ_SEARCH_STOP) {
        pace_start(&player->run.pace, 0, 0.0);
        return 0;
    }
    player->begun = 1;
    return 1;
}

static void take_next(sj_player *player)
{
    if (player->next_kind == SJ_SEARCH_STOP && !is_lean(player))
        player->next_kind = SJ_SEARCH_NONE; /* more is known now */
    if (player->next_kind == SJ_SEARCH_NONE || player->cycle != player->next_at)
        return;
    player->starves = player->next_kind == SJ_SEARCH_STOP;
    if (player->starves)
        player->checked = player->track.end;
    player->rung = player->next_rung;
    player->next_rung = 0;
    player->run.pace = player->next;
    player->next = player->after;
    player->next_at = player->after_at;
    player->next_kind = player->after_at < 0                     ? SJ_SEARCH_NONE
                        : player->run.pace.s.goal_velocity > 1.0 ? SJ_SEARCH_AWAY
                                                                 : SJ_SEARCH_STOP;
    player->after_at = -1;
}

/* First to third difference of the last four positions. */
static void differ(const sj_run *run, int32_t k, double *first, double *second, double *third)
{
    double before = run->past[1][k] - run->past[2][k], now = run->past[0][k] - run->past[1][k];
    *first = now;
    *second = now - before;
    *third = *second - (before - (run->past[2][k] - run->past[3][k]));
}

/* What is told where the positions are not the path's own samples. */
static void tell_differences(sj_player *player)
{
    for (int32_t k = 0; k < player->track.axes; k++)
        differ(&player->run, k, &player->velocity[k], &player->acceleration[k], &player->jerk[k]);
}

int32_t sj_player_step(sj_player *player)
{
    sj_track *track = &player->track;
    sj_run *run = &player->run;
    double position[SJ_AXES];

    if (!player->begun && !begins(player))
        return player->wish > 0.0 ? SJ_PACE_STARVES : SJ_PACE_RESTS;
    look(player);
    take_next(player);
    if (!moves(&run->pace)) {
        memcpy(position, run->past[0], (size_t)track->axes * sizeof(double));
        remember(track, run, position);
        tell_differences(player);
        player->plain = 0;
        player->cycle++;
        player->rests += player->rests < TAIL;
        return player->starves && player->wish > 0.0 ? SJ_PACE_STARVES : SJ_PACE_RESTS;
    }
    pace_step(&run->pace);
    if (place(track, run, position, player->velocity, player->acceleration, player->jerk) != 0)
        return SJ_PACE_LOST;
    player->cycle++;
    player->rests = 0;
    player->plain = is_plain(&run->pace) ? player->plain + 1 : 0;
    remember(track, run, position);
    if (player->plain == 0)
        tell_differences(player);
    sj_track_pass(track, run->cursor.segment);
    if (track->whole && ahead_of(&run->pace, track->end) <= 0.0) {
        for (int32_t k = 0; k < track->axes; k++)
            player->velocity[k] = player->acceleration[k] = player->jerk[k] = 0.0;
        return SJ_PACE_DONE;
    }
    return player->starves ? SJ_PACE_STARVES : SJ_PACE_RUNS;
}

/* ---- what others ask ------------------------------------------------------------------------- */

double sj_player_speed(const sj_player *player) { return player->run.pace.s.v.hi; }

int64_t sj_player_place(const sj_player *player, double *rest)
{
    const sj_pace *pace = &player->run.pace;
    double whole = floor(pace->s.q.hi);
    *rest = pace->s.q.hi - whole;
    return pace->origin + (int64_t)whole;
}

int32_t sj_player_cut(sj_player *player, int64_t number, int64_t cycles)
{
    sj_track *track = &player->track;
    sj_cursor *cursor = &player->run.cursor;
    double rest;
    int64_t at = sj_player_place(player, &rest), begin = track->end, sum = 0;
    int64_t drops = track->number - number + 1;
    if (cycles < 0 || drops < (cycles > 0) || drops > track->count)
        return -1;
    if (drops > 0) {
        const sj_track_segment *segment =
            &track->segment[(track->first + track->count - drops) % track->capacity];
        for (int p = 0; p < 4; p++)
            sum += segment->cycles[p];
        begin = segment->begin + cycles;
    }
    if (cycles > sum || begin < at + 2 * TAIL || begin < player->checked)
        return -1;
    sj_track_cut(track, number, cycles);
    track->whole = 0;
    cursor->end = cursor->end < track->end ? cursor->end : track->end; /* of a phase cut in two */
    player->search.kind = SJ_SEARCH_NONE; /* what was found may stand on what was there */
    if (player->next_kind == SJ_SEARCH_STOP)
        player->next_kind = SJ_SEARCH_NONE;
    return 0;
}

/* The last four positions as the bilinear integrator gives them under one jerk: whatever jerk comes
 * next, the third difference stays a mean of it and the last ones. */
void sj_player_hand_over(const sj_player *player, int32_t axis, sj_state *sample, double *jerk)
{
    double v = player->velocity[axis], a = player->acceleration[axis], j = player->jerk[axis];
    if (player->plain <= TAIL) {
        differ(&player->run, axis, &v, &a, &j);
        a += j;
        v += 0.5 * a - 0.25 * j;
    }
    *sample = (sj_state){player->run.past[0][axis], v, a};
    *jerk = j;
}
