/* Emulated EtherCAT subdevice controllers (ESC) in a line, each in front of a drive.
 *
 * Four hex digits and 'h' name a register here. Times are ns: `now` of any steady clock, system time
 * of the distributed clocks. State is the caller's; nothing here asks a clock or a socket. */
#pragma once
#include <stdint.h>
#include "drive/_drive.h"

enum {
    SJ_ESC_MEMORY = 12288, /* registers 0000h-0FFFh, process RAM 1000h-2FFFh */
    SJ_ESC_RAM = 4096,     /* where the process RAM begins */
    SJ_ESC_BUFFER = 1024,  /* most bytes of process data, each way */
    SJ_ESC_WORDS = 64,     /* most mapped objects, each way */
    SJ_ESC_SLOW = 256,     /* bytes of mapped objects that are no word of the drive */
    SJ_ESC_LINE = 64,      /* most devices of a line */
    SJ_ESC_FRAME = 1514    /* longest Ethernet frame without its checksum */
};

/* what the application is told, sj_esc.events */
enum {
    SJ_ESC_AL_CONTROL = 1,    /* 0120h was written */
    SJ_ESC_MAIL = 2,          /* SM0 holds a mail of the main device */
    SJ_ESC_MAIL_READ = 4,     /* SM1 was read to its end */
    SJ_ESC_REPEAT = 8,        /* the last mail is asked for again, 080Eh bit 1 */
    SJ_ESC_SII = 16,          /* the SII was written */
    SJ_ESC_WATCHDOG = 32,     /* of SM2, expired */
    SJ_ESC_OUTPUTS = 64,      /* a buffer of outputs is complete */
    SJ_ESC_ERROR = 128,       /* 603Fh changed */
    SJ_ESC_STATE = 256,       /* the drive's state changed */
    SJ_ESC_SLOW_OUTPUTS = 512 /* mapped objects outside the drive's words changed */
};

/* 1C32h:1, what begins a period of the drive */
enum {
    SJ_SYNC_FREE = 0, /* the local clock */
    SJ_SYNC_SM = 1,   /* a complete buffer of outputs */
    SJ_SYNC_DC0 = 2,  /* SYNC0 */
    SJ_SYNC_DC1 = 3   /* SYNC1 */
};

/* a mapped object */
typedef struct {
    uint16_t bit; /* in the process data */
    uint16_t bits;
    uint16_t offset; /* of its first byte in sj_drive_rx, sj_drive_tx, or `slow` */
    uint16_t slow;   /* 1: in `slow` */
} sj_esc_word;

/* a SyncManager in buffered mode: three, exchanged */
typedef struct {
    uint8_t data[3][1024];
    uint8_t wire, newest, application; /* which buffer is whose */
    uint8_t fresh;                     /* `newest` has not been taken yet */
} sj_esc_buffers;

/* process data of one direction, as the device accepted it */
typedef struct {
    sj_esc_buffers buffers;
    uint16_t start; /* physical address */
    uint16_t bytes; /* 0: none */
    int32_t words;
    sj_esc_word word[64];
    uint8_t slow[256];
} sj_esc_process;

typedef struct {
    uint8_t memory[12288];
    sj_esc_process outputs, inputs;
    uint32_t events;
    int32_t silent; /* switched off: frames pass it by */
    /* the local clock */
    int64_t boot_ns; /* `now` at its zero */
    int64_t drift_ppb;
    int64_t trim_ns;        /* what the control loop added */
    int64_t trimmed_ns;     /* `now` of its last step */
    double rate;            /* what it adds per ns */
    double deviation_ns;    /* filtered, 092Ch */
    int64_t sync_next_ns;   /* system time of the next event that counts */
    int64_t sync_period_ns; /* 0: none */
    /* the application's task */
    int32_t sync_source;     /* SJ_SYNC_... */
    int32_t applied;         /* 1 in OP: outputs reach the drive */
    int32_t deaf;            /* 1: the target position is never taken */
    int32_t targets_mapped;  /* bit 0 607Ah, bit 1 60C1h:1 */
    int32_t targets_written; /* likewise, since the drive was last enabled */
    int32_t fresh;           /* outputs came since the last period */
    int64_t period_ns;
    int64_t period_next_ns; /* of the local clock */
    int64_t output_ns;      /* `now` of the last complete buffer of outputs */
    uint64_t syncs, syncs_missed, periods;
    int32_t state, error; /* as last told */
    uint8_t *sii;
    uint32_t sii_bytes;
    int32_t sync1_counts; /* 1: SYNC1 begins the periods where it is switched on */
    sj_drive *drive;
    sj_drive_rx rx; /* the words as the dictionary holds them */
    sj_drive_tx tx;
} sj_esc;

typedef struct {
    sj_esc *devices;
    int32_t count;
    int32_t cut;    /* devices that frames reach */
    int64_t hop_ns; /* delay of one device, one way */
    /* faults */
    uint64_t lose_every, damage_every, late_every;
    int64_t late_ns;
    uint64_t frames, datagrams, broken, lost, damaged;
    int32_t watch_outputs; /* 1: SJ_ESC_OUTPUTS is told */
    int32_t wake;          /* 1: sj_wire_serve returns */
} sj_line;

/* ---- a line (_esc_frame.c) ---- */
/* One frame through the line, in place. Returns its length; 0: no EtherCAT frame, or broken; -1: it was
 * lost on its way back. What is due by `now` must have been done. */
int32_t sj_line_frame(sj_line *line, uint8_t *frame, int32_t length, int64_t now);

/* ---- memory (_esc.c) ---- */
void sj_esc_init(sj_esc *esc);
/* 1 done, 0 refused. mask: which bits are written, NULL all. */
int32_t sj_esc_read(sj_esc *esc, uint32_t address, uint8_t *data, uint32_t count, int64_t now);
int32_t sj_esc_write(sj_line *line, sj_esc *esc, uint32_t address, const uint8_t *data,
                     const uint8_t *mask, uint32_t count, int64_t now);
/* Outputs and inputs empty, their SyncManagers opened (1) or closed (0) by the device. */
void sj_esc_open(sj_esc *esc, int32_t opened);

/* ---- clocks (_esc_dc.c) ---- */
int64_t sj_esc_system_time(const sj_esc *esc, int64_t now);
void sj_esc_latch(sj_line *line, sj_esc *esc, int64_t now); /* 0900h was written */
void sj_esc_follow_clock(sj_esc *esc, const uint8_t *data, uint32_t count, int64_t now);
void sj_esc_reset_loop(sj_esc *esc);
void sj_esc_start_sync(sj_esc *esc, int64_t now);      /* 0981h was written */
void sj_line_advance(sj_line *line, int64_t now);      /* all that is due */
int64_t sj_line_due(const sj_line *line, int64_t now); /* when the next is */
/* Virtual time from *now to `end`, each event at its own time; it returns early, with 1, where a device
 * has events for its application. single: after one step. */
int32_t sj_line_pass(sj_line *line, int64_t *now, int64_t end, int32_t single);

/* ---- the drive's task (_esc_task.c) ---- */
void sj_esc_period(sj_esc *esc, int32_t missed);
