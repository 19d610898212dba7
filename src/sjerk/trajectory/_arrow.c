/* Convex quadratic programmes of splines: banded unknowns, and up to two that every row may have.
 *
 * The unknowns stand in order of time, so that a row's lie within `band` of each other; the last ones (a
 * pace of time, an excess) are the border. The matrix of a Newton step is then a band with a border
 * (`_bordered.c`).
 * Method: the primal-dual interior point method with Mehrotra's predictor and corrector (Nocedal and
 * Wright, Numerical Optimization, sections 14.2 and 16.6). Every bound of a row has a slack s > 0, free
 * to be wrong at first, and a multiplier z > 0; a step solves, with omega = sum of z / s,
 *     (H + sum of omega a a') dx = - gradient of the Lagrangian + sum of a (c - z r) / s,
 * where H is the objective's, c what s z is to become less what it is, and r what the slack is wrong by.
 * A row that is to be met has a multiplier of any sign and omega = STIFF, a step of the method of
 * multipliers. Rows go through in chunks of LANES, so that loops over these are vectors.
 * Never here: what the rows mean, memory of its own, time.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include "trajectory/_arrow.h"
#include "trajectory/_bordered.h"
#include "trajectory/_rows.h"

enum { B = SJ_BORDER, SIDES = 2 * LANES };

/* Share of the way to the nearest bound that a step takes. */
static const double BOUNDARY = 0.995;

/* A row missed by less is met, besides the rounding of its coefficients, which may be 10^8. A step
 * shorter than SHORT is followed by one to the middle; after two that are none there is no way on. A
 * product s z stays above BEHIND of their mean: slacks smaller than the rounding of their rows would
 * hold up all steps. */
static const double MISSED = 4e-10, EPSILON = 1e-15, SHORT = 0.02, STUCK = 1e-6, BEHIND = 1e-3;

static const double STIFF = 1e7;

/* Of each row the bound below and the one above. */
typedef double both[SIDES];

/* Rows in lanes. A bound is side (a'x + beside'w) + edge >= 0; one that is none has side = 0, edge = 1,
 * slack 1, multiplier 0, and stays so. */
typedef struct {
    coefficients a;
    both side, edge;
    both s, z, ds, dz;                 /* slack, multiplier, their steps */
    both per_s, per_z;                 /* 1 / s, 1 / z; 0 and 1 */
    both c, r;                         /* what s z is to change by; what the slack is wrong by */
    double size[LANES];                /* of the row's coefficients */
    double stiff[LANES], place[LANES]; /* STIFF and where the row is to be met, or 0 and 0 */
    double y[LANES], dy[LANES], off[LANES]; /* its multiplier, the step, by how much it is missed */
} chunk;

typedef struct {
    const sj_arrow *p;
    int64_t n, chunks;
    double *H;                /* (n, band + 1): of the objective, column j from its diagonal down */
    sj_bordered matrix;       /* of a step */
    double *dx, *grad, *flat; /* (n + B); flat: gradient of the objective at 0 */
    chunk *of;
    both *beside;      /* (chunks, border) */
    double step, last; /* lengths of this one and the one before */
    double longest; /* the step that leaves slacks and multipliers positive, up to 1 / BOUNDARY */
    double least;   /* what a product s z is raised to */
    double first, second; /* of the sum of s z along the step */
} work;

static const double SIGN[2] = {1.0, -1.0};

static int64_t chunks_of(int64_t rows) { return (rows + LANES - 1) / LANES; }

int64_t sj_arrow_spare(int64_t unknowns, int32_t band, int32_t bounded)
{
    return unknowns * (2 * (band + 1) + B + 1) + 3 * (unknowns + B) +
           (int64_t)((sizeof(chunk) + B * sizeof(both)) / sizeof(double)) * chunks_of(bounded);
}

static double largest(const double *x, int64_t n)
{
    double most = 0.0;
    for (int64_t i = 0; i < n; i++)
        if (!(fabs(x[i]) <= most)) /* keeps a NaN */
            most = fabs(x[i]);
    return most;
}

