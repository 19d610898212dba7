/* The interpolator, Eqs. (15)-(17).
 *
 * Time is counted in cycles (T_s = 1), so the bilinear integration is sums and halves only; done in
 * double-double it is exact far below the last bit of a position. Never here: planning, time,
 * memory of its own, drives.
 */
#include <float.h> /* DBL_EPSILON, for the rounding of levels */
#include <math.h>  /* fabs, isfinite */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memset of an interpolator */
#include "_kernel.h"
#include "base/_double_double.h" /* double-double sums */
#include "base/_continuous.h"    /* from samples to the continuous motion and back */
#include "base/_simd.h"          /* several phases, several cycles at once */

/* ---- Eqs. (15)-(17) -------------------------------------------------------------------------- */

/* A sum with nothing costs nothing; the bits are the same. */
static sj_exact plus(sj_exact x, sj_exact y) { return y.hi == 0.0 ? x : exact_add(x, y); }

/* The mean of two neighbours. */
static sj_exact mean(sj_exact now, sj_exact before)
{
    return now.hi == before.hi && now.lo == before.lo ? now : exact_half(exact_add(now, before));
}

/* One cycle of jerk j[k] from the sample at k-1. */
static void integrate(sj_interpolator *ip, sj_exact j)
{
    sj_exact a, v, q;
    /* Eq. (15): a[k] = a[k-1] + 0.5 (j[k] + j[k-1]) */
    a = plus(ip->a, mean(j, ip->j));
    /* Eq. (16): v[k] = v[k-1] + 0.5 (a[k] + a[k-1]) */
    v = plus(plus(ip->v, mean(a, ip->a)), ip->spread_v);
    /* Eq. (17): q[k] = q[k-1] + 0.5 (v[k] + v[k-1]) */
    q = plus(ip->q, mean(v, ip->v));
    q = plus(q, ip->spread_q);
    ip->q.hi = exact_nearest(q.hi, q.lo);
    ip->q.lo = q.lo - (ip->q.hi - q.hi);
    ip->v = v;
    ip->a = a;
    ip->j = j;
}

void sj_interpolator_start(sj_interpolator *ip, const sj_state *sample)
{
    memset(ip, 0, offsetof(sj_interpolator, legs)); /* of the legs none is used */
    ip->q = exact_of(sample->position);
    ip->v = exact_of(sample->velocity);
    ip->a = exact_of(sample->acceleration);
    ip->goal = sample->position;
    ip->goal_velocity = sample->velocity;
    ip->goal_free = 1;
}

/* ---- the half-cycle lemma -------------------------------------------------------------------- */

void sj_lemma_plan(const sj_state *sample, double jerk, sj_state *plan)
{
    continuous p = lemma(exact_of(sample->position), exact_of(sample->velocity),
                         exact_of(sample->acceleration), exact_of(jerk));
    *plan = (sj_state){p.P.hi, p.V.hi, p.A.hi};
}

void sj_lemma_sample(const sj_state *plan, double jerk, sj_state *sample)
{
    sj_exact a = exact_two_sum(plan->acceleration, -0.5 * jerk);
    sj_exact v = exact_subtract(exact_of(plan->velocity), exact_half(a));
    sj_exact q = exact_subtract(exact_of(plan->position), exact_half(v));
    q = exact_add(q, exact_divide(exact_of(plan->acceleration), 12.0));
    *sample = (sj_state){q.hi, v.hi, a.hi};
}

/* ---- loading a plan -------------------------------------------------------------------------- */

/* How far the rounding of a plan may leave its end from the goal, relative to the distance it covers and,
 * a thousandth of it, to the limits it was made under. A plan that is further off was not made for
 * this start. */
static const double landing_tolerance = 1e-9, of_limits = 1e-3;

/* The acceleration at the end of a phase, as the planner meant it: zero where only rounding is left. */
static double level_after(double level, const sj_phase *phase)
{
    double change = (double)phase->cycles * phase->jerk;
    double end = level + change;
    return fabs(end) <= 16.0 * DBL_EPSILON * fabs(change) ? 0.0 : end;
}

enum { SIMD_PHASES = 4 }; /* phases at once; SJ_PHASES is a multiple of it */
_Static_assert(SJ_PHASES % SIMD_PHASES == 0, "no phase is left over");

/* The phases of a plan by columns: what each needs of the others is its acceleration levels alone, so
 * that the divisions of all of them are done side by side. */
typedef struct {
    double cycles[SJ_PHASES];                                        /* n */
    double level_hi[SJ_PHASES], level_lo[SJ_PHASES], end[SJ_PHASES]; /* A, and A_end */
    double jerk_hi[SJ_PHASES], jerk_lo[SJ_PHASES];
    double V_hi[SJ_PHASES], V_lo[SJ_PHASES]; /* what the phase adds to V */
    double P_hi[SJ_PHASES], P_lo[SJ_PHASES]; /* and to P, besides n V */
} columns;

