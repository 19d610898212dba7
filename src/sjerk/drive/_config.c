/* The config of a drive: the range of every field, and what must fit together.
 *
 * The table is the only place that knows the ranges; Python asks it. Its order is the order of the
 * struct. Never here: what a field does.
 */
#include <stdint.h>          /* fixed widths */
#include <stddef.h>          /* offsetof */
#include "drive/_internal.h" /* what the files of the drive share */

typedef enum { REAL, UNSIGNED, SIGNED } kind;

typedef struct {
    const char *name;
    size_t offset;
    kind type;
    double low;
    double high;
} field;

#define FIELD(name, type, low, high) {#name, offsetof(sj_drive_config, name), type, low, high}
#define U32_MAX                      4294967295.0
#define I32_MIN                      (-2147483648.0)
#define I32_MAX                      2147483647.0

static const field FIELDS[] = {
    FIELD(period_s, REAL, 25e-6, 0.1),
    FIELD(inner_rate_hz, REAL, 10.0, 200e3),
    FIELD(position_gain_per_s, REAL, 0.1, 1000.0),
    FIELD(velocity_bandwidth_hz, REAL, 0.1, 1000.0),
    FIELD(velocity_integral_s, REAL, 1e-4, 100.0),
    FIELD(velocity_feedforward, REAL, 0.0, 1.0),
    FIELD(acceleration_feedforward, REAL, 0.0, 1.0),
    FIELD(torque_time_s, REAL, 1e-6, 0.1),
    FIELD(velocity_filter_s, REAL, 1e-6, 0.1),
    FIELD(rated_torque_nm, REAL, 1e-4, 1e5),
    FIELD(peak_torque_nm, REAL, 1e-4, 1e6),
    FIELD(rated_current_a, REAL, 1e-3, 1e4),
    FIELD(max_speed_rpm, REAL, 1.0, 1e5),
    FIELD(inertia_kg_m2, REAL, 1e-9, 1e3),
    FIELD(load_inertia_ratio, REAL, 0.0, 1000.0),
    FIELD(friction_nm, REAL, 0.0, 1e5),
    FIELD(friction_speed_rad_s, REAL, 1e-3, 100.0),
    FIELD(viscous_nm_s, REAL, 0.0, 1e3),
    FIELD(load_torque_nm, REAL, -1e6, 1e6),
    FIELD(brake_torque_nm, REAL, 0.0, 1e6),
    FIELD(stop_timeout_s, REAL, 0.0, 60.0),
    FIELD(jump_factor, REAL, 1e-6, 1e6),
    FIELD(stream_acceleration_rev_s2, REAL, 0.0, 1e9),
    FIELD(stream_jerk_rev_s3, REAL, 0.0, 1e15),
    FIELD(profile_jerk_rev_s3, REAL, 1e-3, 1e9),
    FIELD(switch_negative_rev, REAL, -1e9, 1e9),
    FIELD(switch_positive_rev, REAL, -1e9, 1e9),
    FIELD(switch_home_rev, REAL, -1e9, 1e9),
    FIELD(switch_home_end_rev, REAL, -1e9, 1e9),
    FIELD(probe_1_rev, REAL, -1e9, 1e9),
    FIELD(probe_1_end_rev, REAL, -1e9, 1e9),
    FIELD(probe_2_rev, REAL, -1e9, 1e9),
    FIELD(probe_2_end_rev, REAL, -1e9, 1e9),
    FIELD(hard_stop_negative_rev, REAL, -1e9, 1e9),
    FIELD(hard_stop_positive_rev, REAL, -1e9, 1e9),
    FIELD(encoder_increments, UNSIGNED, 1.0, 1073741824.0),
    FIELD(encoder_revolutions, UNSIGNED, 1.0, 65535.0),
    FIELD(gear_motor, UNSIGNED, 1.0, U32_MAX),
    FIELD(gear_shaft, UNSIGNED, 1.0, U32_MAX),
    FIELD(feed, UNSIGNED, 1.0, U32_MAX),
    FIELD(feed_shaft, UNSIGNED, 1.0, U32_MAX),
    FIELD(range_min, SIGNED, I32_MIN, I32_MAX),
    FIELD(range_max, SIGNED, I32_MIN, I32_MAX),
    FIELD(software_min, SIGNED, I32_MIN, I32_MAX),
    FIELD(software_max, SIGNED, I32_MIN, I32_MAX),
    FIELD(polarity, UNSIGNED, 0.0, 224.0),
    FIELD(following_window, UNSIGNED, 0.0, U32_MAX),
    FIELD(following_time_ms, UNSIGNED, 0.0, 65535.0),
    FIELD(position_window, UNSIGNED, 0.0, U32_MAX),
    FIELD(position_time_ms, UNSIGNED, 0.0, 65535.0),
    FIELD(velocity_window, UNSIGNED, 0.0, 65535.0),
    FIELD(velocity_time_ms, UNSIGNED, 0.0, 65535.0),
    FIELD(velocity_threshold, UNSIGNED, 0.0, 65535.0),
    FIELD(threshold_time_ms, UNSIGNED, 0.0, 65535.0),
    FIELD(max_profile_velocity, UNSIGNED, 1.0, U32_MAX),
    FIELD(profile_velocity, UNSIGNED, 1.0, U32_MAX),
    FIELD(profile_acceleration, UNSIGNED, 1.0, U32_MAX),
    FIELD(profile_deceleration, UNSIGNED, 1.0, U32_MAX),
    FIELD(quick_stop_deceleration, UNSIGNED, 1.0, U32_MAX),
    FIELD(max_acceleration, UNSIGNED, 1.0, U32_MAX),
    FIELD(max_deceleration, UNSIGNED, 1.0, U32_MAX),
    FIELD(max_torque, UNSIGNED, 0.0, 65535.0),
    FIELD(torque_slope, UNSIGNED, 1.0, U32_MAX),
    FIELD(torque_limit_positive, UNSIGNED, 0.0, 65535.0),
    FIELD(torque_limit_negative, UNSIGNED, 0.0, 65535.0),
    FIELD(quick_stop_option, SIGNED, 0.0, 8.0),
    FIELD(shutdown_option, SIGNED, 0.0, 1.0),
    FIELD(disable_option, SIGNED, 0.0, 1.0),
    FIELD(halt_option, SIGNED, 1.0, 4.0),
    FIELD(fault_option, SIGNED, 0.0, 4.0),
    FIELD(abort_option, SIGNED, 0.0, 3.0),
    FIELD(jump_option, SIGNED, 0.0, 2.0),
    FIELD(positioning_option, SIGNED, 0.0, 194.0),
    FIELD(sync_extrapolation, UNSIGNED, 0.0, 65535.0),
    FIELD(sync_error_limit, UNSIGNED, 1.0, 65535.0),
    FIELD(software_from_home, UNSIGNED, 0.0, 1.0),
    FIELD(home_offset, SIGNED, I32_MIN, I32_MAX),
    FIELD(homing_method, SIGNED, -4.0, 37.0),
    FIELD(homing_speed_switch, UNSIGNED, 1.0, U32_MAX),
    FIELD(homing_speed_zero, UNSIGNED, 1.0, U32_MAX),
    FIELD(homing_acceleration, UNSIGNED, 1.0, U32_MAX),
    FIELD(hard_stop_torque, UNSIGNED, 1.0, 65535.0),
    FIELD(hard_stop_time_ms, UNSIGNED, 1.0, 65535.0),
};

