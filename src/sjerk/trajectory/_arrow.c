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

/* A row missed by less is met, besides the rounding of its coefficients, which may be 10^8. A step shorter than this is
 * followed by one to the middle. A product s z stays above this share of their mean: slacks smaller than
 * the rounding of their rows would hold up all steps. */
static const double MISSED = 4e-10, EPSILON = 1e-15, SHORT = 0.1, BEHIND = 1e-3;

/* Exact way-points make rows 10^16 times as stiff as others: what is left of a diagonal below this share of
 * it is rounding, and is replaced by another, so that the step stays along the others. */
static const double ROUNDING = 1e-14, DEPENDENT = 1e-10;

/* A bound of a row: slack and multiplier (0: there is no bound), their steps, 1 / slack, what s z is to
 * change by, and what the slack is wrong by. */
typedef struct {
    double s, z, ds, dz, over, c, r;
} bound;

typedef struct {
    const sj_arrow *p;
    int64_t n;
    double *L; /* (n, band + 1): column j from its diagonal down */
    double *M; /* (n, B) */
    double C[B][B];
    double *size;      /* (n): of the diagonal before it is eliminated */
    double *dx, *grad; /* (n + B) */
    bound *of;         /* (rows, 2): low, high */
    double step;       /* the last one's length */
    double longest; /* the step that leaves slacks and multipliers positive, up to 1 / BOUNDARY */
    double least;   /* what a product s z is raised to */
    double first, second; /* of the sum of s z along the step */
} work;

static const double SIGN[2] = {1.0, -1.0};

enum { PER_BOUND = (int)(sizeof(bound) / sizeof(double)) };

int64_t sj_arrow_spare(int64_t unknowns, int32_t band, int64_t rows)
{
    return unknowns * (band + 2 + B) + 2 * (unknowns + B) + 2 * PER_BOUND * rows;
}

static double limit(const sj_arrow *p, int64_t r, int k) { return k == 0 ? p->low[r] : p->high[r]; }

static const double *border(const sj_arrow *p, int64_t r, int k)
{
    return (k == 0 ? p->beside_low : p->beside_high) + r * B;
}

static double product(const sj_arrow *p, int64_t r, const double *x)
{
    const int32_t *at = p->at + r * W;
    const double *value = p->value + r * W;
    return value[0] * x[at[0]] + value[1] * x[at[1]] + value[2] * x[at[2]] + value[3] * x[at[3]] +
           value[4] * x[at[4]];
}

static double size(const sj_arrow *p, int64_t r)
{
    const double *value = p->value + r * W;
    return fabs(value[0]) + fabs(value[1]) + fabs(value[2]) + fabs(value[3]) + fabs(value[4]);
}

static void gather(const sj_arrow *p, int64_t r, double share, double *out)
{
    const int32_t *at = p->at + r * W;
    const double *value = p->value + r * W;
    for (int i = 0; i < W; i++)
        out[at[i]] += share * value[i];
}

/* ---- the matrix of a step -------------------------------------------------------------------- */

