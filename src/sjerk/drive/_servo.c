/* The simulated motor and its inner loops: position P, velocity PI, torque lag, mechanics, encoder.
 *
 * One call is one SYNC period of inner steps at 8 kHz, of dt each (docs/explanation/drive.md):
 *     target   = Kp e + ff w_demand + w_offset            e, w_demand of the moment of the reading
 *     asked    = Kv (target - w_measured) + integral + torque_demand      clamped; integral held then
 *     torque  += (1 - exp(-dt / T_torque)) (asked - torque)
 *     w       += (torque - F w / (|w| + w0) - viscous w - load) dt / J
 *     encoder += whole increments of w dt; the rest stays in the fraction; a hard stop takes all of w
 *     measured += (1 - exp(-dt / T_filter)) (increments / dt - measured)
 * Friction is Coulomb friction made smooth: the same slope at rest as F tanh(w / w0), no call into
 * libm, and exact in every processor. _servo_simd.c does the same for several motors.
 * Never here: states, words, limits of the profile, clocks, memory.
 */
#include <stdint.h>          /* fixed widths */
#include <math.h>            /* ceil, floor while preparing; nothing in the inner step */
#include "base/_math.h"      /* exp(x) - 1 */
#include "drive/_internal.h" /* what the files of the drive share */

void sj_servo_prepare(sj_servo_constants *c, const sj_drive_config *config)
{
    const double inertia = config->inertia_kg_m2 * (1.0 + config->load_inertia_ratio);
    const double gain = SJ_TWO_PI * config->velocity_bandwidth_hz * inertia;

    /* The next multiple of the period at or above the wanted rate; 1e-9 forgives its rounding. */
    c->steps = (int32_t)ceil(config->period_s * config->inner_rate_hz * (1.0 - 1e-9));
    c->steps = c->steps < 1 ? 1 : c->steps;
    c->pad = 0;
    c->step_s = config->period_s / c->steps;
    c->steps_inverse = 1.0 / c->steps;
    c->increments_per_rad =
        (double)config->encoder_increments / config->encoder_revolutions / SJ_TWO_PI;
    c->position_gain = config->position_gain_per_s / c->increments_per_rad;
    c->velocity_feedforward = config->velocity_feedforward;
    c->velocity_gain = gain;
    c->integral_gain = gain * c->step_s / config->velocity_integral_s;
    c->torque_gain = -exp_minus_1(-c->step_s / config->torque_time_s);
    c->filter_gain = -exp_minus_1(-c->step_s / config->velocity_filter_s);
    c->friction_nm = config->friction_nm;
    c->friction_speed_rad_s = config->friction_speed_rad_s;
    c->viscous_nm_s = config->viscous_nm_s;
    c->load_torque_nm = config->load_torque_nm;
    c->brake_torque_nm = config->brake_torque_nm;
    c->inertia_kg_m2 = inertia;
    c->inertia_inverse = 1.0 / inertia;
    c->speed_bound_rad_s = 4.0 * config->max_speed_rpm * SJ_TWO_PI / 60.0;
    c->stop_low = config->hard_stop_negative_rev > -1e9
                      ? (int64_t)ceil(config->hard_stop_negative_rev * config->encoder_increments /
                                      config->encoder_revolutions)
                      : INT64_MIN;
    c->stop_high = config->hard_stop_positive_rev < 1e9
                       ? (int64_t)floor(config->hard_stop_positive_rev *
                                        config->encoder_increments / config->encoder_revolutions)
                       : INT64_MAX;
}

