/* Following way-points in time: a spline of constant jerk per segment through the samples.
 *
 * Between two way-points the jerk is constant (two or three values where a start, an end or a given
 * velocity asks for more freedom), acceleration and velocity go through, and the *sample* of the
 * bilinear integrator stands on every way-point in its cycle. With the half-cycle lemma the sample
 * at the end of a cycle of jerk j is q = P - V/2 + A/3 - j/8, so knot by knot the unknown is A
 * alone: the relations V = alpha + beta A, j = gamma + delta A are swept forward, A backward (a
 * tridiagonal elimination). A knot's influence falls by a factor of four per segment.
 * How long the segments take is decided in _stretch.c. docs/explanation/trajectories.md. Never here:
 * allocation, time, layouts of memory.
 */
#include <math.h> /* floor, fmax */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of rows */
#include "trajectory/_following.h"
#include "_follow.h"       /* rows */
#include "base/_segment.h" /* what a sample is */

int64_t sj_follow_row(int32_t joints) { return SHARED + COLUMNS * (int64_t)joints; }

/* What a jerk held over m of a segment's cycles, r before its end, adds to V and P at that end. */
static double to_velocity(double m, double r) { return m * (0.5 * m + r); }
static double to_position(double m, double r) { return m * (m * m / 6.0 + 0.5 * r * (m + r)); }

/* ---- one sweep ------------------------------------------------------------------------------- */

static void split(double *row, double m1, double m2, double m3, double idle)
{
    row[M1] = m1;
    row[M2] = m2;
    row[M3] = m3;
    row[IDLE] = idle;
}

/* Segment 1, from the known state: its first jerk e + f A1, and the relations at its end. */
static void sweep_first(const sj_follow *s)
{
    double h = (double)s->cycles[1], m1 = floor(0.5 * h), m2 = h - m1, *row = row_of(s, 1);
    double ka = to_position(m1, m2) - 0.5 * to_velocity(m1, m2);
    double kb = to_position(m2, 0.0) - 0.5 * to_velocity(m2, 0.0) - 0.125;
    double va = to_velocity(m1, m2) - to_velocity(m2, 0.0) * m1 / m2,
           vb = to_velocity(m2, 0.0) / m2;
    double pivot = ka - kb * m1 / m2;
    const double *V0 = column_of(s, 0, VEL), *A0 = column_of(s, 0, ACC), *J0 = column_of(s, 0, J3);
    double *alpha = column_of(s, 1, ALPHA), *gamma = column_of(s, 1, GAMMA),
           *e = column_of(s, 1, E);
    split(row, m1, m2, 0.0, 0.0);
    row[F] = -(kb / m2 + 1.0 / 3.0) / pivot;
    row[BETA] = va * row[F] + vb;
    row[DELTA] = (1.0 - m1 * row[F]) / m2;
    for (int32_t k = 0; k < s->joints; k++) {
        double dq = s->position[s->joints + k] - s->position[k];
        double rest =
            V0[k] * h + A0[k] * (0.5 * h * h - 0.5 * h - 1.0 / 3.0 - kb / m2) + 0.125 * J0[k] - dq;
        e[k] = -rest / pivot;
        alpha[k] = V0[k] + A0[k] * (h - vb) + va * e[k];
        gamma[k] = -(A0[k] + m1 * e[k]) / m2;
    }
}

/* Segment i between: A[i-1] = e + f A[i], and the relations at its end. */
static void sweep(const sj_follow *s, int64_t i)
{
    double h = (double)s->cycles[i], *row = row_of(s, i);
    const double *before = row_of(s, i - 1);
    double beta = before[BETA], delta = before[DELTA];
    double over, f, lever = beta + 0.5 * h;
    const double *alpha0 = column_of(s, i - 1, ALPHA), *gamma0 = column_of(s, i - 1, GAMMA);
    double *alpha = column_of(s, i, ALPHA), *gamma = column_of(s, i, GAMMA),
           *e = column_of(s, i, E);
    const double *q = s->position + i * s->joints, *q0 = q - s->joints;
    follow_pivot(h, beta, delta, &over, &f);
    split(row, h, 0.0, 0.0, 0.0);
    row[F] = f;
    row[BETA] = lever * f + 0.5 * h;
    row[DELTA] = (1.0 - f) / h;
    for (int32_t k = 0; k < s->joints; k++) {
        e[k] = (h * alpha0[k] + 0.125 * gamma0[k] - (q[k] - q0[k])) * over;
        alpha[k] = alpha0[k] + lever * e[k];
        gamma[k] = -e[k] / h;
    }
}

