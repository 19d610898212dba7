/* A segment of constant jerk between two way-points, for one axis, T_s = 1: the state along a phase,
 * and the sample of the bilinear integrator there. Ground of what plans a recording and what plays
 * it: both must give the same bits.
 */
#pragma once

typedef struct {
    double P, V, A; /* P from the way-point at the first knot */
} segment_state;

/* At the first knot, where the sample of jerk L stands on the way-point: q = P - V/2 + A/3 - L/8. */
static inline double segment_first(double V, double A, double L)
{
    return 0.5 * V - A / 3.0 + 0.125 * L;
}

/* After n cycles of jerk J. */
static inline segment_state segment_after(segment_state at, double n, double J)
{
    segment_state end;
    end.P = at.P + n * (at.V + n * (0.5 * at.A + n * J / 6.0));
    end.V = at.V + n * (at.A + 0.5 * n * J);
    end.A = at.A + n * J;
    return end;
}

/* The sample after t whole cycles of jerk J, t >= 1: (q, v, a) by the half-cycle lemma. */
static inline segment_state segment_sample(segment_state at, double t, double J)
{
    segment_state sample;
    double P1 = at.P + t * (at.V + t * (0.5 * at.A + t * J / 6.0));
    sample.A = at.A + (t - 0.5) * J;
    sample.V = at.V + t * (at.A + 0.5 * t * J) - 0.5 * sample.A;
    sample.P = P1 - 0.5 * sample.V + (at.A + t * J) / 12.0;
    return sample;
}

/* The same position for any t: q(s) = P(s - 1/2) + 5/24 A(s - 1/2), with t = s - 1/2 from the phase's
 * begin. P - V/2 + A/3 - J/8 at the end of a cycle is exactly this half a cycle before. */
static inline double segment_between(segment_state at, double t, double J)
{
    return at.P + t * (at.V + t * (0.5 * at.A + t * J / 6.0)) + 5.0 / 24.0 * (at.A + t * J);
}
