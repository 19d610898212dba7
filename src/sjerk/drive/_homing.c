/* Homing, mode 6: the search for the reference of a method (_homing_methods.c), with simulated
 * switches, index pulse and hard stops.
 *
 * A rising edge of controlword bit 4 starts, a falling one ends the search where it is. The position at
 * home becomes 607Ch, latched to the increment; the axis then stops where its ramp ends and does not
 * return. 6099h:1 is the speed until the switch changes for the first time, 6099h:2 from then on. A limit
 * switch in the way turns those methods back that know such a turn, and is an error for the others.
 * Never here: the other modes, states, what the methods are.
 */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

static int searching(const sj_drive *drive)
{
    return drive->homing.phase == SJ_HOMING_SEARCH || drive->homing.phase == SJ_HOMING_INDEX;
}

static void found(sj_drive *drive, int64_t home)
{
    sj_point_set_home(drive, home);
    drive->homing.homed = 1;
    drive->homing.phase = SJ_HOMING_STOPPING;
}

static void failed(sj_drive *drive)
{
    drive->homing.error = 1;
    drive->homing.phase = SJ_HOMING_STOPPING;
}

/* The direction in which the motor has turned in the period before; 0: it stood. */
static int32_t turning(const sj_drive *drive)
{
    return (drive->servo.encoder > drive->homing.from) -
           (drive->servo.encoder < drive->homing.from);
}

/* With what a hard stop is sought. */
static double stop_torque(const sj_drive *drive)
{
    return drive->config.hard_stop_torque * 1e-3 * drive->config.rated_torque_nm;
}

/* Whether a torque tells of a stop: one increment, which is a speed of
 * 1 / (increments_per_rad step_s) in one inner step, must not by itself be answered by half of it. */
static int feels_stops(const sj_drive *drive)
{
    const sj_servo_constants *c = &drive->constants;
    const double speed = c->filter_gain / (c->increments_per_rad * c->step_s);

    return c->velocity_gain * speed <= stop_torque(drive) / 2.0;
}

/* The edge that a method looks for exists, or a stop would be felt. */
static int has_reference(const sj_drive *drive, const sj_homing_method *method)
{
    const sj_drive_signal *signal = &drive->scale.input[method->input];
    const int64_t place = (method->direction > 0) == method->rises ? signal->closes : signal->opens;

    if (method->by == SJ_HOMING_BY_STOP) {
        return feels_stops(drive);
    }
    return method->by != SJ_HOMING_BY_SWITCH ||
           (signal->closes != signal->opens && place != INT64_MIN && place != INT64_MAX);
}

/* The search for the next index pulse in a direction begins behind a place. */
static void seek_pulse(sj_drive *drive, int64_t place, int32_t direction)
{
    drive->homing.direction = direction;
    drive->homing.pulse = sj_signal_pulse(drive, place, direction);
    drive->homing.phase = SJ_HOMING_INDEX;
}

/* The same from where the axis is: a pulse that lies there counts. */
static void seek_pulse_here(sj_drive *drive, int32_t direction)
{
    seek_pulse(drive, drive->servo.encoder + (direction < 0), direction);
}

static void start(sj_drive *drive, const sj_homing_method *method)
{
    sj_drive_homing *homing = &drive->homing;
    const int closed = sj_signal_closed(drive, method->input);

    *homing = (sj_drive_homing){
        .from = drive->servo.encoder,
        .furthest = drive->servo.encoder,
        .phase = SJ_HOMING_SEARCH,
        .direction = method->begins,
        .method = drive->config.homing_method,
    };
    if (method->by == SJ_HOMING_BY_INDEX) {
        seek_pulse_here(drive, method->direction);
    } else if (method->by == SJ_HOMING_BY_SWITCH && closed) {
        homing->direction = method->rises ? -method->direction : method->direction;
    }
}

/* Home is at a place, or at the first index pulse behind it. */
static void reached(sj_drive *drive, const sj_homing_method *method, int64_t place)
{
    if (method->index) {
        seek_pulse(drive, place, method->direction);
    } else {
        found(drive, place);
    }
}

/* The edges that were passed: the one that the method means, or one behind which it turns back. */
static void look_at_switch(sj_drive *drive, const sj_homing_method *method)
{
    sj_drive_homing *homing = &drive->homing;
    const int32_t direction = turning(drive);
    sj_signal_edge edge[2];
    const int32_t count =
        sj_signal_edges(drive, method->input, homing->from, drive->servo.encoder, edge);

    for (int32_t i = 0; i < count; i++) {
        const int as_meant = edge[i].rises == method->rises;
        homing->seen = 1;
        if (direction == method->direction && as_meant) {
            reached(drive, method, edge[i].place);
            return;
        }
        if (direction != method->direction && !as_meant) {
            homing->direction = method->direction;
        }
    }
}

/* A limit switch in the way, but for the one that is looked for. */
static void look_at_limits(sj_drive *drive, const sj_homing_method *method)
{
    sj_drive_homing *homing = &drive->homing;
    const int32_t ahead = homing->direction < 0 ? SJ_INPUT_NEGATIVE : SJ_INPUT_POSITIVE;
    const int looked_for = method->by == SJ_HOMING_BY_SWITCH && method->input == ahead &&
                           homing->phase == SJ_HOMING_SEARCH;

    if (homing->direction == 0 || looked_for || !sj_signal_closed(drive, ahead)) {
        return;
    }
    if (method->turns && !homing->turned && homing->phase == SJ_HOMING_SEARCH &&
        homing->direction == method->begins) {
        homing->turned = 1;
        homing->direction = -homing->direction;
        return;
    }
    failed(drive);
}

