/* The half-cycle lemma: the continuous motion behind a sample of the bilinear integrator, T_s = 1:
 *
 *   A = a + j/2        V = v + a/2        P = q + v/2 - A/12
 *
 * The planner plans in (P, V, A), the interpolator sends (q, v, a). Ground of both.
 */
#pragma once

#include "base/_double_double.h" /* double-double sums */

typedef struct {
    sj_exact P, V, A;
} continuous;

static inline continuous lemma(sj_exact q, sj_exact v, sj_exact a, sj_exact j)
{
    continuous plan;
    plan.A = exact_add(a, exact_half(j));
    plan.V = exact_add(v, exact_half(a));
    plan.P = exact_subtract(exact_add(q, exact_half(v)), exact_divide(plan.A, 12.0));
    return plan;
}

/* Lemma, point 2: a plan that ends here without acceleration lets the sample settle on (q, v). */
static inline sj_exact lemma_end(double q, double v) { return exact_two_sum(q, -0.5 * v); }

/* What a plan has to cover from there to a sample that settles on (q, v). */
static inline double lemma_distance(const continuous *from, double q, double v)
{
    return exact_subtract(lemma_end(q, v), from->P).hi;
}