static double sum_of(const both x)
{
    double four[4] = {0.0, 0.0, 0.0, 0.0};
    for (int k = 0; k < SIDES; k++)
        four[k % 4] += x[k];
    return (four[0] + four[2]) + (four[1] + four[3]);
}

static double most_of(const both x)
{
    double most = x[0];
    for (int k = 1; k < SIDES; k++)
        if (!(x[k] <= most))
            most = x[k];
    return most;
}

/* ---- rows ------------------------------------------------------------------------------------ */

/* Whether a row is to be met, whatever w. */
static int is_met(const work *w, int64_t i, int l)
{
    int met = w->p->low[i * LANES + l] == w->p->high[i * LANES + l];
    for (int b = 0; b < w->p->border; b++) {
        both *beside = w->beside + i * w->p->border + b;
        met = met && (*beside)[l] == 0.0 && (*beside)[LANES + l] == 0.0;
    }
    return met;
}

/* What each side has of a row's product and of the border. */
static inline void at_sides(const work *w, int64_t i, const double y[LANES], const double *tail,
                            both out)
{
    const chunk *o = w->of + i;
    for (int k = 0; k < SIDES; k++)
        out[k] = y[k % LANES];
    for (int b = 0; b < w->p->border; b++) {
        both *beside = w->beside + i * w->p->border + b;
        for (int k = 0; k < SIDES; k++)
            out[k] += (*beside)[k] * tail[b];
    }
    for (int k = 0; k < SIDES; k++)
        out[k] *= o->side[k];
}

/* tail += what the border has of each side's share. */
static inline void to_border(const work *w, int64_t i, const both share, double *tail)
{
    const chunk *o = w->of + i;
    for (int b = 0; b < w->p->border; b++) {
        both *beside = w->beside + i * w->p->border + b;
        both sum;
        for (int k = 0; k < SIDES; k++)
            sum[k] = o->side[k] * share[k] * (*beside)[k];
        tail[b] += sum_of(sum);
    }
}

/* ---- the matrix of a step -------------------------------------------------------------------- */

/* Bounds' share of the border: q = z / s of the sides. */
static inline void add_border(work *w, int64_t i, const both q)
{
    const chunk *o = w->of + i;
    int32_t border = w->p->border;
    both *own = w->beside + i * border, share, corner;
    for (int b = 0; b < border; b++) {
        for (int k = 0; k < SIDES; k++)
            share[k] = q[k] * own[b][k];
        for (int a = 0; a <= b; a++) {
            for (int k = 0; k < SIDES; k++)
                corner[k] = share[k] * own[a][k];
            w->matrix.corner[b][a] += sum_of(corner);
        }
        for (int32_t e = 0; e < o->a.width; e++)
            for (int l = 0; l < LANES; l++)
                w->matrix.beside[o->a.at[e][l] * B + b] +=
                    (share[l] + share[LANES + l]) * o->a.value[e][l];
    }
}

/* ---- slacks and multipliers ------------------------------------------------------------------ */

/* The weights of rows, in the objective. */
static void add_weights(work *w, int32_t r, const coefficients *o)
{
    const sj_arrow *p = w->p;
    double weight[LANES] = {0.0}, pull[LANES] = {0.0};
    int any = 0;
    for (int32_t l = 0; l < LANES && r + l < p->rows; l++) {
        weight[l] = p->weight[r + l];
        pull[l] = -p->weight[r + l] * p->target[r + l];
        any = any || weight[l] != 0.0;
    }
    if (!any)
        return;
    add_squares(o, weight, p->band, w->H);
    scatter(o, pull, w->flat);
}