/* The last segment, to rest one cycle before its end: fixes A of the knot before. */
static void sweep_last(const sj_follow *s)
{
    int64_t n = s->points - 1;
    double M = (double)(s->cycles[n] - 1), m1 = floor(0.5 * M), m2 = M - m1;
    const double *before = row_of(s, n - 1);
    double beta = before[BETA], delta = before[DELTA];
    double pb = to_position(m2, 0.0) / m2, vb = to_velocity(m2, 0.0) / m2;
    double a11 = beta + M - vb, a12 = to_velocity(m1, m2) - vb * m1;
    double a21 = 0.5 * beta - 1.0 / 3.0 + 0.125 * delta + M * beta + 0.5 * M * M - pb;
    double a22 = to_position(m1, m2) - pb * m1, over = 1.0 / (a11 * a22 - a12 * a21);
    const double *alpha = column_of(s, n - 1, ALPHA), *gamma = column_of(s, n - 1, GAMMA);
    const double *q = s->position + n * s->joints, *q0 = q - s->joints;
    double *A = column_of(s, n - 1, ACC), *ja = column_of(s, n, J1), *jb = column_of(s, n, J2);
    split(row_of(s, n), m1, m2, 0.0, 1.0);
    for (int32_t k = 0; k < s->joints; k++) {
        double r1 = -alpha[k];
        double r2 = q[k] - q0[k] - (0.5 + M) * alpha[k] - 0.125 * gamma[k];
        A[k] = (r1 * a22 - a12 * r2) * over;
        ja[k] = (a11 * r2 - a21 * r1) * over;
        jb[k] = -(A[k] + m1 * ja[k]) / m2;
        column_of(s, n, J3)[k] = column_of(s, n, VEL)[k] = column_of(s, n, ACC)[k] = 0.0;
    }
}

/* From A at knot i: V there, the jerks of segment i, and A at the knot before. */
static void back(const sj_follow *s, int64_t i)
{
    const double *row = row_of(s, i);
    double beta = row[BETA], f = row[F], over = 1.0 / (double)s->cycles[i];
    const double *alpha = column_of(s, i, ALPHA), *e = column_of(s, i, E),
                 *A = column_of(s, i, ACC);
    double *A0 = column_of(s, i - 1, ACC), *V = column_of(s, i, VEL);
    double *j1 = column_of(s, i, J1), *j2 = column_of(s, i, J2), *j3 = column_of(s, i, J3);
    if (i == 1) {
        for (int32_t k = 0; k < s->joints; k++) {
            V[k] = alpha[k] + beta * A[k];
            j1[k] = e[k] + f * A[k];
            j2[k] = (A[k] - A0[k] - row[M1] * j1[k]) / row[M2];
            j3[k] = j2[k];
        }
        return;
    }
    for (int32_t k = 0; k < s->joints; k++) {
        A0[k] = e[k] + f * A[k];
        V[k] = alpha[k] + beta * A[k];
        j1[k] = (A[k] - A0[k]) * over;
        j2[k] = j3[k] = j1[k]; /* J3 is what the last cycle has, whatever the phases */
    }
}

/* ---- given velocities ------------------------------------------------------------------------ */