/* Lengths and levels up to the goal's, checked: enum sj_load_status. */
static int32_t levels_of(const sj_plan *plan, sj_exact level, double goal, double *steepest,
                         columns *c)
{
    int64_t cycles = 0;

    if (plan->count < 0 || plan->count > SJ_PHASES)
        return SJ_LOAD_PHASES;
    for (int32_t i = 0; i < plan->count; i++) {
        const sj_phase *phase = &plan->phase[i];
        double end;
        if (phase->cycles < 1 || phase->cycles > SJ_CYCLES_MAX - cycles || !isfinite(phase->jerk))
            return SJ_LOAD_PHASES;
        end = level_after(level.hi, phase);
        *steepest = fmax(*steepest, fabs(end));
        if (i == plan->count - 1) {
            if (fabs(end - goal) > landing_tolerance * *steepest)
                return SJ_LOAD_MISSES;
            end = goal;
        }
        c->cycles[i] = (double)phase->cycles;
        c->level_hi[i] = level.hi;
        c->level_lo[i] = level.lo;
        c->end[i] = end;
        level = exact_of(end);
        cycles += phase->cycles;
    }
    for (int32_t i = plan->count; i % SIMD_PHASES != 0; i++) {
        c->cycles[i] = 1.0;
        c->level_hi[i] = c->level_lo[i] = c->end[i] = 0.0;
    }
    return cycles == plan->cycles ? SJ_LOAD_OK : SJ_LOAD_PHASES;
}

/* Eqs. (5), (3) over a phase: P += n V + n^2 (2 A + A_end) / 6,  V += n (A + A_end) / 2 */
SIMD static void fill_columns(columns *restrict c, int32_t count)
{
    for (int32_t first = 0; first < count; first += SIMD_PHASES)
        for (int32_t i = first; i < first + SIMD_PHASES; i++) {
            double n = c->cycles[i];
            sj_exact A = {c->level_hi[i], c->level_lo[i]}, end = exact_of(c->end[i]);
            sj_exact jerk = exact_divide(exact_subtract(end, A), n);
            sj_exact V = exact_half(exact_scale(exact_add(A, end), n));
            sj_exact P = exact_divide(
                exact_multiply(exact_two_product(n, n), exact_add(exact_add(A, A), end)), 6.0);
            c->jerk_hi[i] = jerk.hi;
            c->jerk_lo[i] = jerk.lo;
            c->V_hi[i] = V.hi;
            c->V_lo[i] = V.lo;
            c->P_hi[i] = P.hi;
            c->P_lo[i] = P.lo;
        }
}

/* Take over a plan from the present sample: by the lemma the continuous state, then exactly along
 * the phases; what is missing to the goal at the end is spread over all cycles. The interpolator is
 * unchanged unless SJ_LOAD_OK is returned. goal_free: the end position is where the phases lead. */
int32_t sj_interpolator_load(sj_interpolator *ip, const sj_plan *plan, double goal,
                             double goal_velocity, int32_t goal_free)
{
    sj_state end = {goal, goal_velocity, 0.0};
    return sj_interpolator_load_to(ip, plan, &end, goal_free);
}

