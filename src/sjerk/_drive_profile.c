/* Profile position and profile velocity (modes 1 and 3): the drive asks, the planner answers.
 *
 * _cia402.c knows what a set-point is and executes plans, _profile.c makes them; this room is the
 * only one that knows both. A set-point taken in a period is planned at its end, from the demand's
 * own velocity and acceleration, and begins with the next.
 * Never here: words, states, the shape of a plan.
 */
#include <stddef.h> /* required by the contract */
#include <stdint.h> /* the contract's integer types */
#include "_kernel.h"

void sj_drive_cycle_planned(sj_drive *drive, const sj_drive_rx *rx, sj_drive_tx *tx)
{
    const sj_drive_request *request = &drive->request;
    sj_plan plan;
    int32_t status = SJ_PLAN_OK;

    sj_drive_cycle(drive, rx, tx);
    switch (request->kind) {
    case SJ_REQUEST_MOVE:
        status = sj_plan_move(request->distance, request->velocity, request->acceleration, 0.0,
                              &request->limits, &plan);
        break;
    case SJ_REQUEST_VELOCITY:
        status = sj_plan_velocity(request->velocity, request->acceleration, request->goal,
                                  &request->limits, &plan);
        break;
    default:
        return;
    }
    sj_drive_answer(drive, status == SJ_PLAN_OK ? &plan : NULL);
}