enum { FIELD_COUNT = sizeof FIELDS / sizeof FIELDS[0] };

/* The number of a field by its offset, as sj_drive_config_check reports it. */
static int32_t number_of(size_t offset)
{
    for (int32_t i = 0; i < FIELD_COUNT; i++) {
        if (FIELDS[i].offset == offset) {
            return i + 1;
        }
    }
    return 0;
}

const char *sj_drive_config_field(int32_t number, double *low, double *high)
{
    if (number < 1 || number > FIELD_COUNT) {
        return NULL;
    }
    *low = FIELDS[number - 1].low;
    *high = FIELDS[number - 1].high;
    return FIELDS[number - 1].name;
}

static double value_of(const sj_drive_config *config, const field *entry)
{
    const char *place = (const char *)config + entry->offset;

    switch (entry->type) {
    case UNSIGNED: return *(const uint32_t *)(const void *)place;
    case SIGNED: return *(const int32_t *)(const void *)place;
    default: return *(const double *)(const void *)place;
    }
}

static uint64_t gcd(uint64_t a, uint64_t b)
{
    while (b != 0) {
        const uint64_t rest = a % b;
        a = b;
        b = rest;
    }
    return a;
}

/* One fraction times another, reduced before it can grow. */
static int times(uint64_t ratio[2], uint64_t numerator, uint64_t denominator)
{
    const uint64_t first = gcd(ratio[0], denominator);
    const uint64_t second = gcd(numerator, ratio[1]);
    const uint64_t a = ratio[0] / first;
    const uint64_t b = numerator / second;
    const uint64_t c = ratio[1] / second;
    const uint64_t d = denominator / first;
    const uint64_t common = gcd(b, d);

    if (b / common > UINT64_MAX / a || d / common > UINT64_MAX / c) {
        return 0;
    }
    ratio[0] = a * (b / common);
    ratio[1] = c * (d / common);
    return 1;
}