int32_t sj_interpolator_load_to(sj_interpolator *ip, const sj_plan *plan, const sj_state *end,
                                int32_t goal_free)
{
    const double goal = end->position, goal_velocity = end->velocity;
    continuous at = lemma(ip->q, ip->v, ip->a, ip->j);
    sj_exact start = at.P;
    double path = fabs(goal - start.hi);
    double resolution = DBL_EPSILON * fmax(fabs(goal), fabs(start.hi)); /* of a goal so far out */
    double fastest = fmax(fmax(fabs(at.V.hi), fabs(goal_velocity)), of_limits * plan->velocity);
    double steepest = fmax(fabs(at.A.hi), of_limits * plan->acceleration);
    sj_exact missing_v, spread_q = exact_of(0.0);
    double steps;
    columns c;
    int32_t status = levels_of(plan, at.A, end->acceleration, &steepest, &c);

    if (status != SJ_LOAD_OK)
        return status;
    fill_columns(&c, plan->count);
    for (int32_t i = 0; i < plan->count; i++) {
        double n = c.cycles[i];
        at.P = exact_add(at.P, exact_scale(at.V, n));
        at.P = exact_add(at.P, (sj_exact){c.P_hi[i], c.P_lo[i]});
        at.V = exact_add(at.V, (sj_exact){c.V_hi[i], c.V_lo[i]});
        fastest = fmax(fastest, fabs(at.V.hi));
        path += n * fastest;
    }

    /* Lemma, point 2: the sample settles half a cycle of velocity after the plan's end. What is then
     * missing of velocity and position is spread evenly over all cycles, N + 1. */
    steps = (double)(plan->cycles + 1);
    if (end->acceleration != 0.0) { /* as far as the sample: V += A / 2, P += A / 12 */
        at.V = exact_add(at.V, exact_half(exact_of(end->acceleration)));
        at.P = exact_add(at.P, exact_divide(exact_of(end->acceleration), 12.0));
    }
    missing_v = exact_subtract(exact_of(goal_velocity), at.V);
    if (!(fabs(missing_v.hi) <= landing_tolerance * fastest))
        return SJ_LOAD_MISSES;
    if (!goal_free) {
        sj_exact settled = exact_add(at.P, exact_half(at.V));
        sj_exact missing = exact_subtract(exact_of(goal), settled);
        missing = exact_subtract(missing, exact_half(exact_scale(missing_v, steps)));
        if (!(fabs(missing.hi) <= landing_tolerance * (path + steps * fastest) + resolution))
            return SJ_LOAD_MISSES;
        spread_q = exact_divide(missing, steps);
    }
    for (int32_t i = 0; i < plan->count; i++)
        ip->legs[i] = (sj_leg){plan->phase[i].cycles, {c.jerk_hi[i], c.jerk_lo[i]}};
    ip->spread_v = exact_divide(missing_v, steps);
    ip->spread_q = spread_q;
    ip->goal = goal;
    ip->goal_velocity = goal_velocity;
    ip->goal_acceleration = end->acceleration;
    ip->goal_free = goal_free;
    ip->count = plan->count;
    ip->leg = 0;
    ip->left = plan->count > 0 ? ip->legs[0].cycles : 0;
    ip->cycles_left = plan->cycles + 1;
    return SJ_LOAD_OK;
}

/* ---- one cycle and many ---------------------------------------------------------------------- */

static void settle(sj_interpolator *ip)
{
    if (!ip->goal_free)
        ip->q = exact_of(ip->goal);
    ip->v = exact_of(ip->goal_velocity);
    ip->a = exact_of(ip->goal_acceleration);
    ip->j = ip->spread_v = ip->spread_q = exact_of(0.0);
}

static void count_cycles(sj_interpolator *ip, int64_t cycles)
{
    if (ip->cycles_left > 0) {
        ip->cycles_left -= cycles;
        if (ip->cycles_left == 0)
            settle(ip);
    }
    if (ip->leg < ip->count) {
        ip->left -= cycles;
        if (ip->left == 0 && ++ip->leg < ip->count)
            ip->left = ip->legs[ip->leg].cycles;
    }
}

/* The sample of the next cycle. Returns 1 until the motion has settled, then 0; a settled motion
 * goes on with its end velocity and acceleration. */
int32_t sj_interpolator_step(sj_interpolator *ip)
{
    integrate(ip, ip->leg < ip->count ? ip->legs[ip->leg].jerk : exact_of(0.0));
    count_cycles(ip, 1);
    return ip->cycles_left > 0;
}

enum { BLOCK = 256 }; /* cycles evaluated from one exact anchor */

/* x cut to its upper `bits` bits, and the rest: products of the upper part with small integers are
 * exact. */
static sj_exact cut(sj_exact x, int bits)
{
    double big = (double)((INT64_C(1) << (53 - bits)) + 1) * x.hi;
    double top = big - (big - x.hi);
    return (sj_exact){top, (x.hi - top) + x.lo};
}

/* n <= BLOCK cycles inside a leg, Eqs. (15)-(17) summed in closed form from the present sample:
 *   a[m] = a + m j,   v[m] = v + m a + m^2 j/2,   q[m] = q + m (v + j/12) + m^2 a/2 + m^3 j/6
 * where what is spread over the cycles adds to a in v and q, and to v in q.
 * The products of the upper parts are exact (m: 8 bits), their sums carry their error along: each
 * q[m] is the nearest double of the exact sum, as from single steps. */
