/* How long the segments take: stretched while a limit is exceeded, then each gives back what it can.
 *
 * A trial of other cycles for one segment solves REACH segments on either side again (_follow.c) and
 * looks at all their limits; a first look at its neighbours alone, which writes nothing, spares most.
 * docs/explanation/trajectories.md. Never here: allocation, time, layouts of memory.
 */
#include <math.h> /* fabs, sqrt, ceil */
#include <stdint.h>
#include <string.h>     /* memcpy of rows */
#include "base/_math.h" /* cube root */
#include "trajectory/_following.h"
#include "_follow.h" /* rows, and how they are solved */

enum { NEAR = 5, ROUNDS = 4000, PASSES = 50 };
/* Room for rounding: of a trial, and of the whole. */
static const double TIGHT = 1.0 + 1e-10, WITHIN = 1.0 + 5e-10;

int64_t sj_follow_spare(int32_t joints) { return (2 * REACH + 2) * sj_follow_row(joints); }

/* Fewest cycles of segment i: so many jerks as it has, and one of rest at the end. */
int64_t sj_follow_least(const sj_follow *s, int64_t i)
{
    int64_t last = s->points - 1;
    int64_t least = s->velocity || last == 1 ? 3 : 2;
    if (i == last && (s->velocity || last == 1))
        least = 4;
    else if (i == last)
        least = 3;
    return s->least[i] > least ? s->least[i] : least;
}

static double larger(double a, double b) { return a > b ? a : b; }

/* Whether segment i keeps the limits times `room`. */
static int fits(const sj_follow *s, int64_t i, double room)
{
    const double *row = row_of(s, i), *most = s->limits;
    const double *V0 = column_of(s, i - 1, VEL), *A0 = column_of(s, i - 1, ACC);
    for (int32_t k = 0; k < s->joints; k++, most += 3) {
        double V = V0[k], A = A0[k], vmax = most[0] * room, amax = most[1] * room;
        double jmax = most[2] * room;
        if (!(fabs(V) <= vmax && fabs(A) <= amax))
            return 0;
        for (int p = 0; p < 3; p++) {
            double m = row[M1 + p], J, A1;
            if (m == 0.0)
                break;
            J = column_of(s, i, J1 + p)[k];
            A1 = A + m * J;
            if (!(fabs(J) <= jmax && fabs(A1) <= amax))
                return 0;
            /* a zero of A is a peak of V */
            if (A * A1 < 0.0 && !(fabs(V - A * A / (2.0 * J)) <= vmax))
                return 0;
            V += 0.5 * m * (A + A1);
            A = A1;
            if (!(fabs(V) <= vmax))
                return 0;
        }
    }
    return 1;
}

/* Largest use of the limits in segment i, as shares; or as what its time must be multiplied with. */
static double used(const sj_follow *s, int64_t i, int as_time)
{
    const double *row = row_of(s, i);
    double worst = 0.0;
    for (int32_t k = 0; k < s->joints; k++) {
        double vmax = s->limits[3 * k], amax = s->limits[3 * k + 1], jmax = s->limits[3 * k + 2];
        double V = column_of(s, i - 1, VEL)[k], A = column_of(s, i - 1, ACC)[k];
        double v = fabs(V), a = fabs(A), j = 0.0, u;
        for (int p = 0; p < 3; p++) {
            double m = row[M1 + p], J = column_of(s, i, J1 + p)[k], A1;
            if (m == 0.0)
                break;
            A1 = A + m * J;
            if (A * A1 < 0.0)
                v = larger(v, fabs(V - A * A / (2.0 * J)));
            V += 0.5 * m * (A + A1);
            A = A1;
            v = larger(v, fabs(V));
            a = larger(a, fabs(A));
            j = larger(j, fabs(J));
        }
        u = as_time ? larger(v / vmax, larger(sqrt(a / amax), cube_root(j / jmax)))
                    : larger(v / vmax, larger(a / amax, j / jmax));
        if (!isfinite(u))
            return u;
        worst = larger(worst, u);
    }
    return worst;
}

/* Whether joint k keeps the limits times `room` in segments first .. last of a stretch: A[m], V[m] at
 * their ends from m = first - 1 on, one jerk each. */
static int joint_fits(const double *most, double room, const double *A, const double *V,
                      const double *h, int first, int last)
{
    double vmax = most[0] * room, amax = most[1] * room, jmax = most[2] * room;
    for (int m = first; m <= last; m++) {
        double A0 = A[m - 1], J = (A[m] - A0) * (1.0 / h[m]), V0 = V[m - 1], A1 = A0 + h[m] * J;
        if (!(fabs(V0) <= vmax && fabs(A0) <= amax && fabs(J) <= jmax && fabs(A1) <= amax))
            return 0;
        if (A0 * A1 < 0.0 && !(fabs(V0 - A0 * A0 / (2.0 * J)) <= vmax))
            return 0;
        if (!(fabs(V0 + 0.5 * h[m] * (A0 + A1)) <= vmax))
            return 0;
    }
    return 1;
}

