/* A banded convex quadratic programme by a primal-dual interior point.
 *
 * With slacks s = A x - l and t = u - A x, multipliers y, z >= 0 of them, the conditions of an optimum are
 *
 *     H x + g - A'y + A'z = 0,    A x - s = l,    A x + t = u,    s y = 0,    t z = 0.
 *
 * Newton's method on s y = t z = mu with mu falling to 0 is one banded factorisation per iteration,
 *
 *     (H + A' S A) dx = right-hand side,          S = y / s + z / t,
 *
 * used twice: a predictor with mu = 0, and a corrector (Mehrotra 1992; Nocedal and Wright, Numerical
 * Optimization, Section 16.6). An equality has a multiplier of any sign and S = 1/DELTA, a proximal step of
 * the method of multipliers. The band lets n variables cost n band^2. Bounded: no loop but over the
 * iterations given. Never here: what the variables mean, memory of its own.
 */
#include <math.h> /* fabs */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of rows */
#include "trajectory/_qp.h"

static const double DELTA = 1e-7;  /* softness of an equality in one iteration */
static const double RIDGE = 1e-11; /* on the diagonal: a direction that nothing asks for stays */
static const double ROOM = 0.05;   /* least distance to a bound of a cold start */
static const double SHORT = 0.995; /* share of the way to the nearest bound */
static const double STILL = 1e-9;  /* a shorter step is none */

/* What the solver remembers, in the caller's memory. */
typedef struct {
    const sj_qp *qp;
    double scale;          /* of the objective: its largest second derivative becomes 1 */
    double steepest;       /* 1 + largest entry of its gradient */
    double bounds;         /* how many there are, without equalities */
    double *factor;        /* (n, band + 1) */
    double *column;        /* (band + 1,) of the factorisation */
    double *row_scale;     /* (m,): 1 / largest entry */
    double *slope, *step;  /* (n,) */
    double *at, *move;     /* (m,): A x, A dx */
    double *s, *t, *y, *z; /* (m,) */
    double *per_s, *per_t; /* (m,): 1 / s, 1 / t */
    double *u, *v;         /* (m,): what s y and t z are to become */
    double *ds, *dt;       /* (m,): what the step does to slacks */
    double *dy, *dz;       /* (m,): and to their multipliers */
    double *w;             /* (m,): the diagonal of S */
} state;

int64_t sj_qp_doubles(int32_t variables, int32_t rows, int32_t band)
{
    int64_t n = variables, m = rows, b = (int64_t)band + 1;
    return n * b + b + 2 * n + 16 * m;
}

static void share_out(state *q, const sj_qp *qp, double *work)
{
    size_t n = (size_t)qp->variables, m = (size_t)qp->rows, b = (size_t)qp->band + 1;
    double **vector[] = {&q->row_scale, &q->at, &q->move,  &q->s,    &q->t,  &q->y,
                         &q->z,         &q->u,  &q->v,     &q->w,    &q->ds, &q->dt,
                         &q->dy,        &q->dz, &q->per_s, &q->per_t};
    q->qp = qp;
    q->factor = work;
    q->column = work + n * b;
    q->slope = q->column + b;
    q->step = q->slope + n;
    work = q->step + n;
    for (size_t i = 0; i < sizeof vector / sizeof *vector; i++, work += m)
        *vector[i] = work;
}

static double row_times(const sj_qp *qp, int32_t row, const double *x)
{
    double sum = 0.0;
    for (int32_t e = qp->start[row]; e < qp->start[row + 1]; e++)
        sum += qp->value[e] * x[qp->column[e]];
    return sum;
}

static void add_row(const sj_qp *qp, int32_t row, double weight, double *sum)
{
    for (int32_t e = qp->start[row]; e < qp->start[row + 1]; e++)
        sum[qp->column[e]] += weight * qp->value[e];
}

static double largest_entry(const sj_qp *qp, int32_t row)
{
    double most = 0.0;
    for (int32_t e = qp->start[row]; e < qp->start[row + 1]; e++)
        if (fabs(qp->value[e]) > most)
            most = fabs(qp->value[e]);
    return most;
}

static int32_t is_equality(const sj_qp *qp, int32_t row)
{
    return qp->lower[row] == qp->upper[row];
}

