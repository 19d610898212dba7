/* Rows of a window of way-points, private to the files of following: what is solved (_follow.c), and
 * how long the segments take (_stretch.c).
 */
#pragma once

/* Segments on either side that a change of one is felt in: 0.27^24 is below the last bit. */
enum { REACH = 24 };

/* A row per knot: shared by its joints, then J numbers each. */
enum { BETA, DELTA, F, M1, M2, M3, IDLE, MARK, SHARED = 8 };
enum { ALPHA, GAMMA, E, VEL, ACC, J1, J2, J3, COLUMNS };

static inline double *row_of(const sj_follow *s, int64_t i)
{
    return s->rows + i * (SHARED + COLUMNS * (int64_t)s->joints);
}

static inline double *column_of(const sj_follow *s, int64_t i, int32_t column)
{
    return row_of(s, i) + SHARED + (int64_t)column * s->joints;
}

/* A[i-1] = e + f A[i] for a segment of h cycles, and what its e is a multiple of. */
static inline void follow_pivot(double h, double beta, double delta, double *over, double *f)
{
    double c1 = h * beta + h * h / 3.0 - 1.0 / 3.0 + 0.125 * delta - 0.25 * h + 0.125 / h;
    double c2 = h * h / 6.0 - 0.25 * h + 1.0 / 3.0 - 0.125 / h;
    *over = -1.0 / c1;
    *f = c2 * *over;
}

/* After the cycles of segment `first` or later ones changed: felt from `reach` before it up to `to`. */
void sj_follow_solve(const sj_follow *s, int64_t first, int64_t to, int64_t reach);