/* The bounds of a chunk, slacks and multipliers to begin with; how many bounds there are. */
static double begin_chunk(work *w, int64_t i)
{
    const sj_arrow *p = w->p;
    chunk *o = w->of + i;
    double y[LANES], count = 0.0;
    both at;
    for (int32_t l = 0; l < LANES; l++) {
        int64_t r = i * LANES + l;
        o->edge[l] = o->edge[LANES + l] = o->s[l] = o->s[LANES + l] = 1.0;
        if (r >= p->bounded)
            continue;
        for (int b = 0; b < p->border; b++)
            for (int k = 0; k < 2; k++)
                w->beside[i * p->border + b][k * LANES + l] =
                    p->beside[(2 * b + k) * (int64_t)p->bounded + r];
        for (int32_t e = 0; e < W; e++)
            o->size[l] += fabs(o->a.value[e][l]);
        if (is_met(w, i, l)) {
            o->stiff[l] = STIFF;
            o->place[l] = p->low[r];
            continue;
        }
        for (int k = 0; k < 2; k++) {
            double edge = -SIGN[k] * (k == 0 ? p->low[r] : p->high[r]);
            if (edge < INFINITY) {
                o->side[k * LANES + l] = SIGN[k];
                o->edge[k * LANES + l] = edge;
                count += 1.0;
            }
        }
    }
    products(&o->a, p->x, y);
    at_sides(w, i, y, p->x + w->n, at);
    for (int k = 0; k < SIDES; k++)
        if (o->side[k] != 0.0) {
            o->s[k] = fmax(at[k] + o->edge[k], p->room);
            o->z[k] = p->begin / o->s[k];
        }
    return count;
}

/* Objective and bounds; how many of these there are. */
static double begin(work *w)
{
    const sj_arrow *p = w->p;
    double count = 0.0;
    coefficients other;
    memset(w->H, 0, (size_t)(w->n * (p->band + 1)) * sizeof(double));
    memset(w->of, 0, (size_t)w->chunks * sizeof(chunk));
    memset(w->beside, 0, (size_t)(w->chunks * p->border) * sizeof(both));
    memcpy(w->flat, p->gradient, (size_t)(w->n + p->border) * sizeof(double));
    for (int64_t i = 0; i < chunks_of(p->rows); i++) {
        coefficients *o = i < w->chunks ? &w->of[i].a : &other;
        load(p, (int32_t)(i * LANES), o);
        add_weights(w, (int32_t)(i * LANES), o);
        if (i < w->chunks)
            count += begin_chunk(w, i);
    }
    return count;
}

typedef struct {
    both gap, wrong, outside;
} seen;

/* Products s z that are too small are raised. */
static void raise_products(chunk *o, double least)
{
    for (int k = 0; k < SIDES; k++) {
        double *s = &o->s[k], *z = &o->z[k];
        if (o->side[k] == 0.0 || *s * *z >= least)
            continue;
        if (*s < *z)
            *s = least / *z;
        else
            *z = least / *s;
    }
}

/* A step's end: slacks and multipliers, what they are wrong by; the rows' share of the gradient of the
 * Lagrangian, of the matrix, and of the right side (dx) for products s z of 0. */
