/* A symmetric positive matrix that is a band with a border of up to two: its factor, systems with it. */
#pragma once
#include <stdint.h>

enum { SJ_BORDER = 2 };

typedef struct {
    int64_t n;
    int32_t band, border;
    double *columns;                     /* (n, band + 1): column j from its diagonal down */
    double *beside;                      /* (n, SJ_BORDER): the border's row, turned */
    double corner[SJ_BORDER][SJ_BORDER]; /* its lower triangle */
    double *size;                        /* (n): of the diagonal before it is eliminated */
} sj_bordered;

/* Into its own place. */
void sj_bordered_factorise(sj_bordered *matrix);
/* x (n + border): in a right side, out the answer. After factorise. */
void sj_bordered_solve(const sj_bordered *matrix, double *x);
/* out (n) += M x for a symmetric band that is not factorised, as above. */
void sj_band_add_product(const double *columns, int64_t n, int64_t band, const double *x,
                         double *out);