/* All the torque that is allowed gets the motor no further: it is at the hard stop. Between two pushes
 * the speed loop may pull back; with a coarse encoder it does so all the time. */
static void look_at_stop(sj_drive *drive, const sj_homing_method *method)
{
    sj_drive_homing *homing = &drive->homing;
    const int64_t at = drive->servo.encoder;
    const int pushes =
        drive->servo.torque_limited && drive->servo.command_nm * method->begins > 0.0;

    if (method->begins > 0 ? at > homing->furthest : at < homing->furthest) {
        homing->furthest = at;
        homing->blocked = 0;
    } else if (homing->blocked > 0 || pushes) {
        homing->blocked++;
    }
    if (homing->blocked * drive->config.period_s * 1e3 < drive->config.hard_stop_time_ms) {
        return;
    }
    drive->servo.integral_nm = 0.0; /* it pushes no longer */
    sj_motion_adopt_actual(drive);
    if (method->index) { /* a pulse that lies there counts */
        seek_pulse(drive, homing->furthest + (method->direction < 0), method->direction);
    } else {
        found(drive, homing->furthest);
    }
}

/* What the period before has found. */
static void search(sj_drive *drive, const sj_homing_method *method)
{
    if (!has_reference(drive, method)) {
        failed(drive);
        return;
    }
    switch (method->by) {
    case SJ_HOMING_BY_NOTHING:
        drive->homing.homed = 1;
        drive->homing.phase = SJ_HOMING_STOPPING;
        return;
    case SJ_HOMING_BY_PLACE: found(drive, drive->servo.encoder); return;
    default: break;
    }
    if (drive->homing.phase == SJ_HOMING_SEARCH && method->by == SJ_HOMING_BY_SWITCH) {
        look_at_switch(drive, method);
    } else if (drive->homing.phase == SJ_HOMING_SEARCH) {
        look_at_stop(drive, method);
    }
    if (drive->homing.phase == SJ_HOMING_INDEX) {
        if (turning(drive) == -drive->homing.direction) {
            seek_pulse_here(drive, drive->homing.direction); /* not yet on its way */
        } else if (drive->homing.direction > 0 ? drive->servo.encoder >= drive->homing.pulse
                                               : drive->servo.encoder < drive->homing.pulse) {
            found(drive, drive->homing.pulse);
        }
    }
    if (searching(drive)) {
        look_at_limits(drive, method);
    }
}

/* The velocity that the search wants, in increments per period. */
static double wanted(const sj_drive *drive)
{
    const sj_drive_config *config = &drive->config;
    const int slow = drive->homing.phase == SJ_HOMING_INDEX || drive->homing.seen;
    const double speed = (slow ? config->homing_speed_zero : config->homing_speed_switch) *
                         increments_per_unit(drive) * config->period_s;

    return drive->homing.direction * bounded(speed, drive->scale.speed_limit);
}

/* Toward a hard stop: by velocity, with no more than the torque that tells it. The demand is where the
 * axis is, so that nothing winds up. */
static void push(sj_drive *drive, sj_servo_command *command, double goal, double ramp)
{
    const double most = stop_torque(drive);
    const double speed = 1.0 / per_period(drive);
    const double before = drive->demand.velocity;

    command->torque_max_nm = command->torque_max_nm < most ? command->torque_max_nm : most;
    command->torque_min_nm = command->torque_min_nm > -most ? command->torque_min_nm : -most;
    drive->demand.velocity = before + bounded(goal - before, ramp);
    drive->demand.point = drive->actual;
    drive->demand.fraction = 0.0;
    command->control = SJ_SERVO_VELOCITY;
    command->velocity_start_rad_s = before * speed;
    command->velocity_end_rad_s = drive->demand.velocity * speed;
    sj_motion_feed_torque(drive, command, drive->demand.velocity - before);
}

void sj_homing_period(sj_drive *drive, sj_servo_command *command)
{
    const double period = drive->config.period_s;
    const double most =
        drive->config.homing_acceleration * increments_per_unit(drive) * period * period;
    const double ramp = most > 1e-9 ? most : 1e-9;
    const int begins = (drive->controlword & ~drive->controlword_before & SJ_CW_MODE_4) != 0;
    sj_drive_homing *homing = &drive->homing;
    sj_homing_method method = {0};
    double velocity = 0.0;

    (void)sj_homing_method_of(begins ? drive->config.homing_method : homing->method, &method);
    command->velocity_offset_rad_s = 0.0;
    if (begins) {
        start(drive, &method); /* shown for a period before anything is found */
    } else if (!(drive->controlword & SJ_CW_MODE_4)) {
        if (searching(drive)) {
            homing->phase = SJ_HOMING_STOPPING;
        }
    } else if (searching(drive)) {
        search(drive, &method);
        if (searching(drive)) {
            velocity = wanted(drive);
        }
    }
    homing->from = drive->servo.encoder;
    if (homing->phase == SJ_HOMING_SEARCH && method.by == SJ_HOMING_BY_STOP) {
        push(drive, command, velocity, ramp);
        return;
    }
    sj_motion_ramp_to(drive, command, velocity, ramp);
    if (homing->phase == SJ_HOMING_STOPPING && velocity == 0.0 && drive->demand.velocity == 0.0) {
        homing->phase = SJ_HOMING_IDLE;
    }
}

uint16_t sj_homing_bits(const sj_drive *drive)
{
    const int standing = drive->homing.phase == SJ_HOMING_IDLE && drive->standing;

    return (uint16_t)((!searching(drive) && standing ? SJ_SW_TARGET_REACHED : 0) |
                      (drive->homing.homed ? SJ_SW_FOLLOWS : 0) |
                      (drive->homing.error ? SJ_SW_FOLLOWING_ERROR : 0));
}
