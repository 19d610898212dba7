/* The homing methods of 6098h as a table (IEC 61800-7-201): where each one's reference is.
 *
 * A reference is an edge of a switch, and which edge is said by how it is passed: in which direction,
 * and whether the switch closes or opens then. The same words say how to come there: an axis that
 * moves against that direction turns back as soon as the switch is as it is before the edge. Methods 17
 * to 30 are 1 to 14 without the index pulse; -1 to -4 are a maker's, numbered as those of maxon.
 * Never here: motions.
 */
#include <stddef.h>          /* size_t */
#include <stdint.h>          /* fixed widths */
#include "drive/_internal.h" /* what the files of the drive share */

static const sj_homing_method METHODS[] = {
    /* number, by, begins, direction, input, rises, turns, index */
    {0, SJ_HOMING_BY_NOTHING, 0, 0, 0, 0, 0, 0},
    {1, SJ_HOMING_BY_SWITCH, -1, 1, SJ_INPUT_NEGATIVE, 0, 0, 1},
    {2, SJ_HOMING_BY_SWITCH, 1, -1, SJ_INPUT_POSITIVE, 0, 0, 1},
    /* a home switch that is closed to the positive end */
    {3, SJ_HOMING_BY_SWITCH, 1, -1, SJ_INPUT_HOME, 0, 0, 1},
    {4, SJ_HOMING_BY_SWITCH, 1, 1, SJ_INPUT_HOME, 1, 0, 1},
    /* a home switch that is closed to the negative end */
    {5, SJ_HOMING_BY_SWITCH, -1, 1, SJ_INPUT_HOME, 0, 0, 1},
    {6, SJ_HOMING_BY_SWITCH, -1, -1, SJ_INPUT_HOME, 1, 0, 1},
    /* one that is closed over a part of the way; a limit switch turns the search back */
    {7, SJ_HOMING_BY_SWITCH, 1, -1, SJ_INPUT_HOME, 0, 1, 1},
    {8, SJ_HOMING_BY_SWITCH, 1, 1, SJ_INPUT_HOME, 1, 1, 1},
    {9, SJ_HOMING_BY_SWITCH, 1, -1, SJ_INPUT_HOME, 1, 1, 1},
    {10, SJ_HOMING_BY_SWITCH, 1, 1, SJ_INPUT_HOME, 0, 1, 1},
    {11, SJ_HOMING_BY_SWITCH, -1, 1, SJ_INPUT_HOME, 0, 1, 1},
    {12, SJ_HOMING_BY_SWITCH, -1, -1, SJ_INPUT_HOME, 1, 1, 1},
    {13, SJ_HOMING_BY_SWITCH, -1, 1, SJ_INPUT_HOME, 1, 1, 1},
    {14, SJ_HOMING_BY_SWITCH, -1, -1, SJ_INPUT_HOME, 0, 1, 1},
    /* without a switch */
    {33, SJ_HOMING_BY_INDEX, -1, -1, 0, 0, 0, 1},
    {34, SJ_HOMING_BY_INDEX, 1, 1, 0, 0, 0, 1},
    {35, SJ_HOMING_BY_PLACE, 0, 0, 0, 0, 0, 0},
    {37, SJ_HOMING_BY_PLACE, 0, 0, 0, 0, 0, 0},
    {-1, SJ_HOMING_BY_STOP, 1, -1, 0, 0, 0, 1},
    {-2, SJ_HOMING_BY_STOP, -1, 1, 0, 0, 0, 1},
    {-3, SJ_HOMING_BY_STOP, 1, -1, 0, 0, 0, 0},
    {-4, SJ_HOMING_BY_STOP, -1, 1, 0, 0, 0, 0},
};

int sj_homing_method_of(int32_t number, sj_homing_method *method)
{
    const int no_index = number >= 17 && number <= 30;

    for (size_t i = 0; i < sizeof METHODS / sizeof METHODS[0]; i++) {
        if (METHODS[i].number == (no_index ? number - 16 : number)) {
            *method = METHODS[i];
            method->index = no_index ? 0 : method->index;
            return 1;
        }
    }
    return 0;
}
