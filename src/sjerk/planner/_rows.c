/* Many independent requests, for plan_many: several at once where they are all of the common kind (_lanes.c),
 * else one by one. The same bits as sj_plan_sample() either way. */
#include <stdint.h>
#include "base/_simd.h" /* wide vectors */
#include "planner/_internal.h"
#include "planner/_samples.h" /* a request between samples */

/* All lanes cost about what two rows do. */
enum { FEWEST_AT_ONCE = 4 };

static sj_state row_state(const double *row, int64_t columns)
{
    return (sj_state){row[0], columns > 1 ? row[1] : 0.0, columns > 2 ? row[2] : 0.0};
}

/* n independent axes: requests in rows of 1 to 3 columns (position, velocity, acceleration);
 * limits_step 0 for one Limits for all, 1 for one each. `phases` has room for SJ_PHASES of each, from
 * index `first` on. Stops at the first request that fails; *failed is its row. */
int32_t sj_plan_rows(int64_t n, double cycle_time_s, const double *from, int64_t from_columns,
                     const double *to, int64_t to_columns, const sj_limits *limits,
                     int64_t limits_step, sj_row *rows, sj_phase *phases, int64_t first,
                     int64_t *failed)
{
    sj_request r[SJ_LANES];
    lane_plan made[SJ_LANES];
    sj_plan plan;
    const int wide = SIMD_IS_WIDE;
    for (int64_t begin = 0; begin < n; begin += SJ_LANES) {
        int32_t count = n - begin < SJ_LANES ? (int32_t)(n - begin) : SJ_LANES;
        const sj_limits *l = limits + begin * limits_step;
        for (int32_t i = 0; i < count; i++) {
            sj_state start = row_state(from + (begin + i) * from_columns, from_columns);
            sj_state end = row_state(to + (begin + i) * to_columns, to_columns);
            r[i] = request_between(cycle_time_s, &start, &end);
        }
        int at_once = wide && count >= FEWEST_AT_ONCE;
        if (at_once)
            sj_lanes_plan(count, r, l, limits_step, made);
        for (int32_t i = 0; i < count; i++) {
            sj_begin(&plan);
            if (at_once && made[i].ok) {
                sj_seven_put(&plan, &made[i].t, &made[i].s);
                plan.kind = SJ_PLAN_CRUISE;
            } else {
                int32_t status = sj_plan_move(r[i].distance, r[i].v0, r[i].a0, r[i].v1,
                                              l + i * limits_step, &plan);
                if (status != SJ_PLAN_OK) {
                    *failed = begin + i;
                    return status;
                }
            }
            rows[begin + i] = (sj_row){plan.cycles, first, plan.count, plan.kind};
            for (int32_t k = 0; k < plan.count; k++)
                phases[first + k] = plan.phase[k];
            first += plan.count;
        }
    }
    return SJ_PLAN_OK;
}
