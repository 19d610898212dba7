/* EtherCAT frames on a network interface: the only file that knows sockets. A line of emulated devices
 * answers there, or the cycle of a main device asks.
 *
 * A frame counts at the time the system received it (SO_TIMESTAMPNS), whatever the emulator did then;
 * what was due before is done before.
 *
 * Never here: what a frame means.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <net/if.h> /* if_nametoindex */
#include <poll.h>   /* ppoll */
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h> /* the ring of what came */
#include <sys/socket.h>
#include <linux/filter.h>    /* frames by their index */
#include <linux/if_packet.h> /* sockaddr_ll */
#include <time.h>
#include <unistd.h> /* close */
#include "ports/ethercat/_wire.h"

enum { ETHERTYPE = 0x88A4, SECOND = 1000000000, CONTROL = 256, ROOM = 2048 };

static int64_t of(const struct timespec *t) { return (int64_t)t->tv_sec * SECOND + t->tv_nsec; }

static int64_t read_clock(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return of(&t);
}

int64_t sj_wire_now(void) { return read_clock(CLOCK_MONOTONIC); }

int32_t sj_wire_open(const char *interface_name)
{
    struct sockaddr_ll address = {.sll_family = AF_PACKET,
                                  .sll_protocol =
                                      (uint16_t)(ETHERTYPE >> 8 | (ETHERTYPE & 255) << 8)};
    const int one = 1;
    const unsigned index = if_nametoindex(interface_name);
    if (index == 0)
        return -errno;
    address.sll_ifindex = (int)index;
    const int fd = socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, address.sll_protocol);
    if (fd < 0)
        return -errno;
    if (setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &one, sizeof one) < 0 ||
        setsockopt(fd, SOL_PACKET, PACKET_IGNORE_OUTGOING, &one, sizeof one) < 0 ||
        bind(fd, (struct sockaddr *)&address, sizeof address) < 0) {
        const int error = errno;
        close(fd);
        return -error;
    }
    return fd;
}

int32_t sj_wire_open_for(const char *interface_name, int32_t first, int32_t last)
{
    /* the index is byte 17; what else comes is not woken up for */
    struct sock_filter code[] = {
        BPF_STMT(BPF_LD | BPF_B | BPF_ABS, 17),
        BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, (uint32_t)first, 0, 2),
        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, (uint32_t)last, 1, 0),
        BPF_STMT(BPF_RET | BPF_K, ROOM),
        BPF_STMT(BPF_RET | BPF_K, 0),
    };
    const struct sock_fprog program = {sizeof code / sizeof code[0], code};
    const int one = 1;
    const int32_t fd = sj_wire_open(interface_name);
    if (fd < 0)
        return fd;
    if (setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) < 0) {
        const int error = errno;
        close(fd);
        return -error;
    }
    setsockopt(fd, SOL_PACKET, PACKET_QDISC_BYPASS, &one, sizeof one); /* sooner; not all can */
    return fd;
}

void sj_wire_close(int32_t socket) { close(socket); }

/* When the message came, as CLOCK_MONOTONIC; `now` without a time stamp. */
static int64_t arrival(struct msghdr *message, int64_t now)
{
    for (struct cmsghdr *c = CMSG_FIRSTHDR(message); c; c = CMSG_NXTHDR(message, c))
        if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SO_TIMESTAMPNS) {
            struct timespec stamp;
            memcpy(&stamp, CMSG_DATA(c), sizeof stamp);
            const int64_t age = read_clock(CLOCK_REALTIME) - of(&stamp);
            return age > 0 && age < SECOND ? now - age : now; /* the wall clock may have been set */
        }
    return now;
}

