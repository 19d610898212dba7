/* The verdict on the stream of target positions: what a real servo would have to endure.
 *
 * Targets are integers, so each is up to half a unit off, and an n-th difference up to 2^(n-1)
 * units: that bound is subtracted before anything is judged or kept as a maximum. A sample gets
 * one finding, the one that says most; after it the history begins anew, so that one bad sample is
 * one finding and not three. With x[k] the target in units, T the period:
 *     step = x[k] - x[k-1],  change = step[k] - step[k-1],  bend = change[k] - change[k-1]
 *     velocity = (|step| - 1) / T,  acceleration = (|change| - 2) / T^2,  jerk = (|bend| - 4) / T^3
 * Never here: a reaction. The drive judges, the state machine acts.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

static const double PERIOD_TOLERANCE = 0.25; /* of 60C2h: masters of no real time are late */

static double magnitude(double value) { return value < 0.0 ? -value : value; }

/* |difference| without what rounding of the targets can have added. */
static double certain(double difference, double bound)
{
    const double rest = magnitude(difference) - bound;
    return rest > 0.0 ? rest : 0.0;
}

static void keep_max(double *largest, double value)
{
    if (value > *largest) {
        *largest = value;
    }
}

void sj_verdict_clear(sj_drive_verdict *verdict)
{
    *verdict = (sj_drive_verdict){.last_finding = -1};
}

void sj_verdict_pause(sj_drive_verdict *verdict) { verdict->history = 0; }

static void note(sj_drive *drive, int32_t finding)
{
    sj_drive_verdict *verdict = &drive->verdict;

    if (verdict->counts[finding] == 0) {
        verdict->first[finding] = drive->cycles;
    }
    if (verdict->counts[finding] < UINT32_MAX) {
        verdict->counts[finding]++;
    }
    verdict->last_finding = finding;
}

void sj_verdict_period(sj_drive *drive, double seen_s)
{
    const double off = magnitude(seen_s - drive->config.period_s);

    if (off > PERIOD_TOLERANCE * drive->config.period_s) {
        note(drive, SJ_FINDING_PERIOD);
        drive->warning = 1;
    }
}

void sj_verdict_judge(sj_drive *drive, int64_t raw_step)
{
    sj_drive_verdict *verdict = &drive->verdict;
    const sj_drive_config *config = &drive->config;
    const double period = config->period_s;
    /* revolutions of the motor per pu */
    const double revolution =
        increments_per_unit(drive) * config->encoder_revolutions / config->encoder_increments;
    const double to_velocity = revolution / period;
    const double to_acceleration = to_velocity / period;
    const double to_jerk = to_acceleration / period;
    const double step = (double)raw_step;
    const double change = step - verdict->last_step;
    const double bend = change - verdict->last_change;
    const double velocity = certain(step, 1.0) * to_velocity;
    const double acceleration = certain(change, 2.0) * to_acceleration;
    const double jerk = certain(bend, 4.0) * to_jerk;
    double acceleration_max =
        drive->constants.inertia_inverse * config->peak_torque_nm * (1.0 / SJ_TWO_PI);
    const int braking = change * verdict->last_step < 0.0;
    const uint32_t object = braking ? config->max_deceleration : config->max_acceleration;
    const double object_max = (double)object * revolution;

    if (config->stream_acceleration_rev_s2 > 0.0) {
        acceleration_max = config->stream_acceleration_rev_s2;
    }
    if (object != UINT32_MAX && object_max < acceleration_max) {
        acceleration_max = object_max;
    }
    verdict->samples++;
    verdict->last_finding = -1;
    keep_max(&verdict->velocity_max_rev_s, velocity);
    if (verdict->history >= 1) {
        keep_max(&verdict->acceleration_max_rev_s2, acceleration);
    }
    if (verdict->history >= 2) {
        keep_max(&verdict->jerk_max_rev_s3, jerk);
    }

    if (verdict->history >= 1 && acceleration > acceleration_max) {
        if (raw_step == 0) {
            /* the next is held against the velocity the stream should have kept */
            note(drive, SJ_FINDING_STALE);
            return;
        }
        /* Half of the distance, taken twice, would have been within the limits: the middle of the two
         * periods lies one and a half periods after the middle of the one before. */
        if (certain(0.5 * step - verdict->last_step, 2.0) * to_acceleration <=
            1.5 * acceleration_max) {
            note(drive, SJ_FINDING_SKIPPED);
            verdict->history = 0;
            return;
        }
    }
    if (raw_step > drive->scale.jump_limit || raw_step < -drive->scale.jump_limit) {
        note(drive, SJ_FINDING_JUMP);
        verdict->history = 0;
        return;
    }
    if (verdict->history >= 1 && acceleration > acceleration_max) {
        if (acceleration > 2.0 * acceleration_max) {
            note(drive, SJ_FINDING_STEP);
            verdict->last_step = step;
            verdict->history = 1;
            return;
        }
        note(drive, SJ_FINDING_ACCELERATION);
    } else if (magnitude(step) - 1.0 > (double)drive->scale.jump_limit / config->jump_factor) {
        note(drive, SJ_FINDING_VELOCITY);
    } else if (verdict->history >= 2 && config->stream_jerk_rev_s3 > 0.0 &&
               jerk > config->stream_jerk_rev_s3) {
        note(drive, SJ_FINDING_JERK);
    }
    verdict->last_change = change;
    verdict->last_step = step;
    if (verdict->history < 2) {
        verdict->history++;
    }
}