static void look_chunk(work *w, int64_t i, double step, seen *all)
{
    const sj_arrow *p = w->p;
    chunk *restrict o = w->of + i;
    double y[LANES], net[LANES], right[LANES], weight[LANES], least = w->least;
    both at, q, back, low;
    seen found = *all;
    products(&o->a, p->x, y);
    at_sides(w, i, y, p->x + w->n, at);
    for (int k = 0; k < SIDES; k++) {
        o->s[k] += step * o->ds[k];
        o->z[k] += step * o->dz[k];
    }
    for (int k = 0; k < SIDES; k++)
        low[k] = least * o->side[k] * o->side[k] - o->s[k] * o->z[k];
    if (most_of(low) > 0.0)
        raise_products(o, least);
    for (int k = 0; k < SIDES; k++) {
        double distance = at[k] + o->edge[k], r = distance - o->s[k], wrong;
        double there = o->side[k] * o->side[k], s = o->s[k], z = o->z[k];
        double over = 1.0 / (s * z + (1.0 - there));
        o->per_s[k] = z * over;
        o->per_z[k] = s * over;
        o->r[k] = r;
        q[k] = z * z * over;
        back[k] = -z - q[k] * r;
        wrong = fabs(r) - EPSILON * (o->size[k % LANES] + fabs(o->edge[k]));
        found.gap[k] += s * z;
        found.wrong[k] = found.wrong[k] < wrong ? wrong : found.wrong[k];
        found.outside[k] = found.outside[k] < -distance ? -distance : found.outside[k];
    }
    for (int l = 0; l < LANES; l++) {
        double off = o->stiff[l] > 0.0 ? y[l] - o->place[l] : 0.0;
        o->off[l] = off;
        o->y[l] += step * o->dy[l];
        found.wrong[l] = found.wrong[l] < fabs(off) ? fabs(off) : found.wrong[l];
        found.outside[l] = found.outside[l] < fabs(off) ? fabs(off) : found.outside[l];
        net[l] = o->z[LANES + l] - o->z[l] - o->y[l];
        weight[l] = o->stiff[l] + q[l] + q[LANES + l];
        right[l] = back[l] - back[LANES + l] - o->stiff[l] * off;
    }
    *all = found;
    scatter(&o->a, net, w->grad);
    scatter(&o->a, right, w->dx);
    add_squares(&o->a, weight, p->band, w->matrix.columns);
    if (p->border > 0) {
        both less;
        for (int k = 0; k < SIDES; k++)
            less[k] = -o->z[k];
        to_border(w, i, less, w->grad + w->n);
        to_border(w, i, back, w->dx + w->n);
        add_border(w, i, q);
    }
}

static void look(work *w, double step, sj_arrow_result *result)
{
    const sj_arrow *p = w->p;
    seen found = {{0.0}, {0.0}, {0.0}};
    memcpy(w->grad, w->flat, (size_t)(w->n + p->border) * sizeof(double));
    sj_band_add_product(w->H, w->n, p->band, p->x, w->grad);
    memset(w->dx, 0, (size_t)(w->n + B) * sizeof(double));
    memcpy(w->matrix.columns, w->H, (size_t)(w->n * (p->band + 1)) * sizeof(double));
    memset(w->matrix.beside, 0, (size_t)(w->n * B) * sizeof(double));
    memset(w->matrix.corner, 0, sizeof w->matrix.corner);
    for (int64_t i = 0; i < w->chunks; i++)
        look_chunk(w, i, step, &found);
    result->gap = sum_of(found.gap);
    result->wrong = most_of(found.wrong);
    result->outside = most_of(found.outside);
    result->steep = largest(w->grad, w->n + p->border);
}

typedef struct {
    both most, first, second;
} along;

/* What slacks and multipliers do along dx, where products change by c. */
static void follow_chunk(work *w, int64_t i, int corrected, along *all)
{
    chunk *restrict o = w->of + i;
    along found = *all;
    double y[LANES];
    both move;
    products(&o->a, w->dx, y);
    at_sides(w, i, y, w->dx + w->n, move);
    if (!corrected)
        for (int k = 0; k < SIDES; k++)
            o->c[k] = -o->s[k] * o->z[k];
    for (int k = 0; k < SIDES; k++) {
        double s = o->s[k], z = o->z[k], ds = move[k] + o->r[k];
        double dz = (o->c[k] - z * ds) * o->per_s[k];
        double one = -ds * o->per_s[k], two = -dz * o->per_z[k];
        o->ds[k] = ds;
        o->dz[k] = dz;
        one = one < two ? two : one;
        found.most[k] = found.most[k] < one ? one : found.most[k];
        found.first[k] += s * dz + z * ds;
        found.second[k] += ds * dz;
    }
    for (int l = 0; l < LANES; l++)
        o->dy[l] = -o->stiff[l] * (o->off[l] + y[l]);
    *all = found;
}

static void follow(work *w, int corrected)
{
    along found = {{0.0}, {0.0}, {0.0}};
    for (int64_t i = 0; i < w->chunks; i++)
        follow_chunk(w, i, corrected, &found);
    w->longest = 1.0 / fmax(most_of(found.most), BOUNDARY);
    w->first = sum_of(found.first);
    w->second = sum_of(found.second);
}