static int32_t has_lower(const sj_qp *qp, int32_t row)
{
    return qp->lower[row] > -(double)SJ_QP_FREE;
}

static int32_t has_upper(const sj_qp *qp, int32_t row)
{
    return qp->upper[row] < (double)SJ_QP_FREE;
}

/* out = scale (H x + g). */
static void gradient_at(const state *q, const double *x, double *out)
{
    const sj_qp *qp = q->qp;
    int32_t n = qp->variables, band = qp->band;
    memcpy(out, qp->gradient, (size_t)n * sizeof *out);
    for (int32_t i = 0; i < n; i++) {
        const double *row = qp->hessian + (int64_t)i * (band + 1) + band - i;
        for (int32_t j = i > band ? i - band : 0; j < i; j++) {
            out[i] += row[j] * x[j];
            out[j] += row[j] * x[i];
        }
        out[i] += row[i] * x[i];
    }
    for (int32_t i = 0; i < n; i++)
        out[i] *= q->scale;
}

/* H + A' W A = L D L', the weights W in q->w; L and D in place, row by row. */
static void factorise(state *q)
{
    const sj_qp *qp = q->qp;
    int32_t n = qp->variables, band = qp->band;
    int64_t wide = (int64_t)band + 1;
    for (int64_t k = 0; k < n * wide; k++)
        q->factor[k] = q->scale * qp->hessian[k];
    for (int32_t i = 0; i < n; i++)
        q->factor[i * wide + band] += RIDGE;
    for (int32_t r = 0; r < qp->rows; r++)
        for (int32_t e = qp->start[r]; e < qp->start[r + 1]; e++) {
            int32_t i = qp->column[e];
            double *row = q->factor + i * wide + band - i, part = q->w[r] * qp->value[e];
            for (int32_t f = qp->start[r]; f <= e; f++)
                row[qp->column[f]] += part * qp->value[f];
        }
    for (int32_t k = 0; k < n; k++) {
        int32_t last = k + band < n ? k + band : n - 1;
        double *pivot = q->factor + k * wide + band;
        if (!(*pivot > RIDGE * 1e-3)) /* lost to rounding: the variable stays in this iteration */
            *pivot = 1e30;
        double over = 1.0 / *pivot;
        for (int32_t i = k + 1; i <= last; i++) {
            double *row = q->factor + i * wide + band - i, share = row[k] * over;
            q->column[i - k] = row[k];
            for (int32_t j = k + 1; j <= i; j++)
                row[j] -= share * q->column[j - k];
            row[k] = share;
        }
    }
}

static void substitute(const state *q, double *x)
{
    int32_t n = q->qp->variables, band = q->qp->band;
    int64_t wide = (int64_t)band + 1;
    for (int32_t i = 0; i < n; i++) {
        const double *row = q->factor + i * wide + band - i;
        for (int32_t j = i > band ? i - band : 0; j < i; j++)
            x[i] -= row[j] * x[j];
    }
    for (int32_t i = 0; i < n; i++)
        x[i] /= q->factor[i * wide + band];
    for (int32_t i = n - 1; i > 0; i--) {
        const double *row = q->factor + i * wide + band - i;
        for (int32_t j = i > band ? i - band : 0; j < i; j++)
            x[j] -= row[j] * x[i];
    }
}

/* Distances to the bounds as A x has them, in units of the row's largest entry. */
static double below(const state *q, int32_t r)
{
    return q->at[r] - q->qp->lower[r] * q->row_scale[r];
}

static double above(const state *q, int32_t r)
{
    return q->qp->upper[r] * q->row_scale[r] - q->at[r];
}

/* The Newton step, s y and t z are to become u and v: q->step, q->move, and what it does to slacks and
 * their multipliers. */
