/* How many bytes of the structs travel: as many axes as the kernel has, not as many as there is room
 * for. Never here: contents. */
#include <stddef.h> /* offsetof */
#include <stdint.h>
#include "cycle/_payload.h"
#include "cycle/_trace_items.h"

_Static_assert(sizeof(sj_trace_head) == 24 && sizeof(sj_axis_trace) == 136, "no hidden padding");
_Static_assert(offsetof(sj_trace_frame, axis) == 104, "no hidden padding");
_Static_assert(sizeof(sj_command) <= sizeof(((sj_trace_message *)0)->payload) &&
                   sizeof(sj_record) <= sizeof(((sj_trace_message *)0)->payload),
               "room for each");

uint64_t sj_command_bytes(int32_t axes)
{
    return offsetof(sj_command, axis) + (uint64_t)axes * sizeof(sj_axis_command);
}

uint64_t sj_record_bytes(int32_t axes)
{
    return offsetof(sj_record, axis) + (uint64_t)axes * sizeof(sj_axis_record);
}

uint64_t sj_feedback_bytes(int32_t axes)
{
    return offsetof(sj_feedback, axis) + (uint64_t)axes * sizeof(sj_axis_feedback);
}

uint64_t sj_feedback_times(void) { return offsetof(sj_feedback, cycle); }

uint64_t sj_trace_frame_bytes(int32_t axes)
{
    return offsetof(sj_trace_frame, axis) + (uint64_t)axes * sizeof(sj_axis_trace);
}

uint64_t sj_trace_item_bytes(int32_t axes)
{
    uint64_t command = sj_command_bytes(axes), record = sj_record_bytes(axes);
    uint64_t message = sizeof(sj_trace_head) + (command > record ? command : record);
    uint64_t frame = sj_trace_frame_bytes(axes);
    return frame > message ? frame : message;
}
