/* Convex quadratic programmes of splines: banded unknowns and a few that every row may have.
 *
 * Minimise  g'x + 1/2 sum over rows of weight (a'x - target)^2   subject to   low <= a'x <= high.
 * The unknowns stand in order of time, so that a row's lie within `band` of each other; the last
 * `border` ones (a scale of time, an excess) may be in every row. The matrix of a Newton step is then
 * a band with a border (an arrow), and its Cholesky factor is one too:
 *     [ L   ]     L banded, M = B L^-T, C of the corner less M M'.
 *     [ M C ]
 * Method: the primal-dual interior point method with Mehrotra's predictor and corrector (Nocedal and
 * Wright, Numerical Optimization, sections 14.2 and 16.6), the rows' slacks free to be wrong at first.
 * Never here: what the rows mean, memory of its own, time.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include "trajectory/_arrow.h"

/* Share of the way to the nearest bound that a step takes, and what every unknown is held by. */
#define BOUNDARY 0.995
#define HOLD 1e-11

/* Per row: product, two slacks, two multipliers, their steps, weights and right sides. */
enum { Y, SL, SU, ZL, ZU, DY, DSL, DSU, DZL, DZU, CL, CU, OMEGA, PER_ROW };

typedef struct {
    const sj_arrow *p;
    int64_t n, all;     /* banded unknowns, with the border's */
    double *L;          /* (n, band + 1): column j from its diagonal down */
    double *M;          /* (n, border) */
    double *C;          /* (border, border) */
    double *dx, *rhs, *grad;
    double *row;        /* PER_ROW arrays of `rows` */
} work;

int64_t sj_arrow_spare(int64_t unknowns, int32_t band, int32_t border, int64_t rows)
{
    return unknowns * (band + 1 + border) + border * border + 3 * (unknowns + border)
         + PER_ROW * rows;
}

static double *rows_of(const work *w, int column) { return w->row + column * w->p->rows; }

static void product(const work *w, const double *x, double *y)
{
    const sj_arrow *p = w->p;
    for (int64_t r = 0; r < p->rows; r++) {
        const int32_t *at = p->at + r * p->width;
        const double *value = p->value + r * p->width;
        double sum = 0.0;
        for (int32_t i = 0; i < p->width; i++) sum += value[i] * x[at[i]];
        for (int32_t i = 0; i < p->border; i++) sum += p->across[r * p->border + i] * x[w->n + i];
        y[r] = sum;
    }
}

/* out += sum of the rows, each times its share. */
static void gather(const work *w, const double *share, double *out)
{
    const sj_arrow *p = w->p;
    for (int64_t r = 0; r < p->rows; r++) {
        const int32_t *at = p->at + r * p->width;
        const double *value = p->value + r * p->width;
        double s = share[r];
        if (s == 0.0) continue;
        for (int32_t i = 0; i < p->width; i++) out[at[i]] += s * value[i];
        for (int32_t i = 0; i < p->border; i++) out[w->n + i] += s * p->across[r * p->border + i];
    }
}

/* The matrix of the step: sum of omega a a'. A row's places do not fall. */
static void assemble(const work *w)
{
    const sj_arrow *p = w->p;
    int64_t stride = p->band + 1;
    int32_t b = p->border;
    const double *omega = rows_of(w, OMEGA);
    memset(w->L, 0, (size_t)(w->n * stride) * sizeof(double));
    memset(w->M, 0, (size_t)(w->n * b) * sizeof(double));
    memset(w->C, 0, (size_t)(b * b) * sizeof(double));
    for (int64_t r = 0; r < p->rows; r++) {
        const int32_t *at = p->at + r * p->width;
        const double *value = p->value + r * p->width, *across = p->across + r * b;
        double o = omega[r];
        if (o == 0.0) continue;
        for (int32_t i = 0; i < p->width; i++) {
            double s = o * value[i];
            double *column = w->L + at[i] * stride - at[i];
            if (s == 0.0) continue;
            for (int32_t k = i; k < p->width; k++) column[at[k]] += s * value[k];
            for (int32_t k = 0; k < b; k++) w->M[at[i] * b + k] += s * across[k];
        }
        for (int32_t i = 0; i < b; i++)
            for (int32_t k = 0; k < b; k++) w->C[i * b + k] += o * across[i] * across[k];
    }
}

