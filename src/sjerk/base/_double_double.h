/* Double-double arithmetic: a value as the unevaluated sum hi + lo, about 106 bits (Dekker 1971,
 * Knuth TAOCP 4.2.2). The ground under the interpolator: it makes the sums of Eqs. (15)-(17) exact
 * far below the last bit of what is sent. Needs round-to-nearest and no contraction or fast-math.
 */
#pragma once
#include <stdint.h>      /* bits of a double */
#include <string.h>      /* memcpy of bits */
#include "base/_types.h" /* sj_exact */

static inline sj_exact exact_of(double x) { return (sj_exact){x, 0.0}; }

/* a + b without error, |a| >= |b|. */
static inline sj_exact exact_fast_two_sum(double a, double b)
{
    double s = a + b;
    return (sj_exact){s, b - (s - a)};
}

/* a + b without error. */
static inline sj_exact exact_two_sum(double a, double b)
{
    double s = a + b;
    double b_part = s - a;
    return (sj_exact){s, (a - (s - b_part)) + (b - b_part)};
}

/* Upper 26 bits and the rest, so that products of halves are exact (Veltkamp). */
static inline sj_exact exact_split(double x)
{
    double big = 134217729.0 * x; /* 2^27 + 1 */
    double hi = big - (big - x);
    return (sj_exact){hi, x - hi};
}

/* a * b without error. */
static inline sj_exact exact_two_product(double a, double b)
{
    double p = a * b;
    sj_exact x = exact_split(a), y = exact_split(b);
    return (sj_exact){p, ((x.hi * y.hi - p) + x.hi * y.lo + x.lo * y.hi) + x.lo * y.lo};
}

static inline sj_exact exact_add(sj_exact x, sj_exact y)
{
    sj_exact s = exact_two_sum(x.hi, y.hi);
    sj_exact t = exact_two_sum(x.lo, y.lo);
    s = exact_fast_two_sum(s.hi, s.lo + t.hi);
    return exact_fast_two_sum(s.hi, s.lo + t.lo);
}

static inline sj_exact exact_negate(sj_exact x) { return (sj_exact){-x.hi, -x.lo}; }

static inline sj_exact exact_subtract(sj_exact x, sj_exact y)
{
    return exact_add(x, exact_negate(y));
}

static inline sj_exact exact_multiply(sj_exact x, sj_exact y)
{
    sj_exact p = exact_two_product(x.hi, y.hi);
    return exact_fast_two_sum(p.hi, p.lo + (x.hi * y.lo + x.lo * y.hi));
}

static inline sj_exact exact_scale(sj_exact x, double factor)
{
    return exact_multiply(x, exact_of(factor));
}

static inline sj_exact exact_divide(sj_exact x, double divisor)
{
    double q1 = x.hi / divisor;
    sj_exact r = exact_subtract(x, exact_two_product(q1, divisor));
    double q2 = r.hi / divisor;
    r = exact_subtract(r, exact_two_product(q2, divisor));
    sj_exact q = exact_fast_two_sum(q1, q2);
    return exact_add(q, exact_of(r.hi / divisor));
}

/* The double nearest to hi + lo, where hi is the nearest or next to it. Midway between two, and nearer
 * to midway than sums in another order can tell, it is the even one: so all orders agree. */
static inline double exact_nearest(double hi, double lo)
{
    double other = hi + lo * (1.0 + 0x1p-24);
    uint64_t a, b, odd;
    memcpy(&a, &hi, sizeof a);
    memcpy(&b, &other, sizeof b);
    odd = (uint64_t)0 - (a & 1);
    a = (a & ~odd) | (b & odd);
    memcpy(&hi, &a, sizeof hi);
    return hi;
}

/* Halving is exact. */
static inline sj_exact exact_half(sj_exact x) { return (sj_exact){0.5 * x.hi, 0.5 * x.lo}; }
