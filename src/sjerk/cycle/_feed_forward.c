/* Feed-forward: 60B1h and 60B2h from the commanded positions q of this cycle and of the two before.
 *
 *     step   = q[k] - q[k-1]                   what the drive's demand goes in this period
 *     change = q[k] - 2 q[k-1] + q[k-2]        how the motor's speed has to change for it
 *     60B1h  = velocity step
 *     60B2h  = inertia change + friction step / (|step| + w0) + viscous step, and the load
 *
 * A drive interpolates from target to target, so the first difference, and no other velocity, is the one
 * of its demand. The differences are taken in double-double: exact wherever the axis is, and whatever
 * moves it. 60B2h is coarse, 0.1 % of the rated torque, and may be more than all that a motion needs:
 * what rounding leaves is carried to the next cycle, so the momentum that was fed forward is never off by
 * more than half a unit in one cycle. At rest nothing is left to carry, and the word stands. A drive
 * that does not follow gets the load alone; then the command is at rest where the axis is, and so are
 * the positions before.
 *
 * Never here: units (they are in the factors), what a drive does with the words.
 */
#include <float.h> /* DBL_MIN */
#include <math.h>  /* fabs, floor, fmax, fmin */
#include <stdint.h>
#include "base/_double_double.h"
#include "cycle/_feed_forward.h"

static double held(double value, double low, double high) { return fmin(fmax(value, low), high); }

/* The nearest whole number, of two the upper one: of a remainder in [-1/2, 1/2) it is 0. */
static double whole(double value) { return floor(value + 0.5); }

void sj_feed_forward_send(sj_kernel *kernel, int32_t axis)
{
    sj_axis *ax = &kernel->axis[axis];
    const sj_feed_forward *by = &ax->config.feed_forward;
    const sj_exact now = ax->interpolator.q;
    sj_exact step_now, step_before;
    double step, change, torque;

    if (!ax->following) {
        ax->before[0] = ax->before[1] = now;
        ax->torque_left = 0.0;
    }
    step_now = exact_subtract(now, ax->before[0]);
    step_before = exact_subtract(ax->before[0], ax->before[1]);
    ax->before[1] = ax->before[0];
    ax->before[0] = now;

    step = step_now.hi;
    change = exact_subtract(step_now, step_before).hi;
    torque = ax->torque_left + by->inertia * change + by->viscous * step;
    torque += by->friction * step / (fabs(step) + by->friction_step + DBL_MIN); /* never 0 / 0 */
    ax->torque_left = torque - whole(torque);
    torque = whole(torque) + by->load;
    kernel->rx[axis].velocity_offset =
        (int32_t)held(whole(by->velocity * step), INT32_MIN, INT32_MAX);
    kernel->rx[axis].torque_offset = (int16_t)held(torque, INT16_MIN, INT16_MAX);
}
