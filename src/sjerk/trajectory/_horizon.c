/* A stream's horizon as a quadratic programme: goals in least squares, limits as differences.
 *
 * Of a uniform cubic B-spline with control points c and knots h apart (de Boor, A Practical Guide to
 * Splines, chapter X)
 *
 *     position at a knot    (c[k-1] + 4 c[k] + c[k+1]) / 6      velocity      in the hull of D c / h
 *     acceleration there    D2 c / h^2                          jerk between  D3 c / h^3
 *
 * so bounds on three differences keep the limits everywhere; c that do not fall make a motion that does
 * not; c in a range make a motion inside it; three equal c are rest. A plan that ends at rest, shifted
 * by a knot, keeps all of it again: it is the start, and the answer where no better one is found.
 * With a common progress s the goals' moments move: value - slope ds is held against each goal, and
 * s stays behind the time that is due. Limits are not linearised; only the moments are.
 * Never here: goals' times, cycles, memory of its own.
 */
#include <math.h> /* floor, fmin, fmax, INFINITY */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memset of sums */
#include "trajectory/_horizon.h"

static const double RIDGE = 1e-9; /* weight of the distance to the given plan */
static const double ROOM = 1e-11, KEPT = 1e-9;
static const double TAKEN = 6e-10; /* beyond a bound; bounds on differences are 1 at least */
static const double CLOSER = 8.0;  /* goals are met closer than bounds by so much */
static const double STILL = 1e-8;  /* a smaller difference has no direction */
static const double BEGIN = 0.1, FIRST = 1.0, CLOSE = 1e-9; /* of the solver; CLOSE for each row */
static const double NEAR = 4.0; /* knots ahead in which a bound on deviations holds */
static const double bezier[3][3] = {
    {1 / 6.0, 4 / 6.0, 1 / 6.0}, {0, 2 / 3.0, 1 / 3.0}, {0, 1 / 3.0, 2 / 3.0}};
static const double binomial[4][4] = {{1, 0, 0, 0}, {-1, 1, 0, 0}, {1, -2, 1, 0}, {-1, 3, -3, 1}};

/* The programme of joints first .. first + count - 1, in the caller's memory. */
typedef struct {
    const sj_horizon *h;
    int32_t first, count, block; /* variables of a knot: count, and the progress */
    double fixed;                /* by how much what is given breaks a bound */
    sj_arrow qp;
    double *value, *low, *high, *weight, *target, *x, *own, *gradient;
    int32_t *start, *at;
} problem;

enum { WIDTH = 6 }; /* of a row: four control points, two of the progress */

static int64_t bounded_of(int64_t joints, int64_t knots) { return (joints * 9 + 2) * (knots + 2); }

static int64_t rows_of(int64_t joints, int64_t knots, int64_t goals)
{
    return bounded_of(joints, knots) + 2 * joints * (goals + knots) + knots;
}

int64_t sj_horizon_doubles(int32_t joints, int32_t knots, int32_t goals)
{
    int64_t n = (int64_t)(joints + 1) * knots, m = rows_of(joints, knots, goals);
    return 3 * n + (WIDTH + 4) * m +
           sj_arrow_spare(n, 4 * (joints + 1), (int32_t)bounded_of(joints, knots));
}

int64_t sj_horizon_ints(int32_t joints, int32_t knots, int32_t goals)
{
    return (WIDTH + 1) * rows_of(joints, knots, goals) + 1;
}

/* Variable of control point i = 0 .. knots + 4 of a joint, the first three and `ends` given: -1. */
static int32_t variable_of(const problem *p, int32_t joint, int32_t i)
{
    int32_t last = p->h->knots - 1, k = i - 3 < last ? i - 3 : last;
    if (k < 0 || (p->h->ends && k == last))
        return -1;
    return k * p->block + joint - p->first;
}

static double given(const sj_horizon *h, int32_t joint, int32_t i)
{
    return i < 3 ? h->before[3 * joint + i] : h->end[joint];
}

/* Basis of the segment at x in 0 .. 1: of the sample, or of the velocity per knot. */
static void basis_of(double x, double bend, double basis[4])
{
    double y = 1.0 - x;
    basis[0] = y * y * y / 6.0 + bend * y;
    basis[1] = (3.0 * x * x * x - 6.0 * x * x + 4.0) / 6.0 + bend * (3.0 * x - 2.0);
    basis[2] = (3.0 * y * y * y - 6.0 * y * y + 4.0) / 6.0 + bend * (3.0 * y - 2.0);
    basis[3] = x * x * x / 6.0 + bend * x;
}