/* The velocity asked at knot i, in the present, maybe stretched, times. */
static double velocity_at(const sj_follow *s, int64_t i, int32_t k)
{
    int64_t asked, taken;
    if (i == 0)
        return column_of(s, 0, VEL)[k]; /* only as a slope; the state counts */
    if (i == s->points - 1)
        return 0.0;
    asked = s->least[i] + s->least[i + 1];
    taken = s->cycles[i] + s->cycles[i + 1];
    if (asked < 1)
        return 0.0;
    return s->velocity[i * s->joints + k] * ((double)asked / (double)taken);
}

/* Segment i in three phases from the known state to its velocity and a mean of the
 * accelerations that the cubics on either side have. */
static void pass(const sj_follow *s, int64_t i)
{
    int64_t n = s->points - 1;
    int last = i == n;
    double N = (double)s->cycles[i], M = last ? N - 1.0 : N;
    double m1 = fmax(1.0, floor(0.25 * M + 0.5)), m3 = m1, m2, x = 0.0;
    double v1, v2, v3, p1, p2, p3, over;
    const double *q = s->position + i * s->joints;
    const double *V0 = column_of(s, i - 1, VEL), *A0 = column_of(s, i - 1, ACC);
    const double *L0 = column_of(s, i - 1, J3);
    if (M < m1 + m3 + 1.0)
        m3 = m1 = 1.0;
    m2 = M - m1 - m3;
    split(row_of(s, i), m1, m2, m3, last ? 1.0 : 0.0);
    v1 = to_velocity(m1, m2 + m3);
    v2 = to_velocity(m2, m3);
    v3 = to_velocity(m3, 0.0) + (last ? 0.0 : 0.25);
    p1 = to_position(m1, m2 + m3);
    p2 = to_position(m2, m3);
    p3 = to_position(m3, 0.0);
    /* j3 = (R1 - m1 j1 - m2 j2) / m3, then two equations for j1, j2 */
    v1 -= v3 * m1 / m3;
    v2 -= v3 * m2 / m3;
    p1 -= p3 * m1 / m3;
    p2 -= p3 * m2 / m3;
    over = 1.0 / (v1 * p2 - v2 * p1);
    for (int32_t k = 0; k < s->joints; k++) {
        double v = 0.0, A = 0.0, dq = q[k] - q[k - s->joints], r1, r2, r3, j1, j2, j3;
        double w = 0.5 * V0[k] - A0[k] / 3.0 + 0.125 * L0[k];
        if (!last) {
            double H = (double)s->cycles[i + 1], d = q[k + s->joints] - q[k];
            double left, right;
            v = velocity_at(s, i, k);
            left = (2.0 * velocity_at(s, i - 1, k) + 4.0 * v) / N - 6.0 * dq / (N * N);
            right = 6.0 * d / (H * H) - (4.0 * v + 2.0 * velocity_at(s, i + 1, k)) / H;
            A = (N * N * left + H * H * right) / (N * N + H * H); /* the longer one's: it is weak */
            x = v + 0.5 * A;
        }
        r1 = A - A0[k];
        r2 = (last ? 0.0 : x) - V0[k] - M * A0[k] - v3 * r1 / m3;
        r3 = dq + 0.5 * v - A / 12.0 - w - M * V0[k] - 0.5 * M * M * A0[k] - p3 * r1 / m3;
        j1 = (r2 * p2 - v2 * r3) * over;
        j2 = (v1 * r3 - p1 * r2) * over;
        j3 = (r1 - m1 * j1 - m2 * j2) / m3;
        column_of(s, i, J1)[k] = j1;
        column_of(s, i, J2)[k] = j2;
        column_of(s, i, J3)[k] = j3;
        column_of(s, i, ACC)[k] = A;
        column_of(s, i, VEL)[k] = last ? 0.0 : x - 0.25 * j3;
    }
}

/* ---- the whole window ------------------------------------------------------------------------ */

