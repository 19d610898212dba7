/* What the files of the drive share; private to this room, whose contract is _drive.h and _words.h. Prototypes stand from the ground up: each
 * file calls those above it here, and never one below. */
#pragma once
#include <stdint.h>
#include "drive/_drive.h"

#define SJ_TWO_PI      6.283185307179586476925286766559
#define SJ_RPM         (SJ_TWO_PI / 60.0) /* rad/s */
#define SJ_OVER_SPEED  1.2                /* of the maximum motor speed: trips */
#define SJ_SPEED_CLAMP 1.1                /* the velocity command is held within */
#define SJ_STANDSTILL  1e-3               /* of the maximum motor speed: stands */

enum { SJ_POLARITY_POSITION = 0x80, SJ_POLARITY_VELOCITY = 0x40, SJ_POLARITY_TORQUE = 0x20 };
enum { SJ_FAULT_RAMPS = 0, SJ_FAULT_COASTS = 1 };    /* whether the motor can be controlled */
enum { SJ_POSITION_GOAL = 1, SJ_VELOCITY_GOAL = 2 }; /* sj_drive_goal.kind */

/* How a homing method looks for its reference; directions are those of the motor. */
enum {
    SJ_HOMING_BY_NOTHING = 0, /* no motion, no new position */
    SJ_HOMING_BY_PLACE = 1,   /* where the axis is */
    SJ_HOMING_BY_SWITCH = 2,  /* an edge of a switch */
    SJ_HOMING_BY_INDEX = 3,   /* the next index pulse */
    SJ_HOMING_BY_STOP = 4     /* a hard stop */
};

typedef struct {
    int8_t number;    /* 6098h */
    uint8_t by;       /* SJ_HOMING_BY_... */
    int8_t begins;    /* direction of the search while the switch is open */
    int8_t direction; /* in which the reference is passed, or the index pulse is sought */
    uint8_t input;    /* SJ_INPUT_... */
    uint8_t rises;    /* the switch closes there */
    uint8_t turns;    /* once, at the limit switch in the direction in which it begins */
    uint8_t index;    /* home is the first index pulse behind the reference */
} sj_homing_method;

/* an edge that was passed */
typedef struct {
    int64_t place; /* the first increment behind it, counted upwards */
    int32_t rises; /* the input has closed */
} sj_signal_edge;

typedef struct {
    uint16_t code;          /* 603Fh and the first two bytes of an emergency */
    uint8_t error_register; /* 1001h */
    uint8_t reaction;       /* SJ_FAULT_RAMPS or SJ_FAULT_COASTS */
} sj_drive_fault_row;

/* _cia402.c */
const sj_drive_fault_row *sj_drive_fault(int32_t fault);

/* _homing_methods.c */
int sj_homing_method_of(int32_t number, sj_homing_method *method); /* 0: not offered */

/* _config.c: pu = increments * *units / *increments, reduced; 0 when a term exceeds 2^30 */
int32_t sj_drive_ratio(const sj_drive_config *config, int64_t *units, int64_t *increments);

/* _units.c */
int64_t sj_point_wrap(const sj_drive *drive, int64_t units);
int64_t sj_point_difference(const sj_drive *drive, int64_t to, int64_t from);
void sj_point_move_increments(const sj_drive *drive, sj_drive_point *point, int64_t distance);
int64_t sj_point_move_units(const sj_drive *drive, sj_drive_point *point, int64_t distance);
void sj_point_set(const sj_drive *drive, sj_drive_point *point, int64_t increments, int64_t units);
void sj_point_set_home(sj_drive *drive, int64_t increments); /* these become 607Ch */
int64_t sj_point_word(const sj_drive *drive, int64_t units); /* polarity, within 607Bh */
int64_t sj_point_demand(const sj_drive *drive);              /* 6062h */

/* _verdict.c */
void sj_verdict_pause(sj_drive_verdict *verdict);     /* the stream is interrupted */
void sj_verdict_judge(sj_drive *drive, int64_t step); /* one target followed, pu */

/* _servo.c */
void sj_servo_prepare(sj_servo_constants *constants, const sj_drive_config *config);
void sj_servo_period(sj_servo *servo, const sj_servo_constants *constants,
                     const sj_servo_command *command);

/* _servo_simd.c */
enum { SJ_SERVO_LANES = 8 }; /* motors at once */
/* One period of as many servos, SJ_SERVO_LANES at most. */
void sj_servo_periods(int32_t count, sj_drive *const *drives, const sj_servo_command *commands);

/* _signals.c */
void sj_signal_prepare(sj_drive_signal input[SJ_INPUTS], const sj_drive_config *config);
int sj_signal_closed(const sj_drive *drive, int32_t input);
/* The edges that a way from one increment to another has passed, in their order; returns how many. */
int32_t sj_signal_edges(const sj_drive *drive, int32_t input, int64_t from, int64_t to,
                        sj_signal_edge edge[2]);
/* The next index pulse above (1) or below (-1) a place. */
int64_t sj_signal_pulse(const sj_drive *drive, int64_t place, int32_t direction);

/* _probes.c */
/* After the motor's period, which began at `from` increments; `function` is 60B8h. */
void sj_probes_period(sj_drive *drive, uint16_t function, int64_t from);

/* _limits.c */
uint32_t sj_limit_inputs(const sj_drive *drive); /* 60FDh */
/* Switches that are closed, bit 0 negative, 1 positive. */
uint32_t sj_limit_switches(const sj_drive *drive);
/* The same with the ends of 607Dh that are reached. */
uint32_t sj_limit_ends(const sj_drive *drive);
int sj_limit_blocks(uint32_t ends, double direction);
/* A distance from a position, both as words, that keeps 607Dh. */
int64_t sj_limit_distance(const sj_drive *drive, int64_t from, int64_t distance);

