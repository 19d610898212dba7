/* The samples of segments of constant jerk, as the bilinear integrator gives them.
 *
 * By the half-cycle lemma (_segment.h) each is a function of its own cycle; the last of a segment is the
 * position at its end, bit for bit. Never here: allocation, time, where segments come from.
 */
#include <stdint.h>
#include "base/_segment.h" /* what a sample is */
#include "trajectory/_samples.h"

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