SIMD static void fill_block(sj_interpolator *ip, double cycle_time_s, int64_t row, int n,
                            const sj_table *out)
{
    sj_exact j12 = exact_divide(ip->j, 12.0);
    sj_exact c1 = exact_add(exact_add(ip->v, j12), ip->spread_q);
    sj_exact growth = exact_add(ip->a, ip->spread_v);
    sj_exact c2 = exact_half(growth), c3 = exact_add(j12, j12);
    sj_exact top1 = cut(c1, 44), top2 = cut(c2, 36), top3 = cut(c3, 28);
    const double q_hi = ip->q.hi, q_lo = ip->q.lo;
    const double t1 = top1.hi, t2 = top2.hi, t3 = top3.hi;
    const double r1 = top1.lo, r2 = top2.lo, r3 = top3.lo;
    const double T = cycle_time_s, per_T = 1.0 / T, per_T2 = per_T / T, k = (double)row - 1.0;
    const double v = ip->v.hi * per_T, a = ip->a.hi * per_T2, j = ip->j.hi * per_T2;
    const double v_a = ip->a.hi * per_T, v_j = 0.5 * ip->j.hi * per_T, jerk = j * per_T;
    double *restrict time = out->time + row, *restrict position = out->position + row;
    double *restrict velocity = out->velocity + row, *restrict jerks = out->jerk + row;
    double *restrict acceleration = out->acceleration + row;
    double m_n = (double)n;
    sj_exact squared = exact_of(m_n * m_n), cubed = exact_of(m_n * m_n * m_n);

    for (int i = 0; i < n; i++) {
        double m = (double)(i + 1), m2 = m * m;
        sj_exact s1 = exact_two_sum(q_hi, m * t1);
        sj_exact s2 = exact_two_sum(s1.hi, m2 * t2);
        sj_exact s3 = exact_two_sum(s2.hi, m2 * m * t3);
        double low = (s1.lo + s2.lo + s3.lo) + (q_lo + m * (r1 + m * (r2 + m * r3)));
        sj_exact q = exact_two_sum(s3.hi, low);
        position[i] = exact_nearest(q.hi, q.lo);
        velocity[i] = v + m * (v_a + m * v_j);
        acceleration[i] = a + m * j;
        jerks[i] = jerk;
        time[i] = (k + m) * T;
    }
    ip->q = exact_add(ip->q, exact_scale(c1, m_n));
    ip->q = exact_add(ip->q, exact_multiply(c2, squared));
    ip->q = exact_add(ip->q, exact_multiply(c3, cubed));
    ip->v = exact_add(ip->v, exact_scale(growth, m_n));
    ip->v = exact_add(ip->v, exact_half(exact_multiply(ip->j, squared)));
    ip->a = exact_add(ip->a, exact_scale(ip->j, m_n));
    count_cycles(ip, n);
}

static void write_row(const sj_interpolator *ip, double T, int64_t row, const sj_table *out)
{
    out->time[row] = (double)row * T;
    out->position[row] = ip->q.hi;
    out->velocity[row] = ip->v.hi / T;
    out->acceleration[row] = ip->a.hi / (T * T);
    out->jerk[row] = ip->j.hi / (T * T * T);
}

/* The next cycles as rows first_row .. rows - 1 of a table, in SI units of time. */
void sj_interpolator_fill(sj_interpolator *ip, double cycle_time_s, int64_t first_row,
                          const sj_table *out)
{
    for (int64_t row = first_row; row < out->rows;) {
        int64_t inside = ip->leg < ip->count ? ip->left : 0, room = out->rows - row;
        int n = (int)(inside < BLOCK ? inside : BLOCK);
        n = room < n ? (int)room : n;
        /* A leg's first cycle mixes two jerks, its last may settle the motion: single steps. */
        if (n > 4 && ip->left < ip->legs[ip->leg].cycles) {
            fill_block(ip, cycle_time_s, row, n, out);
            row += n;
        } else {
            sj_interpolator_step(ip);
            write_row(ip, cycle_time_s, row, out);
            row++;
        }
    }
}

/* A whole motion: row 0 the start, rows 1 .. N the cycles, row N + 1 the settled end. `from` and `to`
 * are samples (sj_state) in SI units of time, the plan is in cycle units. */
int32_t sj_sample(const sj_plan *plan, const void *from, const void *to, double cycle_time_s,
                  const sj_table *out)
{
    const double T = cycle_time_s;
    const sj_state *start = from, *end = to;
    sj_state first = {start->position, start->velocity * T, start->acceleration * T * T};
    int64_t last = plan->cycles + 1;
    sj_state goal = {end->position, end->velocity * T, end->acceleration * T * T};
    sj_interpolator ip;
    int32_t status;

    sj_interpolator_start(&ip, &first);
    status = sj_interpolator_load_to(&ip, plan, &goal, 0);
    if (status != SJ_LOAD_OK)
        return status;
    sj_interpolator_fill(&ip, T, 1, out);
    out->time[0] = 0.0;
    out->position[0] = start->position;
    out->velocity[0] = start->velocity;
    out->acceleration[0] = start->acceleration;
    out->jerk[0] = 0.0;
    if (out->rows > last) { /* not converted to cycle units and back */
        out->velocity[last] = end->velocity;
        out->acceleration[last] = end->acceleration;
    }
    return SJ_LOAD_OK;
}
