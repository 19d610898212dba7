/* What is sent to the drives. */
#pragma once
#include "cycle/_state.h"

/* The process image of all drives, and the period of those that are simulated. */
void sj_actuate(sj_kernel *kernel);