static void slope_of(double x, double basis[4])
{
    double y = 1.0 - x;
    basis[0] = -y * y / 2.0;
    basis[1] = (3.0 * x * x - 4.0 * x) / 2.0;
    basis[2] = -(3.0 * y * y - 4.0 * y) / 2.0;
    basis[3] = x * x / 2.0;
}

/* Segment of a moment, and where in it. */
static int32_t segment_of(const sj_horizon *h, double moment, double *x)
{
    double whole = fmin(fmax(floor(moment), 0.0), (double)(h->knots + 1));
    *x = fmin(fmax(moment - whole, 0.0), 1.0);
    return (int32_t)whole;
}

/* A row: lower <= sum of coefficient x + rest <= upper, and a weight of its square. What the plan does
 * is allowed, so that it stays an answer. A variable < 0 is none; equal ones may come twice. */
static void add(problem *p, int32_t *variable, double *coefficient, int32_t count, double rest,
                double lower, double upper, double weight)
{
    const sj_horizon *h = p->h;
    int32_t row = p->qp.rows, begin = p->start[row], entries = begin;
    double now = 0.0;
    for (int32_t a = 1; a < count; a++) /* places ascend */
        for (int32_t b = a; b > 0 && variable[b - 1] > variable[b]; b--) {
            int32_t v = variable[b];
            double c = coefficient[b];
            variable[b] = variable[b - 1];
            coefficient[b] = coefficient[b - 1];
            variable[b - 1] = v;
            coefficient[b - 1] = c;
        }
    for (int32_t a = 0; a < count; a++) {
        int32_t v = variable[a];
        if (v < 0 || coefficient[a] == 0.0) /* a row of nothing has no interior */
            continue;
        now += coefficient[a] * p->x[v];
        if (entries > begin && p->at[entries - 1] == v)
            p->value[entries - 1] += coefficient[a];
        else {
            p->at[entries] = v;
            p->value[entries++] = coefficient[a];
        }
    }
    if (entries == begin) { /* nothing to choose: only possible where a short plan ends */
        if (h->ends)
            p->fixed = fmax(p->fixed, fmax(rest - upper, lower - rest));
        return;
    }
    p->low[row] = h->fresh ? lower - rest : fmin(lower - rest, now);
    p->high[row] = h->fresh ? upper - rest : fmax(upper - rest, now);
    p->weight[row] = weight;
    p->target[row] = -rest;
    p->start[++p->qp.rows] = entries;
}

/* The same over control points i .. i + count - 1 of a joint. */
static void add_row(problem *p, int32_t joint, int32_t i, const double *coefficient, int32_t count,
                    double lower, double upper, double weight)
{
    int32_t variable[4];
    double own[4], rest = 0.0;
    for (int32_t a = 0; a < count; a++) {
        own[a] = coefficient[a];
        if ((variable[a] = variable_of(p, joint, i + a)) < 0)
            rest += own[a] * given(p->h, joint, i + a);
    }
    add(p, variable, own, count, rest, lower, upper, weight);
}

/* Whether all first differences have one sign and neither given control points nor the plan's are
 * outside: then control points in the range do, without Bezier points. */
static int32_t is_monotone(const sj_horizon *h, int32_t joint)
{
    const int32_t *sign = h->direction + joint * h->knots;
    const double *range = h->range + 2 * joint, *before = h->before + 3 * joint;
    for (int32_t i = 1; i < 3; i++)
        if (before[i] < range[0] - KEPT || before[i] > range[1] + KEPT)
            return 0;
    for (int32_t k = 0; k < h->knots; k++) {
        double c = h->fresh ? before[2] : h->plan[joint * h->knots + k];
        if (sign[k] == 0 || sign[k] != sign[0] || c < range[0] - KEPT || c > range[1] + KEPT)
            return 0;
    }
    return 1;
}

/* First difference of the plan from control point i to the next. */
static double difference(const problem *p, int32_t joint, int32_t i)
{
    int32_t one = variable_of(p, joint, i), two = variable_of(p, joint, i + 1);
    return (two < 0 ? given(p->h, joint, i + 1) : p->x[two]) -
           (one < 0 ? given(p->h, joint, i) : p->x[one]);
}

