/* The states of an axis, PLCopen motion control part 1, as one table; states.py holds the same.
 *
 * Two things are ours: a halt is a motion like any other (the next goal replaces it), except while
 * homing; a stop is never refused.
 */
#include <stddef.h>
#include <stdint.h>
#include "cycle/_states.h"

enum {
    OFF = SJ_AXIS_DISABLED,
    STAND = SJ_AXIS_STANDSTILL,
    MOVE = SJ_AXIS_DISCRETE,
    CONT = SJ_AXIS_CONTINUOUS,
    SYNC = SJ_AXIS_SYNCHRONIZED,
    HOME = SJ_AXIS_HOMING,
    STOP = SJ_AXIS_STOPPING,
    ERR = SJ_AXIS_ERROR_STOP,
    NO = -1
};

int32_t sj_axis_next(int32_t state, int32_t trigger)
{
    static const int8_t next[SJ_AXIS_STATES][SJ_TRIGGERS] = {
        /*          on     off  fault reset  move  jog   sync  home  halt   quick done  */
        [OFF] = {STAND, OFF, ERR, OFF, NO, NO, NO, NO, OFF, OFF, OFF},
        [STAND] = {STAND, OFF, ERR, STAND, MOVE, CONT, SYNC, HOME, STAND, STOP, STAND},
        [MOVE] = {MOVE, OFF, ERR, MOVE, MOVE, CONT, SYNC, NO, MOVE, STOP, STAND},
        [CONT] = {CONT, OFF, ERR, CONT, MOVE, CONT, SYNC, NO, MOVE, STOP, STAND},
        [SYNC] = {SYNC, OFF, ERR, SYNC, MOVE, CONT, SYNC, NO, MOVE, STOP, STAND},
        [HOME] = {HOME, OFF, ERR, HOME, NO, NO, NO, NO, STOP, STOP, STAND},
        [STOP] = {STOP, OFF, ERR, STOP, NO, NO, NO, NO, STOP, STOP, STAND},
        [ERR] = {ERR, ERR, ERR, OFF, NO, NO, NO, NO, ERR, ERR, ERR},
    };
    if (state < 0 || state >= SJ_AXIS_STATES || trigger < 0 || trigger >= SJ_TRIGGERS)
        return NO;
    return next[state][trigger];
}
