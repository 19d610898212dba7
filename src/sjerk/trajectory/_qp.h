/* A convex quadratic programme whose variables lie in the order of time:
 *
 *     minimise  1/2 x'H x + g'x     subject to     lower <= A x <= upper
 *
 * H is banded, and so are the rows of A: the variables of a row lie at most `band` apart. A row with
 * lower = upper is an equality; a bound beyond +-SJ_QP_FREE is none.
 *
 * How it is used: fill `sj_qp`, in units in which variables and bounds are of about 1 (the scale of the
 * objective and of each row does not matter); give `sj_qp_solve` a start, a working memory of
 * `sj_qp_doubles` and the most iterations. The answer is an interior point: once a full step was
 * possible, every bound is kept to rounding, by each later iterate also. Where `outside` of the result is
 * more than the caller bears, `sj_qp_toward` goes from a plan that keeps the bounds as far towards the
 * answer as they allow. Equal input gives equal bits. */
#pragma once
#include <stdint.h>

enum sj_qp_status {
    SJ_QP_SOLVED = 0,
    SJ_QP_BOUND = 1, /* the iterations are used up */
    SJ_QP_STUCK = 2  /* no step any more: infeasible, or as exact as doubles allow */
};

enum { SJ_QP_FREE = 1000000000 };

typedef struct {
    int32_t variables, rows, band;
    int32_t reserved;
    const double *hessian;       /* (variables, band + 1): H(i, j) at [i][band + j - i], j <= i */
    const double *gradient;      /* (variables,) */
    const int32_t *start;        /* (rows + 1,): where each row's entries begin */
    const int32_t *column;       /* of each entry, ascending within a row */
    const double *value;         /* of each entry */
    const double *lower, *upper; /* (rows,) */
} sj_qp;

typedef struct {
    int32_t iterations, status;
    double outside; /* most by which a row is beyond a bound; rows of largest entry 1 */
    double gap;     /* mean product of distance to a bound and its multiplier */
    double slope;   /* largest entry of the gradient of the Lagrangian; H's largest is 1 */
} sj_qp_result;

int64_t sj_qp_doubles(int32_t variables, int32_t rows, int32_t band);
/* x (variables,): in a start, out the answer. `warm`: how far from a bound a start is taken to be at
 * least, 0 for the default. `tolerance` on gap and slope. */
void sj_qp_solve(const sj_qp *qp, double *x, double *work, int32_t most, double warm,
                 double tolerance, sj_qp_result *result);
/* The largest share in 0 .. 1 of the way from `from` to `to` (variables,) on which no row is further
 * beyond a bound than at `from`, or than `room` times the row's largest entry. */
double sj_qp_toward(const sj_qp *qp, const double *from, const double *to, double room);