static void newton(state *q)
{
    const sj_qp *qp = q->qp;
    for (int32_t i = 0; i < qp->variables; i++)
        q->step[i] = -q->slope[i];
    for (int32_t r = 0; r < qp->rows; r++) {
        double push = 0.0;
        if (is_equality(qp, r))
            push = -below(q, r) / DELTA;
        else {
            if (has_lower(qp, r))
                push += (q->u[r] - q->y[r] * below(q, r)) * q->per_s[r];
            if (has_upper(qp, r))
                push -= (q->v[r] - q->z[r] * above(q, r)) * q->per_t[r];
        }
        add_row(qp, r, push * q->row_scale[r], q->step);
    }
    substitute(q, q->step);
    for (int32_t r = 0; r < qp->rows; r++) {
        q->move[r] = row_times(qp, r, q->step) * q->row_scale[r];
        q->ds[r] = q->dy[r] = q->dt[r] = q->dz[r] = 0.0;
        if (is_equality(qp, r))
            continue;
        if (has_lower(qp, r)) {
            q->ds[r] = below(q, r) + q->move[r] - q->s[r];
            q->dy[r] = (q->u[r] - q->y[r] * q->ds[r]) * q->per_s[r] - q->y[r];
        }
        if (has_upper(qp, r)) {
            q->dt[r] = above(q, r) - q->move[r] - q->t[r];
            q->dz[r] = (q->v[r] - q->z[r] * q->dt[r]) * q->per_t[r] - q->z[r];
        }
    }
}

static double shorter(double part, double value, double move)
{
    return value + part * move < 0.0 ? -value / move : part;
}

/* The largest part of the step that leaves slacks and multipliers positive. A bound that is none has
 * slack 1, multiplier 0, and no step. */
static double reach(const state *q)
{
    double part = 1.0;
    for (int32_t r = 0; r < q->qp->rows; r++) {
        part = shorter(shorter(part, q->s[r], q->ds[r]), q->t[r], q->dt[r]);
        if (!is_equality(q->qp, r))
            part = shorter(shorter(part, q->y[r], q->dy[r]), q->z[r], q->dz[r]);
    }
    return part;
}

/* Mean product of slack and multiplier after so much of the step; 0 without inequalities. */
static double mean_gap(const state *q, double part)
{
    double sum = 0.0;
    for (int32_t r = 0; r < q->qp->rows; r++)
        if (!is_equality(q->qp, r))
            sum += (q->s[r] + part * q->ds[r]) * (q->y[r] + part * q->dy[r]) +
                   (q->t[r] + part * q->dt[r]) * (q->z[r] + part * q->dz[r]);
    return q->bounds > 0.0 ? sum / q->bounds : 0.0;
}

/* The corrector's aim: s y = centre, less what the predictor's step left out. */
static void aim(state *q, double centre)
{
    for (int32_t r = 0; r < q->qp->rows; r++) {
        q->u[r] = centre - q->ds[r] * q->dy[r];
        q->v[r] = centre - q->dt[r] * q->dz[r];
    }
}

static void go(state *q, double *x, double part)
{
    const sj_qp *qp = q->qp;
    for (int32_t r = 0; r < qp->rows; r++) {
        q->s[r] += part * q->ds[r];
        q->t[r] += part * q->dt[r];
        q->y[r] += part * q->dy[r];
        q->z[r] += part * q->dz[r];
        if (is_equality(qp, r))
            q->y[r] -= part * (below(q, r) + q->move[r]) / DELTA;
    }
    for (int32_t i = 0; i < qp->variables; i++)
        x[i] += part * q->step[i];
}

static double largest(const double *x, int32_t n)
{
    double most = 0.0;
    for (int32_t i = 0; i < n; i++)
        if (!(fabs(x[i]) <= most)) /* keeps a NaN */
            most = fabs(x[i]);
    return most;
}

/* As fmax, which is a call where compilers may not assume that there is no NaN. */
static double greater(double x, double y) { return x < y ? y : x; }