static void assemble(work *w, int64_t r)
{
    const sj_arrow *p = w->p;
    int64_t stride = p->band + 1;
    const int32_t *at = p->at + r * W;
    const double *value = p->value + r * W;
    double o = p->weight[r], m0 = 0.0, m1 = 0.0;
    for (int k = 0; k < 2; k++) {
        const double *b = border(p, r, k);
        double q = w->of[2 * r + k].z * w->of[2 * r + k].over;
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

static void factorise(work *w)
{
    int64_t band = w->p->band, stride = band + 1;
    for (int64_t j = 0; j < w->n; j++)
        w->size[j] = w->L[j * stride];
    for (int64_t j = 0; j < w->n; j++) {
        double *column = w->L + j * stride, *m = w->M + j * B;
        double diagonal = column[0] + HOLD, over;
        int64_t depth = w->n - 1 - j < band ? w->n - 1 - j : band;
        if (!(diagonal > ROUNDING * w->size[j]))
            diagonal = DEPENDENT * w->size[j] + HOLD;
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

/* Slacks and multipliers to begin with; how many bounds there are. */
static double begin(work *w)
{
    const sj_arrow *p = w->p;
    const double *tail = p->x + w->n;
    double count = 0.0;
    for (int64_t r = 0; r < p->rows; r++) {
        double y = product(p, r, p->x);
        for (int k = 0; k < 2; k++) {
            bound *o = w->of + 2 * r + k;
            const double *b = border(p, r, k);
            double most = limit(p, r, k);
            int there = most * SIGN[k] > -INFINITY;
            memset(o, 0, sizeof *o);
            o->s = there ? fmax(SIGN[k] * (y + b[0] * tail[0] + b[1] * tail[1] - most), 1.0) : 1.0;
            o->z = there ? p->begin / o->s : 0.0;
            count += there;
        }
    }
    return count;
}

/* A step's end: slacks and multipliers, what they are wrong by, the gradient of the Lagrangian, the matrix
 * and the right side (dx) for products s z of 0. The sum of s z. */
static double look(work *w, double step, double *wrong)
{
    const sj_arrow *p = w->p;
    const double *x = p->x + w->n;
    double sum = 0.0, *tail = w->grad + w->n, *side = w->dx + w->n;
    memcpy(w->grad, p->gradient, (size_t)(w->n + B) * sizeof(double));
    memset(w->dx, 0, (size_t)(w->n + B) * sizeof(double));
    memset(w->L, 0, (size_t)(w->n * (p->band + 1)) * sizeof(double));
    memset(w->M, 0, (size_t)(w->n * B) * sizeof(double));
    memset(w->C, 0, sizeof w->C);
    *wrong = 0.0;
    for (int64_t r = 0; r < p->rows; r++) {
        double y = product(p, r, p->x), share = p->weight[r] * (y - p->target[r]), right = 0.0;
        for (int k = 0; k < 2; k++) {
            bound *o = w->of + 2 * r + k;
            const double *b = border(p, r, k);
            double z, q;
            if (o->z == 0.0)
                continue;
            o->s += step * o->ds;
            o->z += step * o->dz;
            if (o->s * o->z < w->least) {
                if (o->s < o->z)
                    o->s = w->least / o->z;
                else
                    o->z = w->least / o->s;
            }
            o->over = 1.0 / o->s;
            o->r = SIGN[k] * (y + b[0] * x[0] + b[1] * x[1] - limit(p, r, k)) - o->s;
            if (!(fabs(o->r) <= *wrong))
                *wrong = fmax(*wrong, fabs(o->r) - EPSILON * (size(p, r) + fabs(limit(p, r, k))));
            sum += o->s * o->z;
            z = SIGN[k] * o->z;
            q = -z * (1.0 + o->r * o->over);
            share -= z;
            right += q;
            tail[0] -= z * b[0];
            tail[1] -= z * b[1];
            side[0] += q * b[0];
            side[1] += q * b[1];
        }
        if (share != 0.0)
            gather(p, r, share, w->grad);
        if (right != 0.0)
            gather(p, r, right, w->dx);
        assemble(w, r);
    }
    return sum;
}

/* What slacks and multipliers do along dx, where products change by c. */
static void follow(work *w, int corrected)
{
    const sj_arrow *p = w->p;
    const double *tail = w->dx + w->n;
    double most = 1.0 / BOUNDARY;
    w->first = w->second = 0.0;
    for (int64_t r = 0; r < p->rows; r++) {
        double dy = product(p, r, w->dx);
        for (int k = 0; k < 2; k++) {
            bound *o = w->of + 2 * r + k;
            const double *b = border(p, r, k);
            if (o->z == 0.0)
                continue;
            if (!corrected)
                o->c = -o->s * o->z;
            o->ds = SIGN[k] * (dy + b[0] * tail[0] + b[1] * tail[1]) + o->r;
            o->dz = (o->c - o->z * o->ds) * o->over;
            if (o->ds * most < -o->s)
                most = -o->s / o->ds;
            if (o->dz * most < -o->z)
                most = -o->z / o->dz;
            w->first += o->s * o->dz + o->z * o->ds;
            w->second += o->ds * o->dz;
        }
    }
    w->longest = most;
}

/* The right side (dx) where products s z are to come to `middle`; with the second order of the step before. */
static void correct(work *w, double middle, double second)
{
    const sj_arrow *p = w->p;
    double *tail = w->dx + w->n;
    memset(w->dx, 0, (size_t)(w->n + B) * sizeof(double));
    for (int64_t r = 0; r < p->rows; r++) {
        double share = 0.0;
        for (int k = 0; k < 2; k++) {
            bound *o = w->of + 2 * r + k;
            const double *b = border(p, r, k);
            double q;
            if (o->z == 0.0)
                continue;
            o->c = middle - o->s * o->z - second * o->ds * o->dz;
            q = SIGN[k] * (o->c - o->z * o->r) * o->over;
            share += q;
            tail[0] += q * b[0];
            tail[1] += q * b[1];
        }
        if (share != 0.0)
            gather(p, r, share, w->dx);
    }
}

static void direction(work *w, int corrected)
{
    for (int64_t i = 0; i < w->n + B; i++)
        w->dx[i] -= w->grad[i];
    solve(w, w->dx);
    follow(w, corrected);
}

/* Predictor, corrector, and the step of x; the gap is `sum` over `bounds` products. */
static void advance(work *w, double sum, double bounds)
{
    factorise(w);
    direction(w, 0);
    if (bounds > 0.0) {
        double step = fmin(1.0, w->longest);
        double sigma = (sum + step * (w->first + step * w->second)) / sum;
        int near = w->step >= SHORT;
        correct(w, (near ? sigma * sigma * sigma : 1.0) * sum / bounds, near ? 1.0 : 0.0);
        direction(w, 1);
    }
    w->step = fmin(1.0, BOUNDARY * w->longest);
    if (bounds > 0.0)
        w->least = BEHIND * (sum + w->step * (w->first + w->step * w->second)) / bounds;
    for (int64_t i = 0; i < w->n + B; i++)
        w->p->x[i] += w->step * w->dx[i];
}

int32_t sj_arrow_solve(const sj_arrow *p)
{
    work w = {.p = p, .n = p->unknowns, .step = 1.0};
    double bounds, *next = p->spare, step = 0.0;
    w.L = next, next += w.n * (p->band + 1);
    w.M = next, next += w.n * B;
    w.size = next, next += w.n;
    w.dx = next, next += w.n + B;
    w.grad = next, next += w.n + B;
    w.of = (bound *)(void *)next;
    bounds = begin(&w);
    for (int32_t round = 0;; round++, step = w.step) {
        double wrong, sum = look(&w, step, &wrong), steep = 0.0, size = 1.0;
        for (int64_t i = 0; i < w.n + B; i++) {
            steep = fmax(steep, fabs(w.grad[i]));
            size = fmax(size, fabs(p->gradient[i]));
        }
        p->told[0] = round, p->told[1] = wrong, p->told[2] = sum, p->told[3] = steep;
        if (!(wrong < 1e300) || !(sum < 1e300))
            return SJ_ARROW_LOST;
        if (wrong <= MISSED && sum <= p->near && (steep <= 1e-6 * size || sum <= 1e-3 * p->near))
            return SJ_ARROW_OK;
        if (round == p->most)
            return SJ_ARROW_MOST;
        advance(&w, sum, bounds);
    }
}