static void factorise(const work *w)
{
    int64_t band = w->p->band, stride = band + 1;
    int32_t b = w->p->border;
    for (int64_t j = 0; j < w->n; j++) {
        double *column = w->L + j * stride, *m = w->M + j * b;
        double diagonal = column[0] + HOLD, over;
        int64_t depth = w->n - 1 - j < band ? w->n - 1 - j : band;
        if (!(diagonal > 1e-300)) diagonal = 1e300;
        column[0] = sqrt(diagonal);
        over = 1.0 / column[0];
        for (int64_t i = 1; i <= depth; i++) column[i] *= over;
        for (int32_t k = 0; k < b; k++) m[k] *= over;
        for (int64_t i = 1; i <= depth; i++) {
            double s = column[i], *to = column + i * stride, *mt = m + i * b;
            const double *from = column + i;
            if (s == 0.0) continue;
            for (int64_t k = 0; k <= depth - i; k++) to[k] -= s * from[k];
            for (int32_t k = 0; k < b; k++) mt[k] -= s * m[k];
        }
        for (int32_t i = 0; i < b; i++)
            for (int32_t k = 0; k < b; k++) w->C[i * b + k] -= m[i] * m[k];
    }
    for (int32_t i = 0; i < b; i++) { /* the corner: Cholesky, lower */
        for (int32_t k = 0; k <= i; k++) {
            double s = w->C[i * b + k];
            for (int32_t l = 0; l < k; l++) s -= w->C[i * b + l] * w->C[k * b + l];
            if (i == k) {
                s += HOLD;
                w->C[i * b + i] = sqrt(s > 1e-300 ? s : 1e300);
            } else {
                w->C[i * b + k] = s / w->C[k * b + k];
            }
        }
    }
}

static void solve(const work *w, double *x)
{
    int64_t band = w->p->band, stride = band + 1, n = w->n;
    int32_t b = w->p->border;
    double *tail = x + n;
    for (int64_t j = 0; j < n; j++) {
        const double *column = w->L + j * stride, *m = w->M + j * b;
        int64_t depth = n - 1 - j < band ? n - 1 - j : band;
        double s = x[j] /= column[0];
        for (int64_t i = 1; i <= depth; i++) x[j + i] -= s * column[i];
        for (int32_t k = 0; k < b; k++) tail[k] -= s * m[k];
    }
    for (int32_t i = 0; i < b; i++) {
        for (int32_t k = 0; k < i; k++) tail[i] -= w->C[i * b + k] * tail[k];
        tail[i] /= w->C[i * b + i];
    }
    for (int32_t i = b - 1; i >= 0; i--) {
        for (int32_t k = i + 1; k < b; k++) tail[i] -= w->C[k * b + i] * tail[k];
        tail[i] /= w->C[i * b + i];
    }
    for (int64_t j = n - 1; j >= 0; j--) {
        const double *column = w->L + j * stride, *m = w->M + j * b;
        int64_t depth = n - 1 - j < band ? n - 1 - j : band;
        double s = x[j];
        for (int64_t i = 1; i <= depth; i++) s -= column[i] * x[j + i];
        for (int32_t k = 0; k < b; k++) s -= m[k] * tail[k];
        x[j] = s / column[0];
    }
}

