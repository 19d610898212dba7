/* What a host commands. */
#pragma once
#include "cycle/_state.h"

/* The newest command, if there is one. */
void sj_command_take(sj_kernel *kernel);
