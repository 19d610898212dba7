/* A line of emulated devices on a network interface. */
#pragma once
#include <stdint.h>
#include "ports/ethercat/_esc.h"

/* A raw socket for EtherCAT frames on an interface, or -errno. */
int32_t sj_wire_open(const char *interface_name);
void sj_wire_close(int32_t socket);
int64_t sj_wire_now(void); /* CLOCK_MONOTONIC, ns */
/* Serve a line until a device has events (its number), until line->wake or `until` (-1), or until the
 * socket fails (-1 - errno). */
int32_t sj_wire_serve(sj_line *line, int32_t socket, int64_t until);
