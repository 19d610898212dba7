/* Convex quadratic programmes of splines: a band with a border. */
#pragma once
#include <stdint.h>

enum sj_arrow_status {
    SJ_ARROW_OK = 0,
    SJ_ARROW_MOST = 1,                  /* not there after `most` steps; x is how far it came */
    SJ_ARROW_LOST = 2                   /* a number that is none */
};

/* Minimise gradient'x + 1/2 sum of weight (a'x - target)^2, low <= a'x <= high for every row a.
 * `unknowns` in a band, then `border` ones that every row may have. All memory is the caller's,
 * `spare` of sj_arrow_spare() doubles. */
typedef struct {
    int64_t unknowns;
    int64_t rows;
    int32_t band;                       /* how far apart the unknowns of a row are at most */
    int32_t border;
    int32_t width;                      /* coefficients per row, unused ones 0 at any place of it */
    int32_t most;                       /* steps */
    const int32_t *at;                  /* (rows, width), not falling */
    const double *value;                /* (rows, width) */
    const double *across;               /* (rows, border) */
    const double *low;                  /* (rows): -inf for none */
    const double *high;
    const double *weight;               /* (rows): 0 for none */
    const double *target;
    const double *gradient;             /* (unknowns + border) */
    double begin;                       /* slack times multiplier to begin with */
    double near;                        /* by how much rows may be missed */
    double gap;                         /* and the objective */
    double *x;                          /* in: where to begin */
    double *spare;
    double *told;                       /* (4): steps, misses, gap, gradient */
} sj_arrow;

int64_t sj_arrow_spare(int64_t unknowns, int32_t band, int32_t border, int64_t rows);
int32_t sj_arrow_solve(const sj_arrow *problem);
