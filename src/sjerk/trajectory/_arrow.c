/* Convex quadratic programmes of splines: banded unknowns, and two that every row may have.
 *
 * The unknowns stand in order of time, so that a row's lie within `band` of each other; the last two (a
 * pace of time, an excess) are the border. The matrix of a Newton step is then a band with a border
 * (an arrow), and its Cholesky factor is one too:
 *     [ L   ]     L banded, M = B L^-T, C the factor of the corner less M M'.
 *     [ M C ]
 * Method: the primal-dual interior point method with Mehrotra's predictor and corrector (Nocedal and
 * Wright, Numerical Optimization, sections 14.2 and 16.6). Every bound of a row has a slack s > 0, free
 * to be wrong at first, and a multiplier z > 0; a step solves, with omega = weight + sum of z / s,
 *     (sum of omega a a') dx = - gradient of the Lagrangian + sum of a (c - z r) / s,
 * where c is what s z is to become less what it is, and r what the slack is wrong by.
 * Never here: what the rows mean, memory of its own, time.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include "trajectory/_arrow.h"

enum { W = SJ_ARROW_WIDTH, B = SJ_ARROW_BORDER };

/* Share of the way to the nearest bound that a step takes, and what every unknown is held by. */
static const double BOUNDARY = 0.995, HOLD = 1e-11;

/* A row missed by less is met: rounding of rows whose coefficients are 10^5. A step shorter than this is
 * followed by one to the middle: some product s z was far behind the others. */
static const double MISSED = 4e-10, SHORT = 0.1;

/* A bound of every row: value of the row with its border, slack, multiplier, their steps, 1 / slack, what
 * s z is to change by, and what the slack is wrong by. */
typedef struct {
    double sign; /* 1: low, -1: high */
    const double *bound, *beside;
    double *y, *s, *z, *ds, *dz, *over, *c, *r;
} side;

typedef struct {
    const sj_arrow *p;
    int64_t n;
    double *L; /* (n, band + 1): column j from its diagonal down */
    double *M; /* (n, B) */
    double C[B][B];
    double *dx, *grad; /* (n + B) */
    double *y;         /* (rows): without their border */
    double step;       /* the last one's length */
    side of[2];
} work;

enum { PER_SIDE = 8 };

int64_t sj_arrow_spare(int64_t unknowns, int32_t band, int64_t rows)
{
    return unknowns * (band + 1 + B) + 2 * (unknowns + B) + (1 + 2 * PER_SIDE) * rows;
}

static int is_there(const side *o, int64_t r) { return o->bound[r] * o->sign > -INFINITY; }

static double product(const sj_arrow *p, int64_t r, const double *x)
{
    const int32_t *at = p->at + r * W;
    const double *value = p->value + r * W;
    return value[0] * x[at[0]] + value[1] * x[at[1]] + value[2] * x[at[2]] + value[3] * x[at[3]] +
           value[4] * x[at[4]];
}

static double beside(const side *o, int64_t r, const double *tail)
{
    return o->beside[r * B] * tail[0] + o->beside[r * B + 1] * tail[1];
}

static void gather(const sj_arrow *p, int64_t r, double share, double *out)
{
    const int32_t *at = p->at + r * W;
    const double *value = p->value + r * W;
    for (int i = 0; i < W; i++)
        out[at[i]] += share * value[i];
}

/* ---- the matrix of a step -------------------------------------------------------------------- */

static void assemble(work *w)
{
    const sj_arrow *p = w->p;
    int64_t stride = p->band + 1;
    memset(w->L, 0, (size_t)(w->n * stride) * sizeof(double));
    memset(w->M, 0, (size_t)(w->n * B) * sizeof(double));
    memset(w->C, 0, sizeof w->C);
    for (int64_t r = 0; r < p->rows; r++) {
        const int32_t *at = p->at + r * W;
        const double *value = p->value + r * W;
        double o = p->weight[r], m0 = 0.0, m1 = 0.0;
        for (int k = 0; k < 2; k++) {
            const side *f = &w->of[k];
            const double *b = f->beside + r * B;
            double q = f->z[r] * f->over[r];
            o += q;
            m0 += q * b[0];
            m1 += q * b[1];
            w->C[0][0] += q * b[0] * b[0];
            w->C[1][0] += q * b[1] * b[0];
            w->C[1][1] += q * b[1] * b[1];
        }
        for (int i = 0; i < W; i++) {
            double s = o * value[i], *column = w->L + at[i] * stride - at[i];
            if (value[i] == 0.0)
                continue;
            for (int k = i; k < W; k++)
                column[at[k]] += s * value[k];
            w->M[at[i] * B] += m0 * value[i];
            w->M[at[i] * B + 1] += m1 * value[i];
        }
    }
}