/* The rows' slacks and multipliers to begin with. */
static void begin(const work *w, double mu)
{
    const sj_arrow *p = w->p;
    double *sl = rows_of(w, SL), *su = rows_of(w, SU), *zl = rows_of(w, ZL), *zu = rows_of(w, ZU);
    const double *y = rows_of(w, Y);
    for (int64_t r = 0; r < p->rows; r++) {
        sl[r] = p->low[r] > -INFINITY ? fmax(y[r] - p->low[r], 1.0) : 1.0;
        su[r] = p->high[r] < INFINITY ? fmax(p->high[r] - y[r], 1.0) : 1.0;
        zl[r] = p->low[r] > -INFINITY ? mu : 0.0;
        zu[r] = p->high[r] < INFINITY ? mu : 0.0;
    }
}

/* Right side and steps for the complementarities wanted (CL, CU). */
static void direction(const work *w)
{
    const sj_arrow *p = w->p;
    const double *sl = rows_of(w, SL), *su = rows_of(w, SU), *zl = rows_of(w, ZL);
    const double *zu = rows_of(w, ZU), *y = rows_of(w, Y), *cl = rows_of(w, CL), *cu = rows_of(w, CU);
    double *dy = rows_of(w, DY), *dsl = rows_of(w, DSL), *dsu = rows_of(w, DSU);
    double *dzl = rows_of(w, DZL), *dzu = rows_of(w, DZU);
    for (int64_t r = 0; r < p->rows; r++) {
        double share = 0.0;
        if (p->low[r] > -INFINITY) share += (cl[r] - zl[r] * (y[r] - p->low[r] - sl[r])) / sl[r];
        if (p->high[r] < INFINITY) share -= (cu[r] - zu[r] * (p->high[r] - y[r] - su[r])) / su[r];
        dy[r] = share;
    }
    for (int64_t i = 0; i < w->all; i++) w->dx[i] = -w->grad[i];
    gather(w, dy, w->dx);
    memcpy(w->rhs, w->dx, (size_t)w->all * sizeof(double));
    solve(w, w->dx);
    product(w, w->dx, dy);
    for (int64_t r = 0; r < p->rows; r++) {
        dsl[r] = dsu[r] = dzl[r] = dzu[r] = 0.0;
        if (p->low[r] > -INFINITY) {
            dsl[r] = dy[r] + (y[r] - p->low[r] - sl[r]);
            dzl[r] = (cl[r] - zl[r] * dsl[r]) / sl[r];
        }
        if (p->high[r] < INFINITY) {
            dsu[r] = -dy[r] + (p->high[r] - y[r] - su[r]);
            dzu[r] = (cu[r] - zu[r] * dsu[r]) / su[r];
        }
    }
}

static double longest(const work *w, int value, int step)
{
    const double *v = rows_of(w, value), *d = rows_of(w, step);
    double most = 1.0 / BOUNDARY;
    for (int64_t r = 0; r < w->p->rows; r++)
        if (d[r] * most < -v[r]) most = -v[r] / d[r];
    return most;
}

