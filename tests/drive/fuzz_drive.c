/* Random words, targets, faults and configs against the drive; stops at the first broken promise.
 *
 * usage: fuzz_drive CYCLES SEED. Compiled with the sanitizers by tests/drive/test_drive_fuzz.py.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "drive/_drive.h"

static uint64_t random_state;

static uint64_t draw(void)
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return random_state;
}

static uint32_t below(uint32_t n) { return (uint32_t)(draw() >> 32) % n; }

/* Small, large, extreme, and anything in between. */
static int32_t wild(void)
{
    switch (below(5)) {
    case 0: return (int32_t)below(64) - 32;
    case 1: return below(2) ? INT32_MAX : INT32_MIN;
    default: return (int32_t)((uint32_t)draw() >> below(31)) * (below(2) ? 1 : -1);
    }
}

static void promise(int kept, const char *what, uint64_t cycle)
{
    if (!kept) {
        fprintf(stderr, "cycle %llu: %s\n", (unsigned long long)cycle, what);
        exit(1);
    }
}

/* 4-byte words of the config's second half, or a double of its first, set to anything. */
static void mutate(sj_drive_config *config)
{
    const size_t objects = offsetof(sj_drive_config, encoder_increments);
    char *bytes = (char *)config;

    if (below(2)) {
        const int32_t value = wild();
        const size_t words = (sizeof *config - objects) / 4;
        memcpy(bytes + objects + 4 * below((uint32_t)words), &value, 4);
    } else {
        double value = ldexp((double)wild(), (int)below(80) - 60);
        value = below(50) ? value : (below(2) ? (double)NAN : (double)INFINITY);
        memcpy(bytes + 8 * below((uint32_t)(objects / 8)), &value, 8);
    }
}

static const uint8_t LEGAL[8][8] = {
    /* from NRTSO */ {1, 1, 0, 0, 0, 0, 1, 0},
    /* SOD */ {0, 1, 1, 0, 0, 0, 1, 0},
    /* RTSO */ {0, 1, 1, 1, 1, 0, 1, 0},
    /* SO */ {0, 1, 1, 1, 1, 0, 1, 0},
    /* OE */ {0, 1, 1, 1, 1, 1, 1, 0},
    /* QSA */ {0, 1, 0, 0, 1, 1, 1, 0},
    /* FRA */ {0, 0, 0, 0, 0, 0, 1, 1},
    /* FAULT */ {0, 1, 0, 0, 0, 0, 0, 1},
};

int main(int count, char **arguments)
{
    const uint64_t cycles = strtoull(count > 1 ? arguments[1] : "100000", NULL, 10);
    static const uint16_t walk[] = {0x00,  0x06,  0x07, 0x0F, 0x0F, 0x0F, 0x0F,  0x80, 0x02,
                                    0x10F, 0x11F, 0x1F, 0x1F, 0x3F, 0x5F, 0x21F, 0x25F};
    static const int8_t modes[] = {0, 1, 1, 3, 4, 6, 6, 7, 8, 8, 8, 9, 10, 2, -1};
    static const uint16_t climb[8] = {0x00, 0x06, 0x07, 0x0F, 0x0F, 0x0F, 0x0F, 0x00};
    uint64_t visited[8] = {0};
    sj_drive_config usual, config;
    sj_drive drive;
    sj_drive_rx rx = {0};
    sj_drive_tx tx = {0};

    random_state = strtoull(count > 2 ? arguments[2] : "1", NULL, 10) * 0x9E3779B97F4A7C15u + 1;
    FILE *file = count > 3 ? fopen(arguments[3], "rb") : NULL;
    promise(file != NULL && fread(&usual, sizeof usual, 1, file) == 1, "no config", 0);
    (void)fclose(file);
    promise(sj_drive_init(&drive, &usual) == 0, "the config is refused", 0);
    for (uint64_t k = 1; k <= cycles; k++) {
        const int32_t before = drive.state;
        if (below(4000) == 0) {
            promise(sj_drive_init(&drive, &usual) == 0, "the config is refused", k);
            sj_drive_cycle_planned(&drive, &rx, &tx);
            continue;
        }
        if (below(60) == 0) {
            config = drive.config;
            mutate(&config);
            (void)sj_drive_configure(&drive, &config);
        }
        if (below(400) == 0) {
            /* back to a drive that can be enabled */
            promise(sj_drive_configure(&drive, &usual) == 0, "the config is refused", k);
        }
        rx.controlword = climb[drive.state];
        if (drive.state == SJ_STATE_FAULT && k % 2) {
            rx.controlword = 0x80;
        }
        if (below(40) == 0) {
            rx.controlword =
                below(3) ? walk[below(sizeof walk / sizeof walk[0])] : (uint16_t)draw();
        }
        if (below(60) == 0) {
            rx.mode = modes[below(sizeof modes)];
        }
        if (below(200) == 0) {
            sj_drive_inject(&drive, (int32_t)below(SJ_FAULTS + 4) - 2, (int32_t)below(2));
        }
        if (drive.causes != 0 && below(5) == 0) {
            drive.causes = 0;
        }
        rx.sync_missed = below(50) == 0;
        rx.target_position =
            below(100) ? (int32_t)((uint32_t)tx.position_demand + below(2000) - 1000) : wild();
        rx.position_offset = below(200) ? 0 : wild();
        rx.velocity_offset = below(20) ? 0 : wild();
        rx.target_velocity = below(3) ? (int32_t)below(1000000) : wild();
        rx.target_torque = (int16_t)(below(3) ? below(100) : (uint32_t)wild());
        rx.torque_offset = (int16_t)(below(20) ? 0 : wild());
        rx.interpolated_position =
            below(100) ? (int32_t)((uint32_t)tx.position_demand + below(2000) - 1000) : wild();
        rx.probe_function = below(50) ? rx.probe_function : (uint16_t)draw();
        rx.digital_outputs = below(100) == 0;
        rx.output_mask = below(2);
        sj_drive_cycle_planned(&drive, &rx, &tx);
        promise(drive.state >= 0 && drive.state < 8, "no such state", k);
        promise(LEGAL[before][drive.state], "no such transition", k);
        promise((tx.statusword & 0x6F) == sj_drive_state_bits(drive.state), "statusword", k);
        promise(isfinite(drive.servo.velocity_rad_s) && isfinite(drive.servo.torque_nm) &&
                    isfinite(drive.servo.integral_nm) && isfinite(drive.demand.velocity) &&
                    isfinite(drive.verdict.jerk_max_rev_s3),
                "not finite", k);
        promise(drive.servo.fraction >= 0.0 && drive.servo.fraction <= 1.0, "encoder fraction", k);
        promise(drive.actual.units >= drive.scale.range_min &&
                    drive.actual.units < drive.scale.range_min + drive.scale.range,
                "range of 607Bh", k);
        promise(drive.state == SJ_STATE_OPERATION_ENABLED || tx.mode_display == SJ_MODE_HOMING ||
                    !(tx.statusword & SJ_SW_FOLLOWS),
                "follows while not enabled", k);
        visited[drive.state]++;
    }
    for (int state = 0; state < 8; state++) {
        printf("%d:%llu ", state, (unsigned long long)visited[state]);
    }
    printf("\n");
    return 0;
}
