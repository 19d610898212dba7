/* The interpolator, Eqs. (15)-(17), and one cycle of the kernel.
 *
 * Time is counted in cycles (T_s = 1), so the bilinear integration is sums and halves only; done in
 * double-double it is exact far below the last bit of a position. Never here: planning, time,
 * memory of its own, bit masks of drives.
 */
#include <float.h>  /* DBL_EPSILON, for the rounding of levels */
#include <math.h>   /* fabs, isfinite */
#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy of a command */
#include "_kernel.h"
#include "_exact.h" /* double-double sums */
#include "_lemma.h" /* from samples to the continuous motion and back */

/* ---- Eqs. (15)-(17) -------------------------------------------------------------------------- */

/* One cycle of jerk j[k] from the sample at k-1. */
static void integrate(sj_interpolator *ip, sj_exact j)
{
    sj_exact a, v, q;
    /* Eq. (15): a[k] = a[k-1] + 0.5 (j[k] + j[k-1]) */
    a = exact_add(ip->a, exact_half(exact_add(j, ip->j)));
    /* Eq. (16): v[k] = v[k-1] + 0.5 (a[k] + a[k-1]) */
    v = exact_add(ip->v, exact_half(exact_add(a, ip->a)));
    v = exact_add(v, ip->spread_v);
    /* Eq. (17): q[k] = q[k-1] + 0.5 (v[k] + v[k-1]) */
    q = exact_add(ip->q, exact_half(exact_add(v, ip->v)));
    ip->q = exact_add(q, ip->spread_q);
    ip->v = v;
    ip->a = a;
    ip->j = j;
}

