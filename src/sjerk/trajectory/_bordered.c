/* A symmetric positive matrix that is a band with a border (an arrow): its factor is one too,
 *     [ L   ]     L D L' the band, L unit and banded, M = B L^-T,
 *     [ M C ]     C the factor of the corner less M D^-1 M'.
 * Golub and Van Loan, Matrix Computations, section 4.3. The band lets n unknowns cost n band^2.
 * Never here: what the matrix means, memory of its own.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include "base/_simd.h"
#include "trajectory/_bordered.h"

enum { B = SJ_BORDER };

/* Every unknown is held by HOLD. Rows may be 10^16 times as stiff as others: what is left of a diagonal below
 * this share of it is rounding, and is replaced by another, so that a step stays along the others. */
static const double HOLD = 1e-11, ROUNDING = 1e-14, DEPENDENT = 1e-10;

static double dot(const double *x, const double *y, int64_t n)
{
    double a = 0.0, b = 0.0, c = 0.0, d = 0.0;
    int64_t i = 0;
    for (; i + 4 <= n; i += 4) {
        a += x[i] * y[i];
        b += x[i + 1] * y[i + 1];
        c += x[i + 2] * y[i + 2];
        d += x[i + 3] * y[i + 3];
    }
    for (; i < n; i++)
        a += x[i] * y[i];
    return (a + b) + (c + d);
}

SIMD static void eliminate(sj_bordered *a)
{
    int64_t band = a->band, stride = band + 1;
    for (int64_t j = 0; j < a->n; j++)
        a->size[j] = a->columns[j * stride];
    for (int64_t j = 0; j < a->n; j++) {
        double *column = a->columns + j * stride, *m = a->beside + j * B;
        double diagonal = column[0] + HOLD, over;
        int64_t depth = a->n - 1 - j < band ? a->n - 1 - j : band;
        if (!(diagonal > ROUNDING * a->size[j]))
            diagonal = DEPENDENT * a->size[j] + HOLD;
        over = 1.0 / diagonal;
        for (int64_t i = 1; i <= depth; i++) {
            double s = column[i] * over, *restrict to = column + i * stride;
            const double *restrict from = column + i;
            if (s == 0.0)
                continue;
            for (int64_t k = 0; k <= depth - i; k++)
                to[k] -= s * from[k];
            for (int b = 0; b < a->border; b++)
                m[i * B + b] -= s * m[b];
            column[i] = s;
        }
        column[0] = over;
        a->corner[0][0] -= m[0] * m[0] * over;
        a->corner[1][0] -= m[1] * m[0] * over;
        a->corner[1][1] -= m[1] * m[1] * over;
    }
}

void sj_bordered_factorise(sj_bordered *a)
{
    eliminate(a);
    a->corner[0][0] = sqrt(fmax(a->corner[0][0], 0.0) + HOLD);
    a->corner[1][0] /= a->corner[0][0];
    a->corner[1][1] = sqrt(fmax(a->corner[1][1] - a->corner[1][0] * a->corner[1][0], 0.0) + HOLD);
}

void sj_bordered_solve(const sj_bordered *a, double *x)
{
    int64_t band = a->band, stride = band + 1, n = a->n;
    double tail[B] = {0.0, 0.0};
    int32_t border = a->border;
    for (int b = 0; b < border; b++)
        tail[b] = x[n + b];
    for (int64_t j = 0; j < n; j++) {
        const double *column = a->columns + j * stride, *m = a->beside + j * B;
        int64_t depth = n - 1 - j < band ? n - 1 - j : band;
        double s = x[j];
        for (int64_t i = 1; i <= depth; i++)
            x[j + i] -= s * column[i];
        x[j] = s *= column[0];
        for (int b = 0; b < border; b++)
            tail[b] -= s * m[b];
    }
    tail[0] /= a->corner[0][0];
    tail[1] = (tail[1] - a->corner[1][0] * tail[0]) / a->corner[1][1];
    tail[1] /= a->corner[1][1];
    tail[0] = (tail[0] - a->corner[1][0] * tail[1]) / a->corner[0][0];
    for (int64_t j = n - 1; j >= 0; j--) {
        const double *column = a->columns + j * stride, *m = a->beside + j * B;
        int64_t depth = n - 1 - j < band ? n - 1 - j : band;
        double s = x[j];
        for (int b = 0; b < border; b++)
            s -= m[b] * tail[b] * column[0];
        x[j] = s - dot(column + 1, x + j + 1, depth);
    }
    for (int b = 0; b < border; b++)
        x[n + b] = tail[b];
}

void sj_band_add_product(const double *columns, int64_t n, int64_t band, const double *x,
                         double *out)
{
    for (int64_t j = 0; j < n; j++) {
        const double *column = columns + j * (band + 1);
        int64_t depth = n - 1 - j < band ? n - 1 - j : band;
        for (int64_t i = 1; i <= depth; i++)
            out[j + i] += column[i] * x[j];
        out[j] += dot(column, x + j, depth + 1);
    }
}
