/* EtherCAT frames on a network interface: a line of emulated devices, or the cycle of a main device. */
#pragma once
#include <stdint.h>
#include "cycle/_exchange.h"
#include "ports/ethercat/_esc.h"
#include "ports/ethercat/_frame.h"

/* A raw socket for EtherCAT frames on an interface, or -errno. */
int32_t sj_wire_open(const char *interface_name);
/* The same, of frames whose first datagram has an index from `first` to `last`. */
int32_t sj_wire_open_for(const char *interface_name, int32_t first, int32_t last);
void sj_wire_close(int32_t socket);
int64_t sj_wire_now(void); /* CLOCK_MONOTONIC, ns */
/* Serve a line until a device has events (its number), until line->wake or `until` (-1), or until the
 * socket fails (-1 - errno). */
int32_t sj_wire_serve(sj_line *line, int32_t socket, int64_t until);

/* A main device's bus on a socket. */
typedef struct {
    sj_bus *bus;
    int32_t socket;
    int32_t failed; /* errno of the last send that did not go out; 0 */
    uint8_t *ring;  /* frames that came, as the system puts them there; NULL: they are asked for */
    uint32_t next;  /* of the ring, that is looked at next */
} sj_wire_bus;

/* Let the system put what comes into memory, so that a cycle need not ask for it. Returns 0 or -errno; then
 * it asks. */
int32_t sj_wire_map(sj_wire_bus *wire);
void sj_wire_unmap(sj_wire_bus *wire);

/* The exchange of a clocked kernel over that socket. */
void sj_wire_exchange(sj_wire_bus *wire, sj_exchange *exchange);