void sj_interpolator_start(sj_interpolator *ip, const sj_state *sample)
{
    *ip = (sj_interpolator){0};
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

/* How far the rounding of a plan may leave its end from the goal, relative to the way it covers and,
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

/* Take over a plan from the present sample: by the lemma the continuous state, then exactly along
 * the phases; what is missing to the goal at the end is spread over all cycles. The interpolator is
 * unchanged unless SJ_LOAD_OK is returned. goal_free: the end position is where the phases lead. */
int32_t sj_interpolator_load(sj_interpolator *ip, const sj_plan *plan, double goal,
                             double goal_velocity, int32_t goal_free)
{
    sj_interpolator next = *ip;
    continuous at = lemma(ip->q, ip->v, ip->a, ip->j);
    sj_exact start = at.P;
    double path = fabs(goal - start.hi);
    double resolution = DBL_EPSILON * fmax(fabs(goal), fabs(start.hi)); /* of a goal so far out */
    double fastest = fmax(fmax(fabs(at.V.hi), fabs(goal_velocity)), of_limits * plan->velocity);
    double steepest = fmax(fabs(at.A.hi), of_limits * plan->acceleration);
    int64_t cycles = 0;
    sj_exact missing_v;
    double steps;

    if (plan->count < 0 || plan->count > SJ_PHASES)
        return SJ_LOAD_PHASES;
    for (int32_t i = 0; i < plan->count; i++) {
        const sj_phase *phase = &plan->phase[i];
        double n = (double)phase->cycles, end;
        sj_exact change, twice;
        if (phase->cycles < 1 || phase->cycles > SJ_CYCLES_MAX - cycles || !isfinite(phase->jerk))
            return SJ_LOAD_PHASES;
        end = level_after(at.A.hi, phase);
        steepest = fmax(steepest, fabs(end));
        if (i == plan->count - 1) {
            if (fabs(end) > landing_tolerance * steepest)
                return SJ_LOAD_MISSES;
            end = 0.0;
        }
        change = exact_subtract(exact_of(end), at.A);
        next.legs[i].cycles = phase->cycles;
        next.legs[i].jerk = exact_divide(change, n);
        /* Eqs. (5), (3) over the phase: P += n V + n^2 (2 A + A_end) / 6,  V += n (A + A_end) / 2 */
        twice = exact_add(at.A, at.A);
        at.P = exact_add(at.P, exact_scale(at.V, n));
        at.P = exact_add(at.P, exact_divide(exact_multiply(exact_two_product(n, n),
                                                           exact_add(twice, exact_of(end))), 6.0));
        at.V = exact_add(at.V, exact_half(exact_scale(exact_add(at.A, exact_of(end)), n)));
        at.A = exact_of(end);
        cycles += phase->cycles;
        fastest = fmax(fastest, fabs(at.V.hi));
        path += n * fastest;
    }
    if (cycles != plan->cycles)
        return SJ_LOAD_PHASES;
    steps = (double)(cycles + 1);

    /* Lemma, point 2: the sample settles half a cycle of velocity after the plan's end. What is then
     * missing of velocity and position is spread evenly over all cycles, N + 1. */
    missing_v = exact_subtract(exact_of(goal_velocity), at.V);
    if (!(fabs(missing_v.hi) <= landing_tolerance * fastest))
        return SJ_LOAD_MISSES;
    next.spread_v = exact_divide(missing_v, steps);
    next.spread_q = exact_of(0.0);
    if (!goal_free) {
        sj_exact settled = exact_add(at.P, exact_half(at.V));
        sj_exact missing = exact_subtract(exact_of(goal), settled);
        missing = exact_subtract(missing, exact_half(exact_scale(missing_v, steps)));
        if (!(fabs(missing.hi) <= landing_tolerance * (path + steps * fastest) + resolution))
            return SJ_LOAD_MISSES;
        next.spread_q = exact_divide(missing, steps);
    }
    next.goal = goal;
    next.goal_velocity = goal_velocity;
    next.goal_free = goal_free;
    next.count = plan->count;
    next.leg = 0;
    next.left = plan->count > 0 ? next.legs[0].cycles : 0;
    next.ahead = cycles + 1;
    *ip = next;
    return SJ_LOAD_OK;
}

/* ---- one cycle and many ---------------------------------------------------------------------- */

static void settle(sj_interpolator *ip)
{
    if (!ip->goal_free)
        ip->q = exact_of(ip->goal);
    ip->v = exact_of(ip->goal_velocity);
    ip->a = ip->j = ip->spread_v = ip->spread_q = exact_of(0.0);
}

static void count_cycles(sj_interpolator *ip, int64_t cycles)
{
    if (ip->ahead > 0) {
        ip->ahead -= cycles;
        if (ip->ahead == 0)
            settle(ip);
    }
    if (ip->leg < ip->count) {
        ip->left -= cycles;
        if (ip->left == 0 && ++ip->leg < ip->count)
            ip->left = ip->legs[ip->leg].cycles;
    }
}

/* The sample of the next cycle. Returns 1 until the motion has settled, then 0; a settled motion
 * goes on with its end velocity. */
int32_t sj_interpolator_step(sj_interpolator *ip)
{
    integrate(ip, ip->leg < ip->count ? ip->legs[ip->leg].jerk : exact_of(0.0));
    count_cycles(ip, 1);
    return ip->ahead > 0;
}

enum { BLOCK = 256 }; /* cycles evaluated from one exact anchor */

/* Wider vectors where the processor has them. The same operations in the same order, no fused ones,
 * so the same bits. (Sanitizers start after the resolver of such a function runs.) */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__SANITIZE_ADDRESS__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

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
WIDE static void fill_block(sj_interpolator *ip, double cycle_time_s, int64_t row, int n,
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
        position[i] = s3.hi + low;
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
    sj_interpolator ip;
    int32_t status;

    sj_interpolator_start(&ip, &first);
    status = sj_interpolator_load(&ip, plan, end->position, end->velocity * T, 0);
    if (status != SJ_LOAD_OK)
        return status;
    sj_interpolator_fill(&ip, T, 1, out);
    out->time[0] = 0.0;
    out->position[0] = start->position;
    out->velocity[0] = start->velocity;
    out->acceleration[0] = start->acceleration;
    out->jerk[0] = 0.0;
    if (out->rows > last)
        out->velocity[last] = end->velocity; /* not by way of cycle units and back */
    return SJ_LOAD_OK;
}

/* ---- one cycle: collect, plan, interpolate, drive, publish ----------------------------------------- */

uint64_t sj_command_bytes(int32_t axes)
{
    return offsetof(sj_command, axis) + (uint64_t)axes * sizeof(sj_axis_command);
}

uint64_t sj_feedback_bytes(int32_t axes)
{
    return offsetof(sj_feedback, axis) + (uint64_t)axes * sizeof(sj_axis_feedback);
}

/* 0, or -1: the number of axes is out of range. Then every axis must be set. */
int32_t sj_kernel_init(sj_kernel *kernel, void *segment, int32_t axes)
{
    if (axes < 1 || axes > SJ_AXES)
        return -1;
    *kernel = (sj_kernel){0};
    kernel->segment = segment;
    kernel->axes = axes;
    kernel->feedback.axes = axes;
    kernel->feedback.result_axis = -1;
    return 0;
}

/* As sj_drive_init. */
int32_t sj_kernel_axis(sj_kernel *kernel, int32_t axis, const sj_drive_config *drive,
                       const sj_limits *limits, double counts_per_unit)
{
    sj_axis *ax = &kernel->axis[axis];
    int32_t status = sj_drive_init(&ax->drive, drive);
    if (status != 0)
        return status;
    ax->limits = *limits;
    ax->counts_per_unit = counts_per_unit;
    ax->cycle_time_s = drive->period_s;
    kernel->feedback.cycle_time_s = drive->period_s;
    sj_drive_cycle(&ax->drive, &ax->rx, &ax->tx);
    ax->actual_counts = ax->tx.position_actual;
    sj_interpolator_start(&ax->interpolator,
                          &(sj_state){(double)ax->actual_counts / counts_per_unit, 0.0, 0.0});
    return 0;
}

/* While the drive does not follow, the commanded position is the actual one. */
static void observe(sj_axis *ax)
{
    uint32_t change = (uint32_t)ax->tx.position_actual - (uint32_t)ax->actual_counts;
    ax->actual_counts += (int32_t)change;
    ax->following = sj_master_follows(ax->tx.statusword);
    if (!ax->following) {
        sj_state actual = {(double)ax->actual_counts / ax->counts_per_unit, 0.0, 0.0};
        sj_interpolator_start(&ax->interpolator, &actual);
        ax->goal.moves = 0;
    }
}

static int32_t moving(const sj_axis *ax)
{
    return ax->interpolator.ahead > 0 || ax->interpolator.v.hi != 0.0;
}

/* ---- plan, from the commanded state ---- */

static continuous commanded(const sj_axis *ax)
{
    const sj_interpolator *ip = &ax->interpolator;
    return lemma(ip->q, ip->v, ip->a, ip->j);
}

/* A jerk-limited way to rest; where it ends is open. A motion that comes to rest as soon by itself is
 * left to do so. */
static void stop_axis(sj_axis *ax)
{
    const sj_interpolator *ip = &ax->interpolator;
    continuous at = commanded(ax);
    sj_plan plan;
    if (!moving(ax) || sj_plan_velocity(at.V.hi, at.A.hi, 0.0, &ax->limits, &plan) != SJ_PLAN_OK)
        return;
    if (ip->goal_velocity == 0.0 && ip->ahead <= plan.cycles + 1)
        return;
    sj_interpolator_load(&ax->interpolator, &plan, 0.0, 0.0, 1);
    ax->goal.moves = 0; /* given up: the same goal again is a new motion */
}

/* No limit of a goal may exceed the axis's own, which its drive was checked against. */
static int32_t within(const sj_limits *asked, const sj_limits *own)
{
    const double slack = 1.0 + 1e-12; /* for conversions to cycle units and back */
    return asked->velocity <= own->velocity * slack &&
           asked->acceleration <= own->acceleration * slack &&
           asked->jerk <= own->jerk * slack &&
           asked->deceleration <= own->deceleration * slack &&
           asked->deceleration_jerk <= own->deceleration_jerk * slack;
}

static int32_t judge(const sj_kernel *kernel, const sj_axis *ax, const sj_axis_command *goal)
{
    if (!ax->following || !kernel->enable)
        return SJ_RESULT_NOT_FOLLOWING;
    if (!within(&goal->limits, &ax->limits))
        return SJ_RESULT_LIMITS;
    /* beyond 2^52 increments a double no longer tells two of them apart */
    if (!(fabs(goal->goal * ax->counts_per_unit) < 4503599627370496.0))
        return SJ_RESULT_RANGE;
    return SJ_RESULT_ACCEPTED;
}

static int32_t same_goal(const sj_axis_command *x, const sj_axis_command *y)
{
    return x->moves && x->goal == y->goal && x->goal_velocity == y->goal_velocity &&
           x->limits.velocity == y->limits.velocity &&
           x->limits.acceleration == y->limits.acceleration && x->limits.jerk == y->limits.jerk &&
           x->limits.deceleration == y->limits.deceleration &&
           x->limits.deceleration_jerk == y->limits.deceleration_jerk;
}

/* Plan all axes of the goal and take the plans over, or leave everything as it is. */
static int32_t plan_goal(sj_kernel *kernel, const int32_t *axes, int32_t n)
{
    const sj_command *command = &kernel->command;
    int32_t synchronization = command->synchronization;
    sj_request request[SJ_AXES];
    sj_limits limits[SJ_AXES];

    if (n < 1)
        return SJ_RESULT_ACCEPTED;
    for (int32_t i = 0; i < n; i++) {
        const sj_axis_command *goal = &command->axis[axes[i]];
        continuous at = commanded(&kernel->axis[axes[i]]);
        request[i] = (sj_request){lemma_distance(&at, goal->goal, goal->goal_velocity), at.V.hi,
                                  at.A.hi, goal->goal_velocity};
        limits[i] = goal->limits;
    }
    if (sj_plan_axes(n, request, limits, command->least_cycles, &synchronization, kernel->plan) !=
        SJ_PLAN_OK)
        return SJ_RESULT_PLAN;
    for (int32_t i = 0; i < n; i++) {
        const sj_axis_command *goal = &command->axis[axes[i]];
        kernel->trial[i] = kernel->axis[axes[i]].interpolator;
        if (sj_interpolator_load(&kernel->trial[i], &kernel->plan[i], goal->goal,
                                 goal->goal_velocity, 0) != SJ_LOAD_OK)
            return SJ_RESULT_PLAN;
    }
    for (int32_t i = 0; i < n; i++) {
        kernel->axis[axes[i]].interpolator = kernel->trial[i];
        kernel->axis[axes[i]].goal = command->axis[axes[i]];
    }
    return SJ_RESULT_ACCEPTED;
}

/* All axes take the goal, or none does. The same goal under the same limits changes nothing. */
static void take_goal(sj_kernel *kernel, int32_t stopped)
{
    const sj_command *command = &kernel->command;
    sj_feedback *feedback = &kernel->feedback;
    int32_t result = stopped ? SJ_RESULT_STOPPED : SJ_RESULT_ACCEPTED, refused = -1;
    int32_t axes[SJ_AXES], n = 0, changed = 0;

    kernel->goal_id = command->goal_id;
    for (int32_t i = 0; i < kernel->axes && result == SJ_RESULT_ACCEPTED; i++) {
        if (!command->axis[i].moves)
            continue;
        result = judge(kernel, &kernel->axis[i], &command->axis[i]);
        if (result != SJ_RESULT_ACCEPTED)
            refused = i;
        changed |= !same_goal(&kernel->axis[i].goal, &command->axis[i]);
        axes[n++] = i;
    }
    if (result == SJ_RESULT_ACCEPTED && changed)
        result = plan_goal(kernel, axes, n);
    for (int32_t i = 0; i < n && result == SJ_RESULT_ACCEPTED; i++) {
        sj_axis_feedback *out = &feedback->axis[axes[i]];
        out->goal = command->axis[axes[i]].goal;
        out->goal_id = command->goal_id;
        if (changed)
            out->peak_velocity = out->peak_acceleration = out->peak_jerk = 0.0;
    }
    feedback->result_goal_id = command->goal_id;
    feedback->result = result;
    feedback->result_axis = refused;
}

static void stop_all(sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        stop_axis(&kernel->axis[i]);
}

/* Edges are counters: each is acted on once, whatever was overwritten in between. */
static void collect(sj_kernel *kernel, uint64_t now_ns)
{
    sj_command *command = &kernel->command;
    int32_t host = sj_shm_host_state(kernel->segment, now_ns);
    int32_t stopped = kernel->ending, fresh;

    if (host != kernel->host_state && host == SJ_HOST_DEAD)
        stop_all(kernel); /* once; the next host may move on */
    kernel->host_state = host;
    if (kernel->ending && kernel->feedback.ending == 0)
        stop_all(kernel);
    kernel->feedback.ending = kernel->ending;
    fresh = sj_command_collect(kernel->segment, &kernel->incoming);
    if (fresh < 0) {
        kernel->feedback.corrupt++;
        stop_all(kernel);
    } else if (fresh == 1) {
        memcpy(command, &kernel->incoming, sj_command_bytes(kernel->axes));
        if (command->stop_count != kernel->stop_count) {
            kernel->stop_count = command->stop_count;
            stopped = 1;
            stop_all(kernel);
        }
        if (command->reset_count != kernel->reset_count) {
            kernel->reset_count = command->reset_count;
            kernel->reset = 2; /* one cycle low, then the edge */
        }
        kernel->enable = command->enable;
        if (command->goal_id != kernel->goal_id)
            take_goal(kernel, stopped);
        kernel->feedback.sequence = command->sequence;
        kernel->feedback.stop_count = kernel->stop_count;
        kernel->feedback.reset_count = kernel->reset_count;
    }
}

/* A drive is disabled only at rest. */
static int32_t wanted(const sj_kernel *kernel, const sj_axis *ax)
{
    return (kernel->enable && !kernel->ending) || (ax->following && moving(ax));
}

static void drive(sj_kernel *kernel, sj_axis *ax)
{
    double counts = ax->interpolator.q.hi * ax->counts_per_unit;
    int64_t target = ax->following ? llround(counts) : ax->actual_counts;
    ax->rx.mode = SJ_MODE_CSP;
    ax->rx.controlword =
        sj_master_controlword(ax->tx.statusword, wanted(kernel, ax), kernel->reset == 1);
    ax->rx.target_position = (int32_t)(uint32_t)(uint64_t)target; /* the counter wraps */
    sj_drive_cycle(&ax->drive, &ax->rx, &ax->tx);
}

static void report(const sj_axis *ax, sj_axis_feedback *out)
{
    const sj_interpolator *ip = &ax->interpolator;
    out->position = ip->q.hi;
    out->velocity = ip->v.hi;
    out->acceleration = ip->a.hi;
    out->jerk = ip->j.hi;
    out->peak_velocity = fmax(out->peak_velocity, fabs(ip->v.hi));
    out->peak_acceleration = fmax(out->peak_acceleration, fabs(ip->a.hi));
    out->peak_jerk = fmax(out->peak_jerk, fabs(ip->j.hi));
    out->actual_position = (double)ax->actual_counts / ax->counts_per_unit;
    out->actual_velocity = ax->tx.velocity_actual * ax->cycle_time_s / ax->counts_per_unit;
    out->target_counts = ax->following ? llround(ip->q.hi * ax->counts_per_unit)
                                       : ax->actual_counts;
    out->actual_counts = ax->actual_counts;
    out->following_error = ax->tx.following_error;
    out->statusword = ax->tx.statusword;
    out->error_code = ax->tx.error_code;
    out->moving = ax->following && moving(ax);
    out->settled = ax->goal.moves && ip->ahead == 0;
    out->follows = ax->following;
    out->enabled = sj_master_enabled(ax->tx.statusword);
    out->fault = sj_master_fault(ax->tx.statusword);
}

/* Top to bottom in the order of the data. now_ns: the begin of the cycle, any monotonic clock. */
void sj_kernel_cycle(sj_kernel *kernel, uint64_t now_ns)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        observe(&kernel->axis[i]);
    collect(kernel, now_ns);
    for (int32_t i = 0; i < kernel->axes; i++) {
        sj_axis *ax = &kernel->axis[i];
        if (ax->following)
            sj_interpolator_step(&ax->interpolator);
        drive(kernel, ax);
        report(ax, &kernel->feedback.axis[i]);
    }
    if (kernel->reset > 0)
        kernel->reset--;
    kernel->feedback.cycle++;
    kernel->feedback.time_ns = now_ns;
    kernel->feedback.kernel_epoch = sj_shm_kernel_epoch(kernel->segment);
    sj_shm_beat_kernel(kernel->segment, now_ns);
    sj_feedback_publish(kernel->segment, &kernel->feedback);
}

void sj_kernel_cycles(sj_kernel *kernel, int64_t cycles)
{
    while (cycles-- > 0)
        sj_kernel_cycle(kernel, 0);
}

int32_t sj_kernel_at_rest(const sj_kernel *kernel)
{
    for (int32_t i = 0; i < kernel->axes; i++)
        if ((kernel->axis[i].following && moving(&kernel->axis[i])) ||
            sj_master_enabled(kernel->axis[i].tx.statusword))
            return 0;
    return 1;
}
