/* The contract: every struct, enum and prototype that two rooms share.
 *
 * Read verbatim by the compiler and by cffi (API mode), so: no include guard, no #include, no #if,
 * no static inline, no expression in a #define; enums for constants. Each .c file includes
 * <stdint.h> and <stddef.h> before it. Padding is written out, offsets are asserted in the rooms.
 *
 * Units: the motion core is unit-free and counts time in cycles (velocity per cycle, acceleration
 * per cycle^2, jerk per cycle^3). A drive counts encoder increments. SI units carry a suffix (_s).
 */

/* ---- ground ---------------------------------------------------------------------------------- */

enum {
    SJ_AXES = 64,                       /* most axes of one kernel */
    SJ_PHASES = 24                      /* most phases of one plan */
};
#define SJ_CYCLES_MAX 1125899906842624 /* most cycles of one plan, 2^50 */

typedef struct {
    double hi, lo;                      /* the sum of both, about 106 bits (_exact.h) */
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
    int64_t cycles;                     /* sum of the phases' cycles, N */
    int32_t count;                      /* phases used */
    int32_t reserved;
    sj_phase phase[SJ_PHASES];
} sj_plan;

/* ---- peers: handshake (_handshake.c) --------------------------------------------------------- */

/* ---- peers: drive (_cia402.c, _servo.c) ------------------------------------------------------ */

/* ---- wiring: interpolator and kernel cycle (_kernel.c) --------------------------------------- */

enum sj_load_status {
    SJ_LOAD_OK = 0,
    SJ_LOAD_PHASES = 1,                 /* a phase count or length out of range */
    SJ_LOAD_MISSES = 2                  /* the phases do not lead to the goal */
};

/* A phase as it is integrated: its jerk is the difference of two acceleration levels over its
 * length, so that an acceleration that is planned as zero is exactly zero. */
typedef struct {
    int64_t cycles;
    sj_exact jerk;
} sj_leg;

/* The bilinear integrator, Eqs. (15)-(17), in cycle units, and the legs ahead of it. */
typedef struct {
    sj_exact q, v, a, j;                /* the sample of this cycle */
    sj_exact spread;                    /* per cycle: what rounding the jerks to doubles costs */
    double goal, goal_velocity;         /* the settled end, cycle N + 1 */
    int64_t left;                       /* cycles left of the present leg */
    int64_t ahead;                      /* cycles until settled; 0 = settled */
    int32_t leg, count;
    int32_t goal_free;                  /* 1: a change of velocity, the end position is open */
    int32_t reserved;
    sj_leg legs[SJ_PHASES];
} sj_interpolator;

/* Rows of a sampled motion; every column has room for `rows`. */
typedef struct {
    int64_t rows;
    double *time, *position, *velocity, *acceleration, *jerk;
} sj_table;

void    sj_interpolator_start(sj_interpolator *ip, const sj_state *sample);
int32_t sj_interpolator_load(sj_interpolator *ip, const sj_plan *plan, double goal,
                             double goal_velocity, int32_t goal_free);
int32_t sj_interpolator_step(sj_interpolator *ip);
void    sj_interpolator_fill(sj_interpolator *ip, double cycle_time_s, int64_t first_row,
                             const sj_table *out);
int32_t sj_sample(const sj_plan *plan, const sj_state *start, const sj_state *end,
                  double cycle_time_s, const sj_table *out);
void    sj_lemma_plan(const sj_state *sample, double jerk, sj_state *plan);
void    sj_lemma_sample(const sj_state *plan, double jerk, sj_state *sample);
