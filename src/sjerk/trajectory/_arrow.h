/* Convex quadratic programmes of splines: a band with a border. */
#pragma once
#include <stdint.h>

enum { SJ_ARROW_WIDTH = 5, SJ_ARROW_BORDER = 2 };

enum sj_arrow_status {
    SJ_ARROW_OK = 0,
    SJ_ARROW_MOST = 1, /* not there after `most` steps; x is how far it came */
    SJ_ARROW_LOST = 2  /* a number that is none */
};

/* Minimise  gradient'x + 1/2 sum of weight (a'x - target)^2  with, for every row a,
 *     low <= a'x + beside_low'w      and      a'x + beside_high'w <= high.
 * x: `unknowns` in a band; w: two more that every row may have, at the end of `x`. A row has five
 * coefficients at places that do not fall; unused ones are 0 at any place of the row. All memory is
 * the caller's, `spare` of sj_arrow_spare() doubles. Rows are to be scaled to bounds of about 1. */
typedef struct {
    int64_t unknowns;
    int64_t rows;
    int32_t band;              /* how far apart the places of a row are at most */
    int32_t most;              /* steps */
    const int32_t *at;         /* (rows, 5) */
    const double *value;       /* (rows, 5) */
    const double *beside_low;  /* (rows, 2) */
    const double *beside_high; /* (rows, 2) */
    const double *low;         /* (rows): -inf for none */
    const double *high;        /* (rows): inf for none */
    const double *weight;      /* (rows): 0 for none */
    const double *target;      /* (rows) */
    const double *gradient;    /* (unknowns + 2) */
    double begin;              /* slack times multiplier to begin with */
    double near;               /* by how much rows may be missed, and the objective */
    double *x;                 /* (unknowns + 2); in: where to begin */
    double *spare;
    double *told; /* (4): steps, misses, gap, gradient */
} sj_arrow;

int64_t sj_arrow_spare(int64_t unknowns, int32_t band, int64_t rows);
int32_t sj_arrow_solve(const sj_arrow *problem);
