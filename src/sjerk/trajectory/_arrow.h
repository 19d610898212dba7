/* Convex quadratic programmes of splines: a band with a border. */
#pragma once
#include <stdint.h>

enum { SJ_ARROW_WIDTH = 6 };

enum sj_arrow_status {
    SJ_ARROW_OK = 0,
    SJ_ARROW_MOST = 1, /* not there after `most` steps, or no step any more; x is how far it came */
    SJ_ARROW_LOST = 2  /* a number that is none */
};

/* Minimise  gradient'x + 1/2 sum of weight (a'x - target)^2  with, for every row a of those bounded,
 *     low <= a'x + beside_low'w      and      a'x + beside_high'w <= high.
 * x: `unknowns` in a band; w: up to two more that every row may have, at the end of `x`. A row with
 * low = high that has nothing of w is met exactly. A row has at most six
 * coefficients. Rows are to be scaled to bounds of about 1. All memory is the
 * caller's. Equal input gives equal bits. */
typedef struct {
    int64_t unknowns;
    int32_t rows; /* of which the first `bounded` have bounds, and all may have a weight */
    int32_t bounded;
    int32_t band;   /* how far apart the places of a row are at most */
    int32_t border; /* unknowns of w: 0 .. 2 */
    int32_t most;   /* steps */
    int32_t reserved;
    const int32_t *start;   /* (rows + 1): where each row's coefficients begin */
    const int32_t *at;      /* place of each, ascending within a row */
    const double *value;    /* of each */
    const double *beside;   /* (border, 2, bounded): beside_low and beside_high of each of w */
    const double *low;      /* (bounded): -inf for none */
    const double *high;     /* (bounded): inf for none */
    const double *weight;   /* (rows): 0 for none */
    const double *target;   /* (rows) */
    const double *gradient; /* (unknowns + border) */
    double begin;           /* slack times multiplier to begin with */
    double room;            /* the least slack to begin with */
    double near;            /* by how much the objective may be missed */
    double *x;              /* (unknowns + border); in: where to begin */
    double *spare;          /* of sj_arrow_spare() doubles */
} sj_arrow;

typedef struct {
    int32_t steps, status;
    double wrong;   /* most by which a slack is not a row's distance to its bound */
    double outside; /* most by which a row is beyond a bound */
    double gap;     /* sum of slacks times multipliers */
    double steep;   /* largest entry of the gradient of the Lagrangian */
} sj_arrow_result;

int64_t sj_arrow_spare(int64_t unknowns, int32_t band, int32_t bounded);
void sj_arrow_solve(const sj_arrow *problem, sj_arrow_result *result);