/* A x, slope and weights at x; how far it is from an optimum. */
static void look(state *q, const double *x, sj_qp_result *result)
{
    const sj_qp *qp = q->qp;
    double outside = 0.0, gap = 0.0;
    gradient_at(q, x, q->slope);
    q->steepest = 1.0 + largest(q->slope, qp->variables);
    for (int32_t r = 0; r < qp->rows; r++) {
        double weight = 0.0, push = 0.0;
        q->at[r] = row_times(qp, r, x) * q->row_scale[r];
        if (is_equality(qp, r)) {
            weight = 1.0 / DELTA;
            push = q->y[r];
            outside = greater(outside, fabs(below(q, r)));
        } else {
            if (has_lower(qp, r)) {
                q->per_s[r] = 1.0 / q->s[r];
                weight += q->y[r] * q->per_s[r];
                push += q->y[r];
                gap += q->s[r] * q->y[r];
                outside = greater(outside, -below(q, r));
            }
            if (has_upper(qp, r)) {
                q->per_t[r] = 1.0 / q->t[r];
                weight += q->z[r] * q->per_t[r];
                push -= q->z[r];
                gap += q->t[r] * q->z[r];
                outside = greater(outside, -above(q, r));
            }
        }
        add_row(qp, r, -push * q->row_scale[r], q->slope);
        q->w[r] = weight * q->row_scale[r] * q->row_scale[r];
    }
    result->outside = outside;
    result->gap = q->bounds > 0.0 ? gap / q->bounds : 0.0;
    result->slope = largest(q->slope, qp->variables);
}

static void begin(state *q, const double *x, double room)
{
    const sj_qp *qp = q->qp;
    double most = 0.0;
    for (int32_t i = 0; i < qp->variables; i++)
        most = fmax(most, qp->hessian[(int64_t)i * (qp->band + 1) + qp->band]);
    q->scale = most > 0.0 ? 1.0 / most : 1.0;
    q->bounds = 0.0;
    for (int32_t r = 0; r < qp->rows; r++) {
        double entry = largest_entry(qp, r);
        q->row_scale[r] = entry > 0.0 ? 1.0 / entry : 1.0;
        q->at[r] = row_times(qp, r, x) * q->row_scale[r];
        q->u[r] = q->v[r] = q->y[r] = q->z[r] = 0.0;
        q->s[r] = q->t[r] = 1.0;
        if (is_equality(qp, r))
            continue;
        if (has_lower(qp, r)) {
            q->s[r] = fmax(below(q, r), room);
            q->y[r] = room;
            q->bounds += 1.0;
        }
        if (has_upper(qp, r)) {
            q->t[r] = fmax(above(q, r), room);
            q->z[r] = room;
            q->bounds += 1.0;
        }
    }
}

void sj_qp_solve(const sj_qp *qp, double *x, double *work, int32_t most, double warm,
                 double tolerance, sj_qp_result *result)
{
    state q;
    share_out(&q, qp, work);
    begin(&q, x, warm > 0.0 ? warm : ROOM);
    *result = (sj_qp_result){0, SJ_QP_BOUND, 0.0, 0.0, 0.0};
    look(&q, x, result);
    while (result->iterations < most) {
        double part, gap = result->gap;
        factorise(&q);
        for (int32_t r = 0; r < qp->rows; r++)
            q.u[r] = q.v[r] = 0.0;
        newton(&q);
        if (gap > 0.0) {
            double share = mean_gap(&q, reach(&q)) / gap;
            aim(&q, fmax(share * share * share * gap, 0.1 * tolerance));
            newton(&q);
        }
        if (!(largest(q.step, qp->variables) <
              1e30)) { /* lost to rounding: the iterate before stands */
            result->status = SJ_QP_STUCK;
            return;
        }
        part = reach(&q);
        part = part < 1.0 ? SHORT * part : 1.0;
        go(&q, x, part);
        result->iterations++;
        look(&q, x, result);
        if (result->gap <= tolerance && result->slope <= tolerance * q.steepest &&
            result->outside <= tolerance) {
            result->status = SJ_QP_SOLVED;
            return;
        }
        if (part < STILL) {
            result->status = SJ_QP_STUCK;
            return;
        }
    }
}

double sj_qp_toward(const sj_qp *qp, const double *from, const double *to, double room)
{
    double share = 1.0;
    for (int32_t r = 0; r < qp->rows; r++) {
        double here = row_times(qp, r, from), there = row_times(qp, r, to);
        double slack = room * largest_entry(qp, r);
        double upper = greater(qp->upper[r] + slack, here);
        double lower = -greater(slack - qp->lower[r], -here);
        if (there > upper)
            share = fmin(share, (upper - here) / (there - here));
        if (there < lower)
            share = fmin(share, (here - lower) / (here - there));
    }
    return share > 0.0 ? share : 0.0;
}
