/* The period of several servos at once, for the case that lasts: position control without a brake.
 *
 * An inner step waits for its divisions and sums, so that SJ_SERVO_LANES motors take little longer than
 * one. Here are the operations of sj_servo_period (_servo.c) in the same order, hence the same bits.
 * Without it the whole cycle of a kernel with 7 simulated drives takes 1.3 times as long at 250 us,
 * 2.1 times at 1 ms (16 drives: 1.4 and 2.2); `./run bench -k drives_per_period` times the drives.
 * Increments are whole doubles, exact up to 2^53.
 * Never here: a motor that sj_servo_period would treat otherwise.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */
#include "base/_simd.h"      /* several motors at once */

typedef struct {
    double behind[SJ_SERVO_LANES],
        turned[SJ_SERVO_LANES]; /* increments: demand - encoder; of this period */
    double fraction[SJ_SERVO_LANES], w[SJ_SERVO_LANES], measured[SJ_SERVO_LANES];
    double torque[SJ_SERVO_LANES], integral[SJ_SERVO_LANES], asked[SJ_SERVO_LANES];
    double torque_limits[SJ_SERVO_LANES],
        speed_limits[SJ_SERVO_LANES]; /* inner steps that they cut off */
    double demand_fraction[SJ_SERVO_LANES], advance[SJ_SERVO_LANES];
    double start[SJ_SERVO_LANES], change[SJ_SERVO_LANES], offset[SJ_SERVO_LANES],
        feed_torque[SJ_SERVO_LANES];
    double torque_min[SJ_SERVO_LANES], torque_max[SJ_SERVO_LANES], speed_max[SJ_SERVO_LANES];
    double steps_inverse[SJ_SERVO_LANES], step_s[SJ_SERVO_LANES], move[SJ_SERVO_LANES],
        measure[SJ_SERVO_LANES];
    double position_gain[SJ_SERVO_LANES], feedforward[SJ_SERVO_LANES];
    double velocity_gain[SJ_SERVO_LANES], integral_gain[SJ_SERVO_LANES];
    double torque_gain[SJ_SERVO_LANES], filter_gain[SJ_SERVO_LANES];
    double friction[SJ_SERVO_LANES], friction_speed[SJ_SERVO_LANES], viscous[SJ_SERVO_LANES],
        load[SJ_SERVO_LANES];
    double inertia_inverse[SJ_SERVO_LANES], bound[SJ_SERVO_LANES];
} lanes;

static const double exact_increments = 0x1p50; /* far within 2^53, and within what `down` takes */

/* The next whole number below, or x itself. */
static inline double down(double x)
{
    const double shift =
        0x1.8p52; /* where neighbours are 1 apart: the sum rounds to a whole number */
    const double near = (x + shift) - shift;
    return near - (near > x ? 1.0 : 0.0);
}

/* clamp(), as two choices that need no branch; low <= high. */
static inline double within(double value, double low, double high)
{
    const double least = value < low ? low : value;
    return least > high ? high : least;
}

static int runs_in_lane(const sj_servo *servo, const sj_servo_constants *c,
                        const sj_servo_command *command)
{
    const double behind = (double)(int64_t)((uint64_t)command->demand - (uint64_t)servo->encoder);
    const double most = c->speed_bound_rad_s * (c->step_s * c->increments_per_rad) * c->steps;
    const double encoder = (double)servo->encoder;
    const double room = most + 2.0 + 0x1p-50 * (encoder < 0.0 ? -encoder : encoder);

    return command->control == SJ_SERVO_POSITION && encoder - room > (double)c->stop_low &&
           encoder + room < (double)c->stop_high &&
           !(command->brake != 0 && c->brake_torque_nm > 0.0) && behind < exact_increments &&
           behind > -exact_increments && most < exact_increments;
}

static void load_lane(lanes *m, int32_t i, const sj_servo *servo, const sj_servo_constants *c,
                      const sj_servo_command *command)
{
    m->behind[i] = (double)(int64_t)((uint64_t)command->demand - (uint64_t)servo->encoder);
    m->turned[i] = 0.0;
    m->fraction[i] = servo->fraction;
    m->w[i] = servo->velocity_rad_s;
    m->measured[i] = servo->measured_rad_s;
    m->torque[i] = servo->torque_nm;
    m->integral[i] = servo->integral_nm;
    m->asked[i] = 0.0;
    m->torque_limits[i] = 0.0;
    m->speed_limits[i] = 0.0;
    m->demand_fraction[i] = command->fraction;
    m->advance[i] = command->advance;
    m->start[i] = command->velocity_start_rad_s;
    m->change[i] = command->velocity_end_rad_s - command->velocity_start_rad_s;
    m->offset[i] = command->velocity_offset_rad_s;
    m->feed_torque[i] = command->torque_nm;
    m->torque_min[i] = command->torque_min_nm;
    m->torque_max[i] = command->torque_max_nm;
    m->speed_max[i] = command->speed_max_rad_s;
    m->steps_inverse[i] = c->steps_inverse;
    m->step_s[i] = c->step_s;
    m->move[i] = c->step_s * c->increments_per_rad;
    m->measure[i] = 1.0 / (c->step_s * c->increments_per_rad);
    m->position_gain[i] = c->position_gain;
    m->feedforward[i] = c->velocity_feedforward;
    m->velocity_gain[i] = c->velocity_gain;
    m->integral_gain[i] = c->integral_gain;
    m->torque_gain[i] = c->torque_gain;
    m->filter_gain[i] = c->filter_gain;
    m->friction[i] = c->friction_nm;
    m->friction_speed[i] = c->friction_speed_rad_s;
    m->viscous[i] = c->viscous_nm_s;
    m->load[i] = c->load_torque_nm;
    m->inertia_inverse[i] = c->inertia_inverse;
    m->bound[i] = c->speed_bound_rad_s;
}