int32_t sj_drive_ratio(const sj_drive_config *config, int64_t *units, int64_t *increments)
{
    uint64_t ratio[2] = {config->feed, config->feed_shaft};
    const uint64_t limit = (uint64_t)1 << 30;

    if (!times(ratio, config->gear_shaft, config->gear_motor) ||
        !times(ratio, config->encoder_revolutions, config->encoder_increments) ||
        ratio[0] > limit || ratio[1] > limit) {
        return 0;
    }
    *units = (int64_t)ratio[0];
    *increments = (int64_t)ratio[1];
    return 1;
}

int32_t sj_drive_config_check(const sj_drive_config *config)
{
    int64_t units = 0;
    int64_t increments = 0;
    double inertia = 0.0;
    double damping = 0.0;
    sj_homing_method method;

    for (int32_t i = 0; i < FIELD_COUNT; i++) {
        const double value = value_of(config, &FIELDS[i]);
        if (!(value >= FIELDS[i].low && value <= FIELDS[i].high)) { /* nan fails too */
            return i + 1;
        }
    }
    if (!sj_drive_ratio(config, &units, &increments)) {
        return number_of(offsetof(sj_drive_config, feed));
    }
    /* the motor at four times its speed stays far from the ends of 64 bits in every product */
    if (4.0 * config->max_speed_rpm / 60.0 * config->encoder_increments /
            config->encoder_revolutions * config->period_s >
        1073741824.0) {
        return number_of(offsetof(sj_drive_config, max_speed_rpm));
    }
    /* explicit Euler: friction may take at most all of the speed in one inner step */
    inertia = config->inertia_kg_m2 * (1.0 + config->load_inertia_ratio);
    damping = config->friction_nm / config->friction_speed_rad_s + config->viscous_nm_s;
    if (damping > inertia * config->inner_rate_hz) {
        return number_of(offsetof(sj_drive_config, friction_nm));
    }
    if ((config->positioning_option & ~(SJ_RELATIVE_BITS | SJ_ROTARY_BITS)) != 0 ||
        (config->positioning_option & SJ_RELATIVE_BITS) > SJ_RELATIVE_ACTUAL) {
        return number_of(offsetof(sj_drive_config, positioning_option));
    }
    if (config->switch_negative_rev >= config->switch_positive_rev) {
        return number_of(offsetof(sj_drive_config, switch_positive_rev));
    }
    if (config->hard_stop_negative_rev >= config->hard_stop_positive_rev) {
        return number_of(offsetof(sj_drive_config, hard_stop_positive_rev));
    }
    if (!sj_homing_method_of(config->homing_method, &method)) {
        return number_of(offsetof(sj_drive_config, homing_method));
    }
    return 0;
}