static void factorise(work *w)
{
    int64_t band = w->p->band, stride = band + 1;
    for (int64_t j = 0; j < w->n; j++) {
        double *column = w->L + j * stride, *m = w->M + j * B;
        double diagonal = column[0] + HOLD, over;
        int64_t depth = w->n - 1 - j < band ? w->n - 1 - j : band;
        if (!(diagonal > 1e-300))
            diagonal = 1e300;
        column[0] = sqrt(diagonal);
        over = 1.0 / column[0];
        for (int64_t i = 1; i <= depth; i++)
            column[i] *= over;
        m[0] *= over;
        m[1] *= over;
        for (int64_t i = 1; i <= depth; i++) {
            double s = column[i], *to = column + i * stride;
            const double *from = column + i;
            if (s == 0.0)
                continue;
            for (int64_t k = 0; k <= depth - i; k++)
                to[k] -= s * from[k];
            m[i * B] -= s * m[0];
            m[i * B + 1] -= s * m[1];
        }
        w->C[0][0] -= m[0] * m[0];
        w->C[1][0] -= m[1] * m[0];
        w->C[1][1] -= m[1] * m[1];
    }
    w->C[0][0] = sqrt(fmax(w->C[0][0], 0.0) + HOLD);
    w->C[1][0] /= w->C[0][0];
    w->C[1][1] = sqrt(fmax(w->C[1][1] - w->C[1][0] * w->C[1][0], 0.0) + HOLD);
}

static void solve(const work *w, double *x)
{
    int64_t band = w->p->band, stride = band + 1, n = w->n;
    double *tail = x + n;
    for (int64_t j = 0; j < n; j++) {
        const double *column = w->L + j * stride, *m = w->M + j * B;
        int64_t depth = n - 1 - j < band ? n - 1 - j : band;
        double s = x[j] /= column[0];
        for (int64_t i = 1; i <= depth; i++)
            x[j + i] -= s * column[i];
        tail[0] -= s * m[0];
        tail[1] -= s * m[1];
    }
    tail[0] /= w->C[0][0];
    tail[1] = (tail[1] - w->C[1][0] * tail[0]) / w->C[1][1];
    tail[1] /= w->C[1][1];
    tail[0] = (tail[0] - w->C[1][0] * tail[1]) / w->C[0][0];
    for (int64_t j = n - 1; j >= 0; j--) {
        const double *column = w->L + j * stride, *m = w->M + j * B;
        int64_t depth = n - 1 - j < band ? n - 1 - j : band;
        double s = x[j] - m[0] * tail[0] - m[1] * tail[1];
        for (int64_t i = 1; i <= depth; i++)
            s -= column[i] * x[j + i];
        x[j] = s / column[0];
    }
}

/* ---- slacks and multipliers ------------------------------------------------------------------ */

static void evaluate(work *w)
{
    const sj_arrow *p = w->p;
    const double *tail = p->x + w->n;
    for (int64_t r = 0; r < p->rows; r++) {
        w->y[r] = product(p, r, p->x);
        for (int k = 0; k < 2; k++)
            w->of[k].y[r] = w->y[r] + beside(&w->of[k], r, tail);
    }
}

static void begin(work *w, double mu)
{
    for (int k = 0; k < 2; k++) {
        side *o = &w->of[k];
        for (int64_t r = 0; r < w->p->rows; r++) {
            int there = is_there(o, r);
            o->s[r] = there ? fmax(o->sign * (o->y[r] - o->bound[r]), 1.0) : 1.0;
            o->z[r] = there ? mu : 0.0;
        }
    }
}

/* Gradient of the Lagrangian, wrongness, and 1 / slack; the sum of s z. */
static double look(work *w, double *wrong)
{
    const sj_arrow *p = w->p;
    double sum = 0.0, *tail = w->grad + w->n;
    memcpy(w->grad, p->gradient, (size_t)(w->n + B) * sizeof(double));
    *wrong = 0.0;
    for (int64_t r = 0; r < p->rows; r++) {
        double share = p->weight[r] * (w->y[r] - p->target[r]);
        for (int k = 0; k < 2; k++) {
            side *o = &w->of[k];
            double z = o->sign * o->z[r];
            o->over[r] = 1.0 / o->s[r];
            o->r[r] = is_there(o, r) ? o->sign * (o->y[r] - o->bound[r]) - o->s[r] : 0.0;
            if (fabs(o->r[r]) > *wrong)
                *wrong = fabs(o->r[r]);
            sum += o->s[r] * o->z[r];
            share -= z;
            tail[0] -= z * o->beside[r * B];
            tail[1] -= z * o->beside[r * B + 1];
        }
        if (share != 0.0)
            gather(p, r, share, w->grad);
    }
    return sum;
}

/* The step for what s z is to become (c). */
static void direction(work *w)
{
    const sj_arrow *p = w->p;
    double *tail = w->dx + w->n;
    for (int64_t i = 0; i < w->n + B; i++)
        w->dx[i] = -w->grad[i];
    for (int64_t r = 0; r < p->rows; r++) {
        double share = 0.0;
        for (int k = 0; k < 2; k++) {
            const side *o = &w->of[k];
            double q = o->sign * (o->c[r] - o->z[r] * o->r[r]) * o->over[r];
            share += q;
            tail[0] += q * o->beside[r * B];
            tail[1] += q * o->beside[r * B + 1];
        }
        if (share != 0.0)
            gather(p, r, share, w->dx);
    }
    solve(w, w->dx);
    for (int64_t r = 0; r < p->rows; r++) {
        double dy = product(p, r, w->dx);
        for (int k = 0; k < 2; k++) {
            side *o = &w->of[k];
            if (o->z[r] == 0.0)
                continue;
            o->ds[r] = o->sign * (dy + beside(o, r, tail)) + o->r[r];
            o->dz[r] = (o->c[r] - o->z[r] * o->ds[r]) * o->over[r];
        }
    }
}