static void store_lane(const lanes *m, int32_t i, sj_servo *servo)
{
    servo->encoder = (int64_t)((uint64_t)servo->encoder + (uint64_t)(int64_t)m->turned[i]);
    servo->fraction = m->fraction[i];
    servo->velocity_rad_s = m->w[i];
    servo->measured_rad_s = m->measured[i];
    servo->torque_nm = m->torque[i];
    servo->command_nm = m->asked[i];
    servo->integral_nm = m->integral[i];
    servo->torque_limited = m->torque_limits[i] != 0.0;
    servo->speed_limited = m->speed_limits[i] != 0.0;
}

SIMD static void run_lanes(lanes *restrict m, int32_t steps)
{
    for (int32_t step = 0; step < steps; step++)
        for (int32_t i = 0; i < SJ_SERVO_LANES; i++) {
            const double part = step * m->steps_inverse[i];
            /* position loop with feed-forward */
            const double feed = m->start[i] + m->change[i] * part;
            const double lag = m->behind[i] + m->demand_fraction[i] + m->advance[i] * part;
            const double target =
                m->position_gain[i] * lag + m->feedforward[i] * feed + m->offset[i];
            /* velocity loop: PI, integral held while the torque limit cuts it off */
            const double wanted = within(target, -m->speed_max[i], m->speed_max[i]);
            const double error = wanted - m->measured[i];
            const double sum = m->velocity_gain[i] * error + m->integral[i] + m->feed_torque[i];
            const double above = sum > m->torque_max[i] ? error : 0.0;
            const double below = sum < m->torque_min[i] ? error : 0.0;
            const double next = m->integral[i] + m->integral_gain[i] * error;
            const double kept = above > 0.0 ? m->integral[i] : next;
            const double asked = within(sum, m->torque_min[i], m->torque_max[i]);
            const double torque = m->torque[i] + m->torque_gain[i] * (asked - m->torque[i]);
            /* mechanics */
            const double before = m->w[i];
            const double speed = before < 0.0 ? -before : before;
            const double friction = m->friction[i] * before / (speed + m->friction_speed[i]);
            const double w =
                within(before + (torque - friction - m->viscous[i] * before - m->load[i]) *
                                    m->inertia_inverse[i] * m->step_s[i],
                       -m->bound[i], m->bound[i]);
            /* encoder: whole increments, the rest stays in the fraction */
            const double place = m->fraction[i] + w * m->move[i];
            const double whole = down(place);

            m->speed_limits[i] += wanted != target ? 1.0 : 0.0;
            m->torque_limits[i] += sum > m->torque_max[i] ? 1.0 : 0.0;
            m->torque_limits[i] += sum < m->torque_min[i] ? 1.0 : 0.0;
            m->integral[i] = below < 0.0 ? m->integral[i] : kept;
            m->asked[i] = asked;
            m->torque[i] = torque;
            m->w[i] = w;
            m->fraction[i] = place - whole;
            m->turned[i] += whole;
            m->behind[i] -= whole;
            m->measured[i] += m->filter_gain[i] * (whole * m->measure[i] - m->measured[i]);
        }
}

void sj_servo_periods(int32_t count, sj_drive *const *drives, const sj_servo_command *commands)
{
    int32_t of[SJ_SERVO_LANES], n = 0;
    lanes m;

    for (int32_t i = 0; i < count; i++) {
        sj_drive *drive = drives[i];
        if (count > 1 && runs_in_lane(&drive->servo, &drive->constants, &commands[i]) &&
            drive->constants.steps == drives[0]->constants.steps) {
            load_lane(&m, n, &drive->servo, &drive->constants, &commands[i]);
            of[n++] = i;
        } else {
            sj_servo_period(&drive->servo, &drive->constants, &commands[i]);
        }
    }
    if (n == 0)
        return;
    for (int32_t i = n; i < SJ_SERVO_LANES; i++)
        load_lane(&m, i, &drives[of[0]]->servo, &drives[of[0]]->constants, &commands[of[0]]);
    run_lanes(&m, drives[0]->constants.steps);
    for (int32_t i = 0; i < n; i++)
        store_lane(&m, i, &drives[of[i]]->servo);
}