static void add_limits(problem *p, int32_t joint)
{
    const sj_horizon *h = p->h;
    const double *limit = h->limits + 4 * joint, *range = h->range + 2 * joint;
    for (int32_t k = 0; k < h->knots; k++) {
        int32_t sign = h->direction[joint * h->knots + k];
        double own = difference(p, joint, k + 2);
        if (h->strict &&
            sign * own < -STILL) /* the plan goes the other way there: that way, or not */
            sign = -sign;
        add_row(p, joint, k + 2, binomial[1], 2, sign > 0 ? 0.0 : -limit[0],
                sign < 0 ? 0.0 : limit[0], 0.0);
    }
    for (int32_t k = 0; k <= h->knots; k++)
        add_row(p, joint, k + 1, binomial[2], 3, -limit[2], limit[1], 0.0);
    for (int32_t k = 0; k <= h->knots + 1; k++)
        add_row(p, joint, k, binomial[3], 4, -limit[3], limit[3], h->smooth);
    add_row(p, joint, h->knots + 2, binomial[0], 1, h->rest[2 * joint], h->rest[2 * joint + 1],
            0.0);
    if (is_monotone(h, joint))
        for (int32_t k = 0; k < h->knots; k++)
            add_row(p, joint, k + 3, binomial[0], 1, range[0], range[1], 0.0);
    else /* Bezier points of each segment */
        for (int32_t k = 1; k <= h->knots + 1; k++)
            for (int32_t i = 0; i < 3; i++)
                add_row(p, joint, k, bezier[i], 3, range[0], range[1], 0.0);
}

/* Goals that are to be met exactly, where they are not denser than knots. */
static void add_exact(problem *p, int32_t joint)
{
    const sj_horizon *h = p->h;
    double basis[4], x;
    if (!h->fresh || h->exact > h->knots)
        return;
    for (int32_t g = 0; g < h->exact; g++) {
        int32_t k = segment_of(h, h->moment[g], &x);
        double goal = CLOSER * h->goal[g * h->joints + joint];
        basis_of(x, h->bend, basis);
        for (int32_t a = 0; a < 4; a++)
            basis[a] *= CLOSER;
        add_row(p, joint, k, basis, 4, goal, goal, 0.0);
    }
}

/* A sample less the goal due then: sum of coefficient x + rest, and how many variables. */
static int32_t off_goal(const problem *p, int32_t joint, int32_t g, int32_t variable[WIDTH],
                        double coefficient[WIDTH], double *rest)
{
    const sj_horizon *h = p->h;
    double x, slope = h->slope[g * h->joints + joint];
    int32_t k = segment_of(h, h->moment[g], &x), count = 4;
    *rest = -h->goal[g * h->joints + joint];
    basis_of(x, h->bend, coefficient);
    for (int32_t a = 0; a < 4; a++)
        if ((variable[a] = variable_of(p, joint, k + a)) < 0)
            *rest += coefficient[a] * given(h, joint, k + a);
    if (h->paced && k <= h->knots) /* progress of knots k and k + 1, the present one's given */
        for (int32_t a = 0; a < 2; a++)
            if (k + a >= 1 && k + a <= h->knots) {
                variable[count] = (k + a - 1) * p->block + p->count;
                coefficient[count++] = -slope * (a ? x : 1.0 - x);
            }
    return count;
}

/* The velocity less the goal's, which is as slow as the progress is. */
static int32_t off_speed(const problem *p, int32_t joint, int32_t g, int32_t variable[WIDTH],
                         double coefficient[WIDTH], double *rest)
{
    const sj_horizon *h = p->h;
    double x, speed = h->speed[g * h->joints + joint], pace = 1.0;
    int32_t k = segment_of(h, h->moment[g], &x), count = 4;
    slope_of(x, coefficient);
    if (h->paced && k < h->knots) {
        pace = h->progress[k] - (k ? h->progress[k - 1] : h->progress_before);
        variable[count] = k * p->block + p->count;
        coefficient[count++] = -speed;
        if (k) {
            variable[count] = (k - 1) * p->block + p->count;
            coefficient[count++] = speed;
        }
    }
    *rest = -speed * pace;
    for (int32_t a = 0; a < 4; a++)
        if ((variable[a] = variable_of(p, joint, k + a)) < 0)
            *rest += coefficient[a] * given(h, joint, k + a);
    return count;
}

