/* The wiring room. */
#include <stdint.h>
#include <stddef.h>
#include "_kernel.h"

int32_t sj_max_axes(void)
{
    return SJ_AXES;
}
