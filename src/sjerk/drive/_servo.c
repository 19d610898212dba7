/* The simulated motor and its inner loops: position P, velocity PI, torque lag, mechanics, encoder.
 *
 * One call is one SYNC period of inner steps at 8 kHz. The structure is section 7 of the drive's
 * page in docs/explanation/drive.md; each statement of the inner step carries its name there.
 * Friction is Coulomb friction made smooth by F w / (|w| + w0): the same slope at rest as
 * F tanh(w / w0), no call into libm, and exact in every processor.
 * Never here: states, words, limits of the profile, clocks, memory.
 */
#include <stdint.h> /* the contract's integer types */
#include <stddef.h> /* required by the contract */
#include <math.h>   /* exp and ceil while preparing; nothing in the inner step */
#include "_internal.h" /* what the rooms of the drive share */
#include "base/_simd.h"  /* several motors at once */

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
    c->torque_gain = -expm1(-c->step_s / config->torque_time_s);
    c->filter_gain = -expm1(-c->step_s / config->velocity_filter_s);
    c->friction_nm = config->friction_nm;
    c->friction_speed_rad_s = config->friction_speed_rad_s;
    c->viscous_nm_s = config->viscous_nm_s;
    c->load_torque_nm = config->load_torque_nm;
    c->brake_torque_nm = config->brake_torque_nm;
    c->inertia_kg_m2 = inertia;
    c->inertia_inverse = 1.0 / inertia;
    c->speed_bound_rad_s = 4.0 * config->max_speed_rpm * SJ_TWO_PI / 60.0;
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
                const double error =
                    (double)behind + command->fraction + command->advance * part;
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

/* ---- several motors at once ---- */

/* An inner step waits for its divisions and sums, so that eight motors take little longer than one. Here
 * are the operations of sj_servo_period in the same order, hence the same bits, for the case that
 * lasts: position control without a brake. Increments are whole doubles, exact up to 2^53. */
typedef struct {
    double behind[SJ_MOTORS], turned[SJ_MOTORS];  /* increments: demand - encoder; of this period */
    double fraction[SJ_MOTORS], w[SJ_MOTORS], measured[SJ_MOTORS];
    double torque[SJ_MOTORS], integral[SJ_MOTORS], asked[SJ_MOTORS];
    double torque_limits[SJ_MOTORS], speed_limits[SJ_MOTORS];   /* inner steps that they cut off */
    double demand_fraction[SJ_MOTORS], advance[SJ_MOTORS];
    double start[SJ_MOTORS], change[SJ_MOTORS], offset[SJ_MOTORS], feed_torque[SJ_MOTORS];
    double torque_min[SJ_MOTORS], torque_max[SJ_MOTORS], speed_max[SJ_MOTORS];
    double steps_inverse[SJ_MOTORS], step_s[SJ_MOTORS], move[SJ_MOTORS], measure[SJ_MOTORS];
    double position_gain[SJ_MOTORS], feedforward[SJ_MOTORS];
    double velocity_gain[SJ_MOTORS], integral_gain[SJ_MOTORS];
    double torque_gain[SJ_MOTORS], filter_gain[SJ_MOTORS];
    double friction[SJ_MOTORS], friction_speed[SJ_MOTORS], viscous[SJ_MOTORS], load[SJ_MOTORS];
    double inertia_inverse[SJ_MOTORS], bound[SJ_MOTORS];
} motors;

static const double exact_increments = 0x1p50; /* far within 2^53, and within what `down` takes */

/* The next whole number below, or x itself. */
static inline double down(double x)
{
    const double shift = 0x1.8p52; /* where neighbours are 1 apart: the sum rounds to a whole number */
    const double near = (x + shift) - shift;
    return near - (near > x ? 1.0 : 0.0);
}

/* clamp(), as two choices that need no branch; low <= high. */
static inline double within(double value, double low, double high)
{
    const double least = value < low ? low : value;
    return least > high ? high : least;
}

static int fits(const sj_servo *servo, const sj_servo_constants *c, const sj_servo_command *command)
{
    const double behind = (double)(int64_t)((uint64_t)command->demand - (uint64_t)servo->encoder);
    const double most = c->speed_bound_rad_s * (c->step_s * c->increments_per_rad) * c->steps;

    return command->control == SJ_SERVO_POSITION &&
           !(command->brake != 0 && c->brake_torque_nm > 0.0) && behind < exact_increments &&
           behind > -exact_increments && most < exact_increments;
}

static void put(motors *m, int32_t i, const sj_servo *servo, const sj_servo_constants *c,
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

static void take(const motors *m, int32_t i, sj_servo *servo)
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

WIDE static void turn(motors *restrict m, int32_t steps)
{
    for (int32_t step = 0; step < steps; step++)
        for (int32_t i = 0; i < SJ_MOTORS; i++) {
            const double part = step * m->steps_inverse[i];
            /* position loop with feed-forward */
            const double feed = m->start[i] + m->change[i] * part;
            const double lag = m->behind[i] + m->demand_fraction[i] + m->advance[i] * part;
            const double target = m->position_gain[i] * lag + m->feedforward[i] * feed + m->offset[i];
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
            const double w = within(before + (torque - friction - m->viscous[i] * before -
                                              m->load[i]) * m->inertia_inverse[i] * m->step_s[i],
                                    -m->bound[i], m->bound[i]);
            /* encoder: whole increments, the rest stays in the fraction */
            const double way = m->fraction[i] + w * m->move[i];
            const double whole = down(way);

            m->speed_limits[i] += wanted != target ? 1.0 : 0.0;
            m->torque_limits[i] += sum > m->torque_max[i] ? 1.0 : 0.0;
            m->torque_limits[i] += sum < m->torque_min[i] ? 1.0 : 0.0;
            m->integral[i] = below < 0.0 ? m->integral[i] : kept;
            m->asked[i] = asked;
            m->torque[i] = torque;
            m->w[i] = w;
            m->fraction[i] = way - whole;
            m->turned[i] += whole;
            m->behind[i] -= whole;
            m->measured[i] += m->filter_gain[i] * (whole * m->measure[i] - m->measured[i]);
        }
}

void sj_servo_periods(int32_t count, sj_drive *const *drives, const sj_servo_command *commands)
{
    int32_t of[SJ_MOTORS], n = 0;
    motors m;

    for (int32_t i = 0; i < count; i++) {
        sj_drive *drive = drives[i];
        if (count > 1 && fits(&drive->servo, &drive->constants, &commands[i]) &&
            drive->constants.steps == drives[0]->constants.steps) {
            put(&m, n, &drive->servo, &drive->constants, &commands[i]);
            of[n++] = i;
        } else {
            sj_servo_period(&drive->servo, &drive->constants, &commands[i]);
        }
    }
    if (n == 0)
        return;
    for (int32_t i = n; i < SJ_MOTORS; i++)
        put(&m, i, &drives[of[0]]->servo, &drives[of[0]]->constants, &commands[of[0]]);
    turn(&m, drives[0]->constants.steps);
    for (int32_t i = 0; i < n; i++)
        take(&m, i, &drives[of[i]]->servo);
}