/* A first look at segment i > 2 with so many cycles, NEAR segments on either side solved again but
 * nothing written: what a hundredth of the change leaves open is not decided here. */
static int looks_good(const sj_follow *s, int64_t i, int64_t cycles)
{
    enum { BACK = 3, SIZE = BACK + NEAR + 1 }; /* m = 0 .. : knots i - BACK .. i + NEAR */
    double room = 1.0 + 0.2 * (double)(s->cycles[i] - cycles) / (double)s->cycles[i];
    double h[SIZE], f[SIZE], over[SIZE], beta[SIZE], delta[SIZE], lever[SIZE];
    for (int m = 0; m < SIZE; m++) {
        const double *row = row_of(s, i - BACK + m);
        h[m] = m == BACK ? (double)cycles : (double)s->cycles[i - BACK + m];
        if (m < BACK) {
            beta[m] = row[BETA];
            delta[m] = row[DELTA];
            f[m] = row[F];
            continue;
        }
        follow_pivot(h[m], beta[m - 1], delta[m - 1], &over[m], &f[m]);
        lever[m] = beta[m - 1] + 0.5 * h[m];
        beta[m] = lever[m] * f[m] + 0.5 * h[m];
        delta[m] = (1.0 - f[m]) / h[m];
    }
    for (int32_t k = 0; k < s->joints; k++) {
        double alpha[SIZE], gamma, e[SIZE], A[SIZE], V[SIZE];
        const double *q = s->position + i * s->joints + k;
        for (int m = 0; m < BACK; m++) {
            alpha[m] = column_of(s, i - BACK + m, ALPHA)[k];
            e[m] = column_of(s, i - BACK + m, E)[k];
        }
        gamma = column_of(s, i - 1, GAMMA)[k];
        for (int m = BACK; m < SIZE; m++, q += s->joints) {
            e[m] = (h[m] * alpha[m - 1] + 0.125 * gamma - (q[0] - q[-s->joints])) * over[m];
            alpha[m] = alpha[m - 1] + lever[m] * e[m];
            gamma = -e[m] / h[m];
        }
        A[SIZE - 1] = column_of(s, i + NEAR, ACC)[k];
        for (int m = SIZE - 1; m > 0; m--)
            A[m - 1] = e[m] + f[m] * A[m];
        for (int m = 1; m <= BACK + 1; m++)
            V[m] = alpha[m] + beta[m] * A[m];
        if (!joint_fits(s->limits + 3 * k, room, A, V, h, 2, BACK + 1))
            return 0;
    }
    return 1;
}

/* Segments 1 and 2 feel the two jerks of the first one, the last ones those of the last. */
static int can_look(const sj_follow *s, int64_t i)
{
    return !s->velocity && i > 3 && i + NEAR < s->points - 1;
}

/* Whether segment i can have so many cycles with the others fixed; if not, nothing has changed. */
static int try_cycles(const sj_follow *s, int64_t i, int64_t cycles)
{
    int64_t n = s->points - 1, from = i, reach = REACH;
    int64_t low = i > REACH ? i - REACH - 1 : 0, high, size = sj_follow_row(s->joints);
    int64_t before = s->cycles[i];
    int good = 1;
    if (s->velocity) { /* three-phase segments feel less of each other */
        from = i > 2 ? i - 2 : 1;
        low = from - 1;
        reach = REACH / 2;
    }
    high = i + reach < n ? i + reach : n;
    if (can_look(s, i) && !looks_good(s, i, cycles))
        return 0;
    memcpy(s->spare, row_of(s, low), (size_t)((high - low + 1) * size) * sizeof(double));
    s->cycles[i] = cycles;
    sj_follow_solve(s, from, high, REACH);
    for (int64_t d = 0; good && (i - d > low || i + d <= high); d++) {
        if (i + d <= high)
            good = fits(s, i + d, TIGHT);
        if (good && d > 0 && i - d > low)
            good = fits(s, i - d, TIGHT);
    }
    if (!good) {
        s->cycles[i] = before;
        memcpy(row_of(s, low), s->spare, (size_t)((high - low + 1) * size) * sizeof(double));
    }
    return good;
}

/* Segments around i may have room again. */
static void mark(const sj_follow *s, int64_t i, double value)
{
    int64_t low = i > REACH ? i - REACH : 1,
            high = i + REACH < s->points ? i + REACH : s->points - 1;
    for (int64_t k = low; k <= high; k++)
        row_of(s, k)[MARK] = value;
}

