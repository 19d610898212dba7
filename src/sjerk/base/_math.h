/* Cube root, exp(x) - 1 and whole powers by sums and products only: the same bits on every processor and
 * with every C library, whose own differ in the last one. Within 0.51 units in the last place
 * (tests/base/test_math.py). Needs what _double_double.h needs.
 *
 * Never here: sqrt, floor and their like, which IEEE 754 defines to the bit. */
#pragma once
#include <math.h> /* isfinite, fabs */
#include <stdint.h>
#include <string.h>
#include "base/_double_double.h"

/* 2^k, -1022 <= k <= 1023. */
static inline double power_of_2(int64_t k)
{
    uint64_t bits = (uint64_t)(k + 1023) << 52;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* x^(1/3). With |x| = m 2^(3k), 1 <= m < 8: a guess t by a third of the exponent, two steps of Halley,
 *     t <- t (t^3 + 2 m) / (2 t^3 + m),
 * and one of Newton, t <- t + (m - t^3) / (3 t^2), with the remainder in double-double. */
typedef struct {
    double m, t, unit; /* unit: 2^k, or x itself where that is its root: m = t = 1 */
} cube_guess;

static inline cube_guess cube_begin(double x)
{
    double m = fabs(x), t, scaled = 1.0;
    uint64_t bits, guess;
    if (!isfinite(x) || x == 0.0)
        return (cube_guess){1.0, 1.0, x};
    if (m < 0x1p-1022) { /* subnormal */
        m *= 0x1p54;
        scaled = 0x1p-18;
    }
    memcpy(&bits, &m, sizeof bits);
    int64_t e = (int64_t)(bits >> 52) - 1023, k = (e + 1200) / 3 - 400; /* rounded down */
    bits -= (uint64_t)(3 * k) << 52;
    memcpy(&m, &bits, sizeof m);
    guess = bits / 3 + 0x2A9F7893782DA1CE; /* 2/3 of the bits of 1.0, less the mean error */
    memcpy(&t, &guess, sizeof t);
    return (cube_guess){m, t, power_of_2(k) * scaled};
}

/* Nothing but sums, products and quotients: several at once, in loops over lanes. */
static inline double cube_refined(double m, double t)
{
    for (int step = 0; step < 2; step++) {
        double cube = t * t * t;
        t = t * (cube + 2.0 * m) / (2.0 * cube + m);
    }
    sj_exact cube = exact_multiply(exact_two_product(t, t), exact_of(t));
    return t + ((m - cube.hi) - cube.lo) / (3.0 * t * t);
}

static inline double cube_root(double x)
{
    cube_guess g = cube_begin(x);
    return copysign(cube_refined(g.m, g.t) * g.unit, x);
}

/* e^x - 1. x is halved n times to r, |r| <= 1/32, where the series ends after 13 terms:
 *     e^r - 1 = r (1 + r/2 (1 + r/3 (1 + ...))),   then n times   e^(2r) - 1 = (e^r - 1) (e^r - 1 + 2). */
static inline double exp_minus_1(double x)
{
    enum { TERMS = 13 };
    double r = x;
    int n = 0;
    if (x != x || x == 0.0)
        return x;
    if (x < -40.0)
        return -1.0;          /* to rounding */
    if (x > 709.782712893384) /* ln of the largest double */
        return (double)INFINITY;
    if (fabs(x) < 0x1p-54)
        return x;
    for (; fabs(r) > 1.0 / 32.0; n++)
        r *= 0.5;
    sj_exact sum = exact_of(1.0);
    for (int k = TERMS; k > 1; k--)
        sum = exact_add(exact_of(1.0), exact_multiply(exact_divide(exact_of(r), k), sum));
    sum = exact_scale(sum, r);
    for (; n > 1; n--)
        sum = exact_multiply(sum, exact_add(sum, exact_of(2.0)));
    if (n == 0)
        return sum.hi + sum.lo;
    sum = exact_multiply(exact_half(sum), exact_add(sum, exact_of(2.0))); /* without overflow */
    return 2.0 * (sum.hi + sum.lo);
}

/* base^n, n >= 0. */
static inline double whole_power(double base, int32_t n)
{
    double product = 1.0;
    for (int32_t i = 0; i < n; i++)
        product *= base;
    return product;
}