/* What is to be small: distances from goals, from their velocities, and from where the plan is to rest. */
static void add_wishes(problem *p, int32_t joint)
{
    const sj_horizon *h = p->h;
    int32_t variable[WIDTH];
    double basis[WIDTH], rest;
    for (int32_t g = 0; g < h->goals; g++) {
        int32_t count = off_goal(p, joint, g, variable, basis, &rest);
        add(p, variable, basis, count, rest, -INFINITY, INFINITY, h->weight[g]);
        if (!h->speed || !h->speed_weight)
            continue;
        count = off_speed(p, joint, g, variable, basis, &rest);
        add(p, variable, basis, count, rest, -INFINITY, INFINITY, h->weight[g] * h->speed_weight);
    }
    for (int32_t k = 0; k < h->knots - h->ends; k++) {
        double one = 1.0;
        variable[0] = variable_of(p, joint, k + 3);
        if (h->tail[k] != 0.0)
            add(p, variable, &one, 1, -h->end[joint], -INFINITY, INFINITY, h->tail[k]);
        add(p, variable, &one, 1, -h->plan[joint * h->knots + k], -INFINITY, INFINITY, RIDGE);
    }
}

/* At most so far from goals, of which at most two between knots are looked at. */
static void add_tolerance(problem *p, int32_t joint)
{
    const sj_horizon *h = p->h;
    double half = -1.0;
    for (int32_t g = 0; h->tolerance && g < h->goals && h->moment[g] < NEAR; g++) {
        int32_t variable[WIDTH];
        double coefficient[WIDTH], rest, most = h->tolerance[joint];
        if (floor(2.0 * h->moment[g]) == half)
            continue;
        half = floor(2.0 * h->moment[g]);
        int32_t count = off_goal(p, joint, g, variable, coefficient, &rest);
        add(p, variable, coefficient, count, rest, -most, most, 0.0);
    }
}

/* The unknown of a knot's progress is its change against the plan's. */
static void add_progress(problem *p)
{
    const sj_horizon *h = p->h;
    for (int32_t k = 0; k < h->knots; k++) {
        int32_t v = k * p->block + p->count, two[2] = {v - p->block, v};
        double one = 1.0, rise[2] = {-1.0, 1.0}, late = h->progress[k] - h->due[k];
        double before = k ? h->progress[k - 1] : h->progress_before;
        add(p, &v, &one, 1, late, late - h->trust, fmax(fmin(0.0, late + h->trust), late), h->lag);
        add(p, two + !k, rise + !k, 1 + !!k, 0.0, fmin(before - h->progress[k], 0.0), INFINITY,
            0.0);
    }
}

/* Weights such that the largest second derivative is 1. */
static void scale(problem *p, double *diagonal)
{
    const sj_arrow *qp = &p->qp;
    double most = 0.0;
    memset(diagonal, 0, (size_t)qp->unknowns * sizeof *diagonal);
    for (int32_t r = 0; r < qp->rows; r++)
        for (int32_t e = p->start[r]; p->weight[r] != 0.0 && e < p->start[r + 1]; e++)
            diagonal[p->at[e]] += p->weight[r] * p->value[e] * p->value[e];
    for (int64_t i = 0; i < qp->unknowns; i++)
        most = fmax(most, diagonal[i]);
    for (int32_t r = 0; most > 0.0 && r < qp->rows; r++)
        p->weight[r] /= most;
}

static void share_out(problem *p, double *work, int32_t *ints)
{
    int64_t n = p->qp.unknowns, m = rows_of(p->count, p->h->knots, p->h->goals);
    p->x = work;
    p->own = p->x + n;
    p->gradient = p->own + n;
    p->low = p->gradient + n;
    p->high = p->low + m;
    p->weight = p->high + m;
    p->target = p->weight + m;
    p->value = p->target + m;
    p->start = ints;
    p->at = ints + m + 1;
    memset(p->gradient, 0, (size_t)n * sizeof *work);
    p->qp.spare = p->value + WIDTH * m;
    p->qp.start = p->start;
    p->qp.at = p->at;
    p->qp.value = p->value;
    p->qp.low = p->low;
    p->qp.high = p->high;
    p->qp.weight = p->weight;
    p->qp.target = p->target;
    p->qp.gradient = p->gradient;
    p->qp.x = p->x;
}

static void fill(problem *p)
{
    p->start[0] = 0;
    for (int32_t j = p->first; j < p->first + p->count; j++) {
        add_limits(p, j);
        add_exact(p, j);
        add_tolerance(p, j);
    }
    if (p->h->paced)
        add_progress(p);
    p->qp.bounded = p->qp.rows;
    for (int32_t j = p->first; j < p->first + p->count; j++)
        add_wishes(p, j);
    scale(p, p->qp.spare);
}