static double clamp(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

/* A closed brake is dry friction: it takes speed away and then holds. */
static double braked(double velocity, double change)
{
    if (velocity > change) {
        return velocity - change;
    }
    return velocity < -change ? velocity + change : 0.0;
}

void sj_servo_period(sj_servo *servo, const sj_servo_constants *c, const sj_servo_command *command)
{
    const double step_s = c->step_s;
    const double torque_min = command->torque_min_nm;
    const double torque_max = command->torque_max_nm;
    const double speed_max = command->speed_max_rad_s;
    const double measure = 1.0 / (step_s * c->increments_per_rad);
    const double move = step_s * c->increments_per_rad;
    const double brake = c->brake_torque_nm * c->inertia_inverse * step_s;
    const int braking = command->brake != 0 && c->brake_torque_nm > 0.0;
    const int32_t control = command->control;
    int64_t encoder = servo->encoder;
    double fraction = servo->fraction;
    double w = servo->velocity_rad_s;
    double measured = servo->measured_rad_s;
    double torque = servo->torque_nm;
    double integral = servo->integral_nm;
    double asked = 0.0;
    int32_t torque_limited = 0;
    int32_t speed_limited = 0;

    if (control == SJ_SERVO_OFF) {
        torque = 0.0;
        integral = 0.0;
    }
    for (int32_t step = 0; step < c->steps; step++) {
        /* the demand of the moment at which the encoder was read */
        const double part = step * c->steps_inverse;

        if (control != SJ_SERVO_OFF) {
            /* velocity command: position loop with feed-forward, or the interpolated target */
            const double change = command->velocity_end_rad_s - command->velocity_start_rad_s;
            const double feed = command->velocity_start_rad_s + change * part;
            double target = feed;
            if (control == SJ_SERVO_POSITION) {
                const int64_t behind = (int64_t)((uint64_t)command->demand - (uint64_t)encoder);
                const double error = (double)behind + command->fraction + command->advance * part;
                target = c->position_gain * error + c->velocity_feedforward * feed +
                         command->velocity_offset_rad_s;
            }
            if (control == SJ_SERVO_TORQUE) {
                /* no velocity loop; no torque that would drive beyond the speed limit */
                asked = command->torque_nm;
                if ((measured > speed_max && asked > 0.0) ||
                    (measured < -speed_max && asked < 0.0)) {
                    asked = 0.0;
                    speed_limited = 1;
                }
                integral = 0.0;
            } else {
                /* velocity loop: PI, integral held while the torque limit cuts it off */
                const double wanted = clamp(target, -speed_max, speed_max);
                const double error = wanted - measured;
                speed_limited |= wanted != target;
                asked = c->velocity_gain * error + integral + command->torque_nm;
                if (!(asked > torque_max && error > 0.0) && !(asked < torque_min && error < 0.0)) {
                    integral += c->integral_gain * error;
                }
            }
            torque_limited |= asked > torque_max || asked < torque_min;
            asked = clamp(asked, torque_min, torque_max);
            torque += c->torque_gain * (asked - torque);
        }
        /* mechanics */
        const double speed = w < 0.0 ? -w : w;
        const double friction = c->friction_nm * w / (speed + c->friction_speed_rad_s);
        w += (torque - friction - c->viscous_nm_s * w - c->load_torque_nm) * c->inertia_inverse *
             step_s;
        if (braking) {
            w = braked(w, brake);
        }
        w = clamp(w, -c->speed_bound_rad_s, c->speed_bound_rad_s);

        /* encoder: whole increments, the rest stays in the fraction */
        fraction += w * move;
        int64_t whole = (int64_t)fraction;
        whole -= (double)whole > fraction;
        fraction -= (double)whole;
        encoder = (int64_t)((uint64_t)encoder + (uint64_t)whole);
        /* a hard stop gives way to nothing and throws nothing back */
        if (w > 0.0 && encoder >= c->stop_high) {
            const int64_t beyond = encoder - c->stop_high;
            const int64_t back = beyond < whole ? beyond : whole;
            encoder -= back;
            whole -= back;
            fraction = w = 0.0;
        } else if (w < 0.0 && encoder < c->stop_low) {
            const int64_t beyond = c->stop_low - encoder;
            const int64_t back = beyond < -whole ? beyond : -whole;
            encoder += back;
            whole += back;
            fraction = w = 0.0;
        }
        measured += c->filter_gain * ((double)whole * measure - measured);
    }
    servo->encoder = encoder;
    servo->fraction = fraction;
    servo->velocity_rad_s = w;
    servo->measured_rad_s = measured;
    servo->torque_nm = torque;
    servo->command_nm = asked;
    servo->integral_nm = integral;
    servo->torque_limited = torque_limited;
    servo->speed_limited = speed_limited;
}