void sj_follow_solve(const sj_follow *s, int64_t first, int64_t to, int64_t reach)
{
    int64_t n = s->points - 1, low = first > reach ? first - reach : 1;
    if (s->velocity || n == 1) {
        for (int64_t i = first; i <= to; i++)
            pass(s, i);
        return;
    }
    for (int64_t i = first; i <= to && i < n; i++) {
        if (i == 1)
            sweep_first(s);
        else
            sweep(s, i);
    }
    if (to == n)
        sweep_last(s);
    for (int64_t i = to == n ? n - 1 : to; i >= low; i--)
        back(s, i);
}

/* ---- results --------------------------------------------------------------------------------- */

/* Segments 1 .. count as phases: lengths (count, 4), jerks (count, 4, joints) per cycle^3, and the
 * continuous states at the knots 0 .. count, (count + 1, joints). */
void sj_follow_read(const sj_follow *s, int64_t count, int64_t *length, double *jerk,
                    double *velocity, double *acceleration, double *last_jerk)
{
    size_t bytes = (size_t)s->joints * sizeof(double);
    int64_t J = s->joints;
    for (int64_t i = 0; i <= count; i++) {
        memcpy(velocity + i * J, column_of(s, i, VEL), bytes);
        memcpy(acceleration + i * J, column_of(s, i, ACC), bytes);
        memcpy(last_jerk + i * J, column_of(s, i, J3), bytes);
        if (i == 0)
            continue;
        for (int p = 0; p < 4; p++) {
            double m = row_of(s, i)[M1 + p];
            length[4 * (i - 1) + p] = (int64_t)m;
            for (int64_t k = 0; k < J; k++)
                jerk[(4 * (i - 1) + p) * J + k] =
                    p < 3 && m > 0.0 ? column_of(s, i, J1 + p)[k] : 0.0;
        }
        if (i == s->points - 1)
            for (int64_t k = 0; k < J; k++)
                last_jerk[i * J + k] = 0.0;
    }
}

void sj_follow_begin(const sj_follow *s, const double *velocity, const double *acceleration,
                     const double *last_jerk)
{
    size_t bytes = (size_t)s->joints * sizeof(double);
    memset(row_of(s, 0), 0, (size_t)sj_follow_row(s->joints) * sizeof(double));
    memcpy(column_of(s, 0, VEL), velocity, bytes);
    memcpy(column_of(s, 0, ACC), acceleration, bytes);
    memcpy(column_of(s, 0, J3), last_jerk, bytes);
}

/* The samples of one segment, cycles 1 .. N after its first knot; the last is the way-point itself.
 * from, to: the way-points; V, A: the continuous state at the first, L: the jerk before it. */
static void sample(int64_t joints, const double *from, const double *to, const double *V0,
                   const double *A0, const double *L0, const int64_t *length, const double *jerk,
                   const sj_follow_samples *out, int64_t first)
{
    int64_t row = first;
    for (int64_t k = 0; k < joints; k++) {
        segment_state at = {segment_first(V0[k], A0[k], L0[k]), V0[k], A0[k]};
        row = first;
        for (int p = 0; p < 4; p++) {
            double J = jerk[p * joints + k];
            for (int64_t c = 1; c <= length[p]; c++, row++) {
                segment_state now = segment_sample(at, (double)c, J);
                out->position[row * joints + k] = from[k] + now.P;
                out->velocity[row * joints + k] = now.V;
                out->acceleration[row * joints + k] = now.A;
                out->jerk[row * joints + k] = J;
            }
            at = segment_after(at, (double)length[p], J);
        }
        out->position[(row - 1) * joints + k] = to[k];
    }
}

int64_t sj_follow_sample(int64_t count, int64_t joints, const double *position,
                         const double *velocity, const double *acceleration,
                         const double *last_jerk, const int64_t *length, const double *jerk,
                         const sj_follow_samples *out)
{
    int64_t row = 0;
    for (int64_t i = 0; i < count; i++) {
        int64_t at = i * joints;
        sample(joints, position + at, position + at + joints, velocity + at, acceleration + at,
               last_jerk + at, length + 4 * i, jerk + 4 * at, out, row);
        for (int p = 0; p < 4; p++)
            row += length[4 * i + p];
    }
    return row;
}