/* The most cycles, up to `most`, that a first look at segment i lets it lose. */
static int64_t seems_free(const sj_follow *s, int64_t i, int64_t most)
{
    int64_t low = 0, high = 1;
    while (high <= most && looks_good(s, i, s->cycles[i] - high)) {
        low = high;
        high *= 2;
    }
    if (high > most)
        high = most + 1;
    while (high - low > 1) {
        int64_t middle = low + (high - low) / 2;
        if (looks_good(s, i, s->cycles[i] - middle))
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Give back cycles of segment i while the limits are kept; whether any were. */
static int trim(const sj_follow *s, int64_t i)
{
    int64_t before = s->cycles[i], least = sj_follow_least(s, i);
    while (s->cycles[i] > least) {
        int64_t room = s->cycles[i] - least, lost = 1; /* the most frequent end: not even one */
        if (can_look(s, i))
            lost = seems_free(s, i, room);
        else if (s->cycles[i] < before)
            lost = room < 8 ? room : 8;
        while (lost > 0 && !try_cycles(s, i, s->cycles[i] - lost))
            lost /= 2;
        if (lost == 0)
            break;
    }
    return s->cycles[i] < before;
}

/* Stretch what exceeds its limits until nothing does; solves first. */
static int32_t stretch(const sj_follow *s, double room)
{
    int64_t n = s->points - 1;
    sj_follow_solve(s, 1, n, REACH);
    for (int64_t i = 1; i <= n; i++)
        row_of(s, i)[MARK] = 1.0; /* to be looked at */
    for (int32_t round = 0; round < ROUNDS; round++) {
        int64_t longer = 0, first = 0, last = 0;
        for (int64_t i = 1; i <= n; i++) {
            double u, more;
            int64_t g;
            if (row_of(s, i)[MARK] != 1.0)
                continue;
            row_of(s, i)[MARK] = 0.0;
            if (fits(s, i, room))
                continue;
            u = used(s, i, 1);
            if (!isfinite(u))
                return SJ_FOLLOW_INVALID;
            u = u > 1.5 ? 1.5 : u;
            /* a segment much shorter than its neighbour sets the neighbour's velocity */
            g = i;
            if (i > 1 && s->shorter * s->cycles[i - 1] < s->cycles[g])
                g = i - 1;
            if (i < n && s->shorter * s->cycles[i + 1] < s->cycles[i] &&
                s->cycles[i + 1] < s->cycles[g])
                g = i + 1;
            more = ceil((double)s->cycles[g] * (0.4 + 0.6 * u));
            if (more > (double)SJ_CYCLES_MAX)
                return SJ_FOLLOW_TOO_LONG;
            s->cycles[g] = (int64_t)more > s->cycles[g] ? (int64_t)more : s->cycles[g] + 1;
            row_of(s, g)[MARK] = 2.0; /* changed */
            longer++;
        }
        if (!longer)
            return SJ_FOLLOW_OK;
        /* solve again around runs of changed segments */
        for (int64_t i = 1; i <= n + 1; i++) {
            int changed = i <= n && row_of(s, i)[MARK] == 2.0;
            if (changed) {
                if (!first)
                    first = i;
                last = i;
            }
            if (first && (i > n || i - last > 2 * REACH)) {
                int64_t from = s->velocity && first > 2 ? first - 2 : s->velocity ? 1 : first;
                int64_t to = last + REACH < n ? last + REACH : n;
                int64_t low = first > REACH ? first - REACH : 1;
                sj_follow_solve(s, from, to, REACH);
                for (int64_t k = low; k <= to; k++)
                    row_of(s, k)[MARK] = 1.0;
                first = 0;
            }
        }
    }
    return SJ_FOLLOW_STUCK;
}

int32_t sj_follow_plan(const sj_follow *s)
{
    int64_t n = s->points - 1;
    if (n < 1 || s->joints < 1)
        return SJ_FOLLOW_INVALID;
    for (int64_t i = 1; i <= n; i++) {
        int64_t least = sj_follow_least(s, i);
        if (s->cycles[i] < least)
            s->cycles[i] = least;
    }
    for (int32_t again = 0; again < 4; again++) {
        int32_t status = stretch(s, again ? WITHIN : TIGHT);
        int change = 1, any = 0;
        if (status != SJ_FOLLOW_OK)
            return status;
        for (int64_t i = 1; i <= n; i++)
            row_of(s, i)[MARK] = 1.0; /* to be tried */
        for (int32_t round = 0; change && round < PASSES; round++) {
            change = 0;
            for (int64_t i = 1; i <= n; i++) {
                if (row_of(s, i)[MARK] != 1.0)
                    continue;
                row_of(s, i)[MARK] = 0.0;
                if (!trim(s, i))
                    continue;
                mark(s, i, 1.0);
                change = any = 1;
            }
        }
        if (!any)
            return SJ_FOLLOW_OK;
    }
    return stretch(s, WITHIN);
}

void sj_follow_shares(const sj_follow *s, double *share)
{
    sj_follow_solve(s, 1, s->points - 1, REACH);
    share[0] = 0.0;
    for (int64_t i = 1; i < s->points; i++)
        share[i] = used(s, i, 0);
}

/* Whether segment i could be a cycle shorter with the others fixed; nothing changes. */
int32_t sj_follow_could_lose(const sj_follow *s, int64_t i)
{
    int64_t before = s->cycles[i];
    if (before <= sj_follow_least(s, i))
        return 0;
    if (!try_cycles(s, i, before - 1))
        return 0;
    s->cycles[i] = before;
    sj_follow_solve(s, 1, s->points - 1, REACH);
    return 1;
}
