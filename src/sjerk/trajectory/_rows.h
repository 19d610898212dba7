/* Rows of a quadratic programme side by side in lanes, so that loops over these are vectors. For C only. */
#pragma once
#include <stdint.h>
#include "trajectory/_arrow.h"

enum { W = SJ_ARROW_WIDTH, LANES = 4 };

/* The coefficients of LANES rows; those that are none are 0 at the last place of the row. */
typedef struct {
    int32_t width, reserved;
    int32_t at[W][LANES];
    double value[W][LANES];
} coefficients;

/* The coefficients of the rows from r on, as many as there are. */
static inline void load(const sj_arrow *p, int32_t r, coefficients *o)
{
    o->width = 1;
    for (int l = 0; l < LANES; l++) {
        int32_t from = r + l < p->rows ? p->start[r + l] : 0;
        int32_t count = r + l < p->rows ? p->start[r + l + 1] - from : 0;
        o->width = count > o->width ? count : o->width;
        for (int32_t e = 0; e < W; e++) {
            o->at[e][l] = count == 0 ? 0 : p->at[from + (e < count ? e : count - 1)];
            o->value[e][l] = e < count ? p->value[from + e] : 0.0;
        }
    }
}

static inline void products(const coefficients *o, const double *x, double out[LANES])
{
    for (int l = 0; l < LANES; l++)
        out[l] = o->value[0][l] * x[o->at[0][l]];
    for (int32_t e = 1; e < o->width; e++)
        for (int l = 0; l < LANES; l++)
            out[l] += o->value[e][l] * x[o->at[e][l]];
}

static inline void scatter(const coefficients *o, const double share[LANES], double *out)
{
    for (int32_t e = 0; e < o->width; e++)
        for (int l = 0; l < LANES; l++)
            out[o->at[e][l]] += share[l] * o->value[e][l];
}

/* weight a a' of each row into the columns of a band. */
static inline void add_squares(const coefficients *o, const double weight[LANES], int64_t band,
                               double *columns)
{
    for (int32_t e = 0; e < o->width; e++) {
        double share[LANES], *column[LANES];
        for (int l = 0; l < LANES; l++) {
            share[l] = weight[l] * o->value[e][l];
            column[l] = columns + o->at[e][l] * band;
        }
        for (int32_t f = e; f < o->width; f++)
            for (int l = 0; l < LANES; l++)
                column[l][o->at[f][l]] += share[l] * o->value[f][l];
    }
}