/* _motion.c */
double sj_motion_speed(const sj_drive *drive);
void sj_motion_adopt_speed(sj_drive *drive);
void sj_motion_adopt_actual(sj_drive *drive);
void sj_motion_power_off(sj_drive *drive, sj_servo_command *command);
void sj_motion_ramp(sj_drive *drive, sj_servo_command *command, double advance, double velocity);
void sj_motion_ramp_to(sj_drive *drive, sj_servo_command *command, double goal,
                       double acceleration);
/* J times the acceleration that changes the demand's velocity. */
void sj_motion_feed_torque(const sj_drive *drive, sj_servo_command *command, double change);
double sj_motion_possible(const sj_drive *drive, double velocity);
void sj_motion_stop(sj_drive *drive, sj_servo_command *command, int32_t option);
/* A stop that ends at its own end, whatever comes meanwhile. */
void sj_motion_begin_stop(sj_drive *drive, sj_servo_command *command, int32_t option);
int sj_motion_stopping(sj_drive *drive,
                       sj_servo_command *command);   /* it goes on; 0: there is none */
int32_t sj_motion_limit_ramp(const sj_drive *drive); /* at a limit: that of 605Ah */
/* Modes 4, 9 and 10 where the axis may not go on: onto an end, still moving onto it, or standing there
 * without an order to leave it. Returns whether the axis is stopped, or held, in this period. */
int sj_motion_held_at_an_end(sj_drive *drive, sj_servo_command *command, double wanted,
                             double velocity);

/* _cyclic.c */
/* Returns a fault or SJ_FAULT_NONE. */
int32_t sj_cyclic_position(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command);
int32_t sj_cyclic_interpolated(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command);
void sj_cyclic_velocity(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command);
void sj_cyclic_torque(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command);

/* _homing.c */
void sj_homing_period(sj_drive *drive, sj_servo_command *command);
uint16_t sj_homing_bits(const sj_drive *drive); /* statusword bits 10, 12, 13 */

/* _profile.c */
void sj_profile_drop(sj_drive *drive);          /* the plan */
void sj_profile_give_up(sj_drive *drive);       /* the plan and its goals */
int sj_profile_planned(const sj_drive *drive);  /* a plan exists, or is asked for */
int64_t sj_profile_left(const sj_drive *drive); /* from the demand to the set-point */
void sj_profile_request(sj_drive *drive);
void sj_profile_execute(sj_drive *drive, sj_servo_command *command);
void sj_profile_answer(sj_drive *drive, const sj_plan *plan, int64_t turns);

/* _profile_position.c */
void sj_profile_offer(sj_drive *drive, const sj_drive_rx *rx); /* bits 4 and 12, in every period */
void sj_profile_position(sj_drive *drive, sj_servo_command *command);
int sj_profile_reached(const sj_drive *drive);

/* _profile_velocity.c */
void sj_profile_velocity(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command);
uint16_t sj_profile_velocity_bits(sj_drive *drive); /* statusword bits 10, 12 */

/* _profile_torque.c */
void sj_profile_torque(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command);
int sj_profile_torque_reached(const sj_drive *drive);

/* _supervision.c */
void sj_drive_raise(sj_drive *drive, int32_t fault);                 /* transition 13 */
int32_t sj_supervise_inputs(sj_drive *drive, const sj_drive_rx *rx); /* a fault or SJ_FAULT_NONE */
void sj_supervise_following(sj_drive *drive, const sj_servo_command *command);
void sj_supervise_standing(sj_drive *drive);

/* _report.c */
void sj_report_words(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx);

/* The master is not heard: 6007h decides. */
enum { SJ_LINK_CAUSES = 1 << SJ_FAULT_LOST_LINK | 1 << SJ_FAULT_RPDO_TIMEOUT };

static inline int has_cause(const sj_drive *drive, int32_t fault)
{
    return (drive->causes >> fault & 1u) != 0;
}

/* Increments per period from rad/s of the motor, and back. */
static inline double per_period(const sj_drive *drive)
{
    return drive->constants.increments_per_rad * drive->config.period_s;
}

static inline double increments_per_unit(const sj_drive *drive)
{
    return (double)drive->scale.increments / (double)drive->scale.units;
}

static inline double units_per_increment(const sj_drive *drive)
{
    return (double)drive->scale.units / (double)drive->scale.increments;
}

/* Into -most .. most. */
static inline double bounded(double value, double most)
{
    return value > most ? most : value < -most ? -most : value;
}

/* 605Ah: 5..8 are the ramps 1..4, and stay in QUICK STOP ACTIVE. */
static inline int32_t quick_stop_ramp(const sj_drive_config *config)
{
    return config->quick_stop_option > 4 ? config->quick_stop_option - 4
                                         : config->quick_stop_option;
}

/* Polarity between the words and the motor. */
static inline int64_t with_polarity(const sj_drive *drive, int64_t value, uint32_t bit)
{
    return drive->config.polarity & bit ? -value : value;
}

static inline int64_t add_wrapping(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a + (uint64_t)b);
}

static inline int64_t subtract_wrapping(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a - (uint64_t)b);
}

/* 60F4h in pu, between the axis and its demand as they are inside the drive. */
static inline int64_t following_error(const sj_drive *drive)
{
    return subtract_wrapping(drive->demand.point.travel, drive->actual.travel);
}