static void sleep_until(int64_t end)
{
    const struct timespec t = {(time_t)(end / SECOND), (long)(end % SECOND)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
        ;
}

static int32_t with_events(const sj_line *line)
{
    for (int i = 0; i < line->count; i++)
        if (line->devices[i].events)
            return i;
    return -1;
}

/* One frame from the socket, if there is one: 1, else 0, or -1 - errno. */
static int32_t serve_frame(sj_line *line, int32_t fd)
{
    uint8_t frame[ROOM];
    union {
        uint8_t bytes[CONTROL];
        struct cmsghdr align;
    } control;
    struct iovec part = {frame, sizeof frame};
    struct msghdr message = {.msg_iov = &part,
                             .msg_iovlen = 1,
                             .msg_control = control.bytes,
                             .msg_controllen = sizeof control.bytes};
    const ssize_t length = recvmsg(fd, &message, MSG_DONTWAIT);
    if (length < 0)
        return errno == EAGAIN || errno == EINTR ? 0 : -1 - errno;
    const int64_t now = sj_wire_now(), at = arrival(&message, now);
    sj_line_advance(line, at);
    const int32_t answer = sj_line_frame(line, frame, (int32_t)length, at);
    if (answer <= 0)
        return 1;
    if (line->late_every && line->frames % line->late_every == 0)
        sleep_until(at + line->late_ns);
    if (send(fd, frame, (size_t)answer, MSG_DONTWAIT) < 0 && errno != EAGAIN && errno != ENOBUFS &&
        errno != ENETDOWN && errno != EINTR)
        return -1 - errno;
    return 1;
}

int32_t sj_wire_serve(sj_line *line, int32_t fd, int64_t until)
{
    for (;;) {
        const int64_t now = sj_wire_now();
        int64_t due = sj_line_due(line, now);
        if (line->wake || now >= until)
            return -1;
        if (due > until)
            due = until;
        if (due > now) {
            struct pollfd wanted = {fd, POLLIN, 0};
            const struct timespec wait = {(time_t)((due - now) / SECOND),
                                          (long)((due - now) % SECOND)};
            if (ppoll(&wanted, 1, &wait, NULL) < 0 && errno != EINTR)
                return -1 - errno;
        }
        for (;;) {
            const int64_t before = sj_wire_now(); /* no frame that comes later is older */
            const int32_t served = serve_frame(line, fd);
            if (served < 0)
                return served;
            const int32_t told = with_events(line);
            if (told >= 0)
                return told;
            if (served == 0) {
                sj_line_advance(line, before);
                break;
            }
        }
        const int32_t told = with_events(line);
        if (told >= 0)
            return told;
    }
}

/* ---- a main device's cycle ---- */

enum { SLOT = 2048, SLOTS = 128, BLOCK = 16384 };

int32_t sj_wire_map(sj_wire_bus *wire)
{
    struct tpacket_req wanted = {BLOCK, SLOT * SLOTS / BLOCK, SLOT, SLOTS};
    const int version = TPACKET_V2;
    void *ring;
    wire->ring = NULL;
    wire->next = 0;
    if (setsockopt(wire->socket, SOL_PACKET, PACKET_VERSION, &version, sizeof version) < 0 ||
        setsockopt(wire->socket, SOL_PACKET, PACKET_RX_RING, &wanted, sizeof wanted) < 0)
        return -errno;
    ring = mmap(NULL, SLOT * SLOTS, PROT_READ | PROT_WRITE, MAP_SHARED, wire->socket, 0);
    if (ring == MAP_FAILED) {
        const int error = errno;
        wanted = (struct tpacket_req){0, 0, 0, 0};
        setsockopt(wire->socket, SOL_PACKET, PACKET_RX_RING, &wanted, sizeof wanted);
        return -error;
    }
    wire->ring = ring;
    return 0;
}

void sj_wire_unmap(sj_wire_bus *wire)
{
    if (wire->ring != NULL)
        munmap(wire->ring, SLOT * SLOTS);
    wire->ring = NULL;
}

/* The next frame of the ring: whether it was an answer, -1 where none has come. */
static int32_t take_mapped(sj_wire_bus *wire)
{
    uint8_t *slot = wire->ring + SLOT * (size_t)wire->next;
    struct tpacket2_hdr *head = (struct tpacket2_hdr *)(void *)slot;
    int32_t answer;
    if (!(__atomic_load_n(&head->tp_status, __ATOMIC_ACQUIRE) & TP_STATUS_USER))
        return -1;
    answer = sj_bus_accept(wire->bus, slot + head->tp_mac, (int32_t)head->tp_snaplen);
    __atomic_store_n(&head->tp_status, TP_STATUS_KERNEL, __ATOMIC_RELEASE);
    wire->next = (wire->next + 1) % SLOTS;
    return answer;
}

static int32_t take_asked(sj_wire_bus *wire)
{
    uint8_t frame[ROOM];
    const ssize_t length = recv(wire->socket, frame, sizeof frame, MSG_DONTWAIT);
    return length < 0 ? -1 : sj_bus_accept(wire->bus, frame, (int32_t)length);
}

static int64_t take(void *self)
{
    sj_wire_bus *wire = self;
    int32_t answers = 0;
    /* bounded: the answers of a cycle, and no more than a flood leaves time for */
    for (int i = 0; i < SLOTS && answers < wire->bus->frames; i++) {
        const int32_t answer = wire->ring != NULL ? take_mapped(wire) : take_asked(wire);
        if (answer < 0)
            break;
        answers += answer;
    }
    return sj_bus_settle(wire->bus);
}

static void send_out(void *self, int64_t deadline_ns)
{
    sj_wire_bus *wire = self;
    sj_bus *bus = wire->bus;
    sj_bus_compose(bus, sj_wire_now(), deadline_ns);
    wire->failed = 0;
    for (int32_t i = 0; i < bus->frames; i++)
        if (send(wire->socket, bus->flight[i].bytes, (size_t)bus->flight[i].length, MSG_DONTWAIT) <
            0)
            wire->failed = errno;
}

static void state(void *self, sj_feedback *feedback)
{
    const sj_wire_bus *wire = self;
    sj_bus_state(wire->bus, feedback);
}

void sj_wire_exchange(sj_wire_bus *wire, sj_exchange *exchange)
{
    *exchange = (sj_exchange){wire, take, send_out, state};
}
