/* Numbers, states, limits and plans: what every room of C speaks of.
 *
 * Units: the motion core is unit-free and counts time in cycles (velocity per cycle, acceleration per
 * cycle^2, jerk per cycle^3). A drive counts encoder increments. SI units carry a suffix (_s). */
#pragma once
#include <stdint.h>

enum {
    SJ_AXES = 64,  /* most axes of one kernel */
    SJ_PHASES = 40 /* most phases of one plan */
};
#define SJ_CYCLES_MAX 1125899906842624 /* most cycles of one plan, 2^50 */

typedef struct {
    double hi, lo; /* the sum of both, about 106 bits (_double_double.h) */
} sj_exact;

typedef struct {
    double position, velocity, acceleration;
} sj_state;

/* Constant jerk over each of `cycles` whole cycles; Eq. (1). */
typedef struct {
    int64_t cycles;
    double jerk;
} sj_phase;

/* A motion in whole cycles, jerks per cycle^3 in the direction of the axis. */
typedef struct {
    int64_t cycles;                /* sum of the phases' cycles, N */
    int32_t count;                 /* phases used */
    int32_t kind;                  /* enum sj_plan_kind */
    double velocity, acceleration; /* limits it was made under, or 0: rounding is relative */
    double slipped; /* how much further it ends than asked: of sj_plan_meeting, else 0 */
    sj_phase phase[SJ_PHASES];
} sj_plan;

/* Magnitudes, per cycle; the direction of the motion has the first pair, against it the second. */
typedef struct {
    double velocity, acceleration, jerk, deceleration, deceleration_jerk;
} sj_limits;
