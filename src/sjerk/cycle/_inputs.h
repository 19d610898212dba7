/* What a cycle takes from outside, but for the drives' images and the end that the caller sets. */
#pragma once
#include <stdint.h>
#include "cycle/_state.h"
#include "dpram/_dpram.h"

/* As sj_shm_host_state; DEAD for one cycle too where the next host came before it was noticed. */
int32_t sj_inputs_host(sj_kernel *kernel, uint64_t now_ns);
/* The ring's counters, at the begin of a cycle. */
void sj_inputs_ring(sj_kernel *kernel);
/* As sj_command_collect, into kernel->incoming. */
int32_t sj_inputs_command(sj_kernel *kernel);
/* As sj_stop_take, of the slots from *slot on: 1 a stop, and *slot is behind it; 0 no more in this cycle. */
int32_t sj_inputs_stop(sj_kernel *kernel, uint32_t *slot, sj_stop *stop);
/* As sj_ring_take. */
int32_t sj_inputs_record(sj_kernel *kernel, sj_record *record);