static double row_times(const problem *p, int32_t r, const double *x)
{
    double sum = 0.0;
    for (int32_t e = p->start[r]; e < p->start[r + 1]; e++)
        sum += p->value[e] * x[p->at[e]];
    return sum;
}

/* The largest share in 0 .. 1 of the way from the plan to the answer on which no row is further beyond a bound
 * than at the plan. */
static double toward(const problem *p)
{
    double share = 1.0;
    for (int32_t r = 0; r < p->qp.bounded; r++) {
        double here = row_times(p, r, p->own), there = row_times(p, r, p->x);
        double upper = fmax(p->high[r] + ROOM, here), lower = fmin(p->low[r] - ROOM, here);
        if (there > upper)
            share = fmin(share, (upper - here) / (there - here));
        if (there < lower)
            share = fmin(share, (here - lower) / (here - there));
    }
    return share > 0.0 ? share : 0.0;
}

static void solve(const sj_horizon *h, int32_t first, int32_t count, double *control,
                  double *progress, double *share, double *work, int32_t *ints, int32_t most,
                  sj_arrow_result *result)
{
    problem p = {.h = h, .first = first, .count = count, .block = count + h->paced};
    int32_t last = h->ends ? h->knots - 1 : h->knots;
    double part;
    p.qp.unknowns = h->knots * p.block;
    p.qp.band = h->paced ? 4 * p.block - 1 : 3 * p.block;
    p.qp.most = most;
    share_out(&p, work, ints);
    for (int32_t k = 0; k < h->knots; k++) {
        for (int32_t j = 0; j < count; j++)
            p.x[k * p.block + j] = h->plan[(first + j) * h->knots + k];
        if (h->paced)
            p.x[k * p.block + count] = 0.0;
    }
    memcpy(p.own, p.x, (size_t)p.qp.unknowns * sizeof *p.x);
    fill(&p);
    p.qp.begin = BEGIN;
    p.qp.room = FIRST;
    p.qp.near = CLOSE * p.qp.bounded;
    sj_arrow_solve(&p.qp, result);
    if (h->fresh)
        part = result->outside <= TAKEN && p.fixed <= TAKEN ? 1.0 : 0.0;
    else
        part = toward(&p);
    for (int32_t k = 0; k < h->knots; k++) {
        for (int32_t j = 0; j < count; j++) {
            int32_t i = k * p.block + j, to = (first + j) * h->knots + k;
            const double *range = h->range + 2 * (first + j);
            double low = fmin(range[0], p.own[i]), high = fmax(range[1], p.own[i]);
            control[to] = part >= 1.0 ? p.x[i] : p.own[i] + part * (p.x[i] - p.own[i]);
            if (is_monotone(h, first + j))
                control[to] = fmin(fmax(control[to], low), high);
            if (k == last)
                control[to] = h->end[first + j];
        }
        if (h->paced)
            progress[k] = h->progress[k] + part * p.x[k * p.block + count];
    }
    for (int32_t j = first; j < first + count; j++)
        share[j] = part;
}

void sj_horizon_plan(const sj_horizon *horizon, double *control, double *progress, double *share,
                     double *work, int32_t *ints, int32_t most, sj_arrow_result *result)
{
    int32_t steps = 0, count = horizon->paced ? horizon->joints : 1;
    for (int32_t j = 0; j < horizon->joints; j += count) {
        solve(horizon, j, count, control, progress, share, work, ints, most, result);
        steps = result->steps > steps ? result->steps : steps;
    }
    result->steps = steps;
}

void sj_horizon_values(const sj_horizon *horizon, const double *control, double *value)
{
    const sj_horizon *h = horizon;
    for (int32_t g = 0; g < h->goals; g++) {
        double x, basis[4];
        int32_t k = segment_of(h, h->moment[g], &x);
        basis_of(x, h->bend, basis);
        for (int32_t j = 0; j < h->joints; j++) {
            double sum = 0.0;
            for (int32_t a = 0; a < 4; a++) {
                int32_t i = k + a - 3 < h->knots ? k + a - 3 : h->knots - 1;
                sum += basis[a] * (i < 0 ? h->before[3 * j + k + a] : control[j * h->knots + i]);
            }
            value[g * h->joints + j] = sum;
        }
    }
}
