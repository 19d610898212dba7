/* Profile torque, mode 4: the torque goes to 6071h along the slope 6087h, from the torque at hand.
 *
 * At the speed limit (6080h, 607Fh) the motor is not driven further; at a closed limit switch, or an end of
 * 607Dh, the axis stops and is held, and a torque away from it is free. 60B2h is of the cyclic modes.
 * Never here: ramps of speed, the motor's equations.
 */
#include <math.h>            /* fabs */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

static const double REACHED = 0.01; /* of the rated torque */

void sj_profile_torque(sj_drive *drive, const sj_drive_rx *rx, sj_servo_command *command)
{
    const double unit = 1e-3 * drive->config.rated_torque_nm;
    const double slope = drive->config.torque_slope * unit * drive->config.period_s;
    const double goal = (double)with_polarity(drive, rx->target_torque, SJ_POLARITY_TORQUE) * unit;
    const double torque = drive->demand.torque_nm;

    drive->goal.torque_nm = goal;
    drive->follows = 0;
    if (sj_motion_held_at_an_end(drive, command, goal, sj_motion_speed(drive))) {
        drive->follows = 0;
        drive->demand.torque_nm =
            drive->servo.command_nm; /* that holds it: from there it goes on */
        return;
    }
    sj_motion_adopt_speed(drive);
    drive->demand.torque_nm = torque + bounded(goal - torque, slope);
    drive->follows = 1;
    command->control = SJ_SERVO_TORQUE;
    command->speed_max_rad_s = drive->scale.speed_limit / per_period(drive);
    command->torque_nm = drive->demand.torque_nm;
}

/* The slope has ended, no limit cuts the torque, and it is there. */
int sj_profile_torque_reached(const sj_drive *drive)
{
    const double off = fabs(drive->servo.torque_nm - drive->goal.torque_nm);

    return drive->follows && drive->demand.torque_nm == drive->goal.torque_nm &&
           !drive->servo.torque_limited && !drive->servo.speed_limited &&
           off <= REACHED * drive->config.rated_torque_nm;
}