int32_t sj_arrow_solve(const sj_arrow *p)
{
    work w = {.p = p, .n = p->unknowns, .all = p->unknowns + p->border};
    int64_t bounds = 0;
    double *next = p->spare, *y, *sl, *su, *zl, *zu;
    w.L = next, next += w.n * (p->band + 1);
    w.M = next, next += w.n * p->border;
    w.C = next, next += p->border * p->border;
    w.dx = next, next += w.all;
    w.rhs = next, next += w.all;
    w.grad = next, next += w.all;
    w.row = next;
    y = rows_of(&w, Y), sl = rows_of(&w, SL), su = rows_of(&w, SU);
    zl = rows_of(&w, ZL), zu = rows_of(&w, ZU);
    product(&w, p->x, y);
    begin(&w, p->begin);
    for (int64_t r = 0; r < p->rows; r++) bounds += (p->low[r] > -INFINITY) + (p->high[r] < INFINITY);
    for (int32_t round = 0; round <= p->most; round++) {
        double mu = 0.0, wrong = 0.0, steep = 0.0, primal, dual, after = 0.0, sigma, size = 1.0;
        double *share = rows_of(&w, DY), *omega = rows_of(&w, OMEGA);
        double *cl = rows_of(&w, CL), *cu = rows_of(&w, CU);
        for (int64_t r = 0; r < p->rows; r++) {
            share[r] = p->weight[r] * (y[r] - p->target[r]) - zl[r] + zu[r];
            omega[r] = p->weight[r];
            cl[r] = cu[r] = 0.0;
            if (p->low[r] > -INFINITY) {
                mu += sl[r] * zl[r];
                wrong = fmax(wrong, fabs(y[r] - p->low[r] - sl[r]));
                omega[r] += zl[r] / sl[r];
                cl[r] = -sl[r] * zl[r];
            }
            if (p->high[r] < INFINITY) {
                mu += su[r] * zu[r];
                wrong = fmax(wrong, fabs(p->high[r] - y[r] - su[r]));
                omega[r] += zu[r] / su[r];
                cu[r] = -su[r] * zu[r];
            }
        }
        memcpy(w.grad, p->gradient, (size_t)w.all * sizeof(double));
        gather(&w, share, w.grad);
        for (int64_t i = 0; i < w.all; i++) {
            steep = fmax(steep, fabs(w.grad[i]));
            size = fmax(size, fabs(p->gradient[i]));
        }
        p->told[0] = round, p->told[1] = wrong, p->told[2] = mu, p->told[3] = steep;
        if (!(wrong < 1e300) || !(mu < 1e300)) return SJ_ARROW_LOST;
        if (wrong <= p->near && mu <= p->gap && (steep <= 1e-6 * size || mu <= 1e-3 * p->gap))
            return SJ_ARROW_OK;
        if (round == p->most) break;
        mu = bounds ? mu / (double)bounds : 0.0;
        assemble(&w);
        factorise(&w);
        direction(&w);
        if (bounds) {
            const double *dsl = rows_of(&w, DSL), *dsu = rows_of(&w, DSU);
            const double *dzl = rows_of(&w, DZL), *dzu = rows_of(&w, DZU);
            primal = fmin(1.0, fmin(longest(&w, SL, DSL), longest(&w, SU, DSU)));
            dual = fmin(1.0, fmin(longest(&w, ZL, DZL), longest(&w, ZU, DZU)));
            for (int64_t r = 0; r < p->rows; r++)
                after += (sl[r] + primal * dsl[r]) * (zl[r] + dual * dzl[r]) * (p->low[r] > -INFINITY)
                       + (su[r] + primal * dsu[r]) * (zu[r] + dual * dzu[r]) * (p->high[r] < INFINITY);
            sigma = after / ((double)bounds * mu);
            sigma = sigma * sigma * sigma;
            for (int64_t r = 0; r < p->rows; r++) {
                if (p->low[r] > -INFINITY) cl[r] = sigma * mu - sl[r] * zl[r] - dsl[r] * dzl[r];
                if (p->high[r] < INFINITY) cu[r] = sigma * mu - su[r] * zu[r] - dsu[r] * dzu[r];
            }
            direction(&w);
        }
        primal = BOUNDARY * fmin(longest(&w, SL, DSL), longest(&w, SU, DSU));
        dual = BOUNDARY * fmin(longest(&w, ZL, DZL), longest(&w, ZU, DZU));
        primal = dual = fmin(1.0, fmin(primal, dual)); /* a quadratic objective ties them */
        for (int64_t i = 0; i < w.all; i++) p->x[i] += primal * w.dx[i];
        product(&w, p->x, y);
        for (int64_t r = 0; r < p->rows; r++) {
            sl[r] += primal * rows_of(&w, DSL)[r];
            su[r] += primal * rows_of(&w, DSU)[r];
            zl[r] += dual * rows_of(&w, DZL)[r];
            zu[r] += dual * rows_of(&w, DZU)[r];
        }
    }
    return SJ_ARROW_MOST;
}
