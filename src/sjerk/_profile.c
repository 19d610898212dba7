/* Planning in C, for use inside a control cycle. Time in cycles, positions relative to the start.
 * Never here: clocks, shared memory, drive words.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include "_kernel.h"

static void append(sj_plan *plan, double cycles, double jerk)
{
    if (cycles >= 1.0) {
        plan->phase[plan->count++] = (sj_phase){(int64_t)cycles, jerk};
        plan->cycles += (int64_t)cycles;
    }
}

/* To rest from a continuous state (V, A): the acceleration to zero, then one symmetric ramp in whole
 * cycles, Eqs. (7)-(9) rounded up. */
void sj_plan_stop(const sj_state *from, const sj_limits *limits, sj_plan *plan)
{
    double jerk = fmin(limits->jerk, limits->deceleration_jerk);
    double most = fmin(limits->acceleration, limits->deceleration);
    double A = from->acceleration, V = from->velocity, T, Ta, level;

    *plan = (sj_plan){0};
    if (A != 0.0) {
        T = ceil(fabs(A) / jerk);
        append(plan, T, -A / T);
        V += 0.5 * T * A;
    }
    if (V != 0.0) {
        T = ceil(fabs(V) * jerk < most * most ? sqrt(fabs(V) / jerk) : most / jerk); /* Eq. (7) */
        Ta = fmax(T, ceil(fabs(V) / most));                                          /* Eq. (8) */
        level = -V / Ta;                                                             /* Eq. (9) */
        append(plan, T, level / T);
        append(plan, Ta - T, 0.0);
        append(plan, T, -level / T);
    }
}