/* The longest step, up to 1 / BOUNDARY, that leaves slacks and multipliers positive. */
static double longest(const work *w)
{
    double most = 1.0 / BOUNDARY;
    for (int k = 0; k < 2; k++) {
        const side *o = &w->of[k];
        for (int64_t r = 0; r < w->p->rows; r++) {
            if (o->ds[r] * most < -o->s[r])
                most = -o->s[r] / o->ds[r];
            if (o->dz[r] * most < -o->z[r])
                most = -o->z[r] / o->dz[r];
        }
    }
    return most;
}

/* Predictor, corrector, and the step itself; the gap is `sum` over `bounds` products. */
static void advance(work *w, double sum, double bounds)
{
    const sj_arrow *p = w->p;
    double step, after = 0.0, mu = sum / fmax(bounds, 1.0), sigma;
    assemble(w);
    factorise(w);
    for (int k = 0; k < 2; k++)
        for (int64_t r = 0; r < p->rows; r++)
            w->of[k].c[r] = -w->of[k].s[r] * w->of[k].z[r];
    direction(w);
    if (bounds > 0.0) {
        step = fmin(1.0, longest(w));
        for (int k = 0; k < 2; k++) {
            const side *o = &w->of[k];
            for (int64_t r = 0; r < p->rows; r++)
                after += (o->s[r] + step * o->ds[r]) * (o->z[r] + step * o->dz[r]);
        }
        sigma = after / sum;
        sigma = w->step < SHORT ? 1.0 : sigma * sigma * sigma;
        for (int k = 0; k < 2; k++) {
            side *o = &w->of[k];
            for (int64_t r = 0; r < p->rows; r++)
                if (o->z[r] > 0.0)
                    o->c[r] += sigma * mu - (w->step < SHORT ? 0.0 : o->ds[r] * o->dz[r]);
        }
        direction(w);
    }
    step = w->step = fmin(1.0, BOUNDARY * longest(w));
    for (int64_t i = 0; i < w->n + B; i++)
        p->x[i] += step * w->dx[i];
    for (int k = 0; k < 2; k++) {
        side *o = &w->of[k];
        for (int64_t r = 0; r < p->rows; r++) {
            o->s[r] += step * o->ds[r];
            o->z[r] += step * o->dz[r];
        }
    }
    evaluate(w);
}

static void divide(work *w)
{
    const sj_arrow *p = w->p;
    double *next = p->spare;
    w->L = next, next += w->n * (p->band + 1);
    w->M = next, next += w->n * B;
    w->dx = next, next += w->n + B;
    w->grad = next, next += w->n + B;
    w->y = next, next += p->rows;
    memset(next, 0, (size_t)(2 * PER_SIDE * p->rows) * sizeof(double));
    for (int k = 0; k < 2; k++) {
        side *o = &w->of[k];
        double **column[PER_SIDE] = {&o->y, &o->s, &o->z, &o->ds, &o->dz, &o->over, &o->c, &o->r};
        o->sign = k == 0 ? 1.0 : -1.0;
        o->bound = k == 0 ? p->low : p->high;
        o->beside = k == 0 ? p->beside_low : p->beside_high;
        for (int i = 0; i < PER_SIDE; i++)
            *column[i] = next, next += p->rows;
    }
}

int32_t sj_arrow_solve(const sj_arrow *p)
{
    work w = {.p = p, .n = p->unknowns, .step = 1.0};
    double bounds = 0.0;
    divide(&w);
    evaluate(&w);
    begin(&w, p->begin);
    for (int k = 0; k < 2; k++)
        for (int64_t r = 0; r < p->rows; r++)
            bounds += is_there(&w.of[k], r);
    for (int32_t round = 0;; round++) {
        double wrong, sum = look(&w, &wrong), steep = 0.0, size = 1.0;
        for (int64_t i = 0; i < w.n + B; i++) {
            steep = fmax(steep, fabs(w.grad[i]));
            size = fmax(size, fabs(p->gradient[i]));
        }
        p->told[0] = round, p->told[1] = wrong, p->told[2] = sum, p->told[3] = steep;
        if (!(wrong < 1e300) || !(sum < 1e300))
            return SJ_ARROW_LOST;
        if (wrong <= MISSED && sum <= p->near &&
            (steep <= 1e-6 * size || sum <= 1e-3 * p->near))
            return SJ_ARROW_OK;
        if (round == p->most)
            return SJ_ARROW_MOST;
        advance(&w, sum, bounds);
    }
}