/* The right side (dx) where products s z are to come to `middle`; with the second order of the step before. */
static void correct_chunk(work *w, int64_t i, double middle, double second)
{
    chunk *restrict o = w->of + i;
    double right[LANES];
    both q;
    for (int k = 0; k < SIDES; k++) {
        double c = middle - o->s[k] * o->z[k] - second * o->ds[k] * o->dz[k];
        o->c[k] = c;
        q[k] = (c - o->z[k] * o->r[k]) * o->per_s[k];
    }
    for (int l = 0; l < LANES; l++)
        right[l] = q[l] - q[LANES + l] - o->stiff[l] * o->off[l];
    scatter(&o->a, right, w->dx);
    to_border(w, i, q, w->dx + w->n);
}

static void correct(work *w, double middle, double second)
{
    memset(w->dx, 0, (size_t)(w->n + B) * sizeof(double));
    for (int64_t i = 0; i < w->chunks; i++)
        correct_chunk(w, i, middle, second);
}

static void direction(work *w, int corrected)
{
    for (int64_t i = 0; i < w->n + w->p->border; i++)
        w->dx[i] -= w->grad[i];
    sj_bordered_solve(&w->matrix, w->dx);
    follow(w, corrected);
}

/* Predictor, corrector, and the step of x; the gap is `sum` over `bounds` products. */
static void advance(work *w, double sum, double bounds)
{
    sj_bordered_factorise(&w->matrix);
    direction(w, 0);
    if (bounds > 0.0) {
        double step = fmin(1.0, w->longest);
        double sigma = (sum + step * (w->first + step * w->second)) / sum;
        int near = w->step >= SHORT;
        correct(w, (near ? sigma * sigma * sigma : 1.0) * sum / bounds, near ? 1.0 : 0.0);
        direction(w, 1);
    }
    w->last = w->step;
    w->step = fmin(1.0, BOUNDARY * w->longest);
    if (bounds > 0.0)
        w->least = BEHIND * (sum + w->step * (w->first + w->step * w->second)) / bounds;
    for (int64_t i = 0; i < w->n + w->p->border; i++)
        w->p->x[i] += w->step * w->dx[i];
}

void sj_arrow_solve(const sj_arrow *p, sj_arrow_result *result)
{
    work w = {.p = p, .n = p->unknowns, .chunks = chunks_of(p->bounded), .step = 1.0, .last = 1.0};
    double bounds, *next = p->spare, step = 0.0;
    double size = fmax(1.0, largest(p->gradient, w.n + p->border));
    w.H = next, next += w.n * (p->band + 1);
    w.matrix = (sj_bordered){.n = w.n, .band = p->band, .border = p->border};
    w.matrix.columns = next, next += w.n * (p->band + 1);
    w.matrix.beside = next, next += w.n * B;
    w.matrix.size = next, next += w.n;
    w.dx = next, next += w.n + B;
    w.grad = next, next += w.n + B;
    w.flat = next, next += w.n + B;
    w.of = (chunk *)(void *)next;
    w.beside = (both *)(void *)(w.of + w.chunks);
    bounds = begin(&w);
    for (result->steps = 0;; result->steps++, step = w.step) {
        look(&w, step, result);
        if (!(result->wrong < 1e300) || !(result->gap < 1e300)) {
            result->status = SJ_ARROW_LOST;
            return;
        }
        if (result->wrong <= MISSED && result->gap <= p->near &&
            (result->steep <= 1e-6 * size || (bounds > 0.0 && result->gap <= 1e-3 * p->near))) {
            result->status = SJ_ARROW_OK;
            return;
        }
        if (result->steps == p->most || fmax(w.step, w.last) < STUCK) {
            result->status = SJ_ARROW_MOST;
            return;
        }
        advance(&w, result->gap, bounds);
    }
}
