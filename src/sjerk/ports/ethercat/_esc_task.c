/* What a subdevice does once a period: outputs to the words of the drive, the drive, words to inputs.
 *
 * Outside OP the outputs do not count and operation cannot be enabled; the words of the dictionary do
 * count, so that faults can be reset. A target that nobody wrote since the drive was last enabled is
 * the actual position, as in the device's own rule.
 *
 * Never here: time, frames, states of the application layer.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include "ports/ethercat/_esc.h"
#include "ports/ethercat/_words.h"

static void take_outputs(sj_esc *esc)
{
    sj_esc_process *outputs = &esc->outputs;
    sj_esc_buffers *b = &outputs->buffers;
    uint8_t slow[SJ_ESC_SLOW];
    if (b->fresh) {
        const uint8_t taken = b->newest;
        b->newest = b->application;
        b->application = taken;
        b->fresh = 0;
    }
    memcpy(slow, outputs->slow, sizeof slow);
    for (int i = 0; i < outputs->words; i++) {
        const sj_esc_word *word = outputs->word + i;
        uint8_t *to = word->slow ? slow : (uint8_t *)&esc->rx;
        bits_copy(to, 8u * word->offset, b->data[b->application], word->bit, word->bits);
    }
    if (memcmp(slow, outputs->slow, sizeof slow) != 0) {
        memcpy(outputs->slow, slow, sizeof slow);
        esc->events |= SJ_ESC_SLOW_OUTPUTS;
    }
    esc->targets_written |= esc->targets_mapped;
}

static void give_inputs(sj_esc *esc)
{
    sj_esc_process *inputs = &esc->inputs;
    sj_esc_buffers *b = &inputs->buffers;
    uint8_t *data = b->data[b->application];
    for (int i = 0; i < inputs->words; i++) {
        const sj_esc_word *word = inputs->word + i;
        const uint8_t *from = word->slow ? inputs->slow : (const uint8_t *)&esc->tx;
        bits_copy(data, word->bit, from, 8u * word->offset, word->bits);
    }
    const uint8_t filled = b->application;
    b->application = b->newest;
    b->newest = filled;
    b->fresh = 1;
}

void sj_esc_period(sj_esc *esc, int32_t missed)
{
    const int32_t was_enabled = sj_master_enabled(esc->tx.statusword);
    if (esc->applied && !missed && esc->outputs.bytes)
        take_outputs(esc);
    sj_drive_rx rx = esc->rx;
    rx.sync_missed = missed != 0;
    if (!esc->applied)
        rx.controlword &= (uint16_t)~SJ_CW_ENABLE_OPERATION;
    if (esc->deaf || (!was_enabled && !(esc->targets_written & 1)))
        rx.target_position = esc->rx.target_position = esc->tx.position_actual;
    if (esc->deaf || (!was_enabled && !(esc->targets_written & 2)))
        rx.interpolated_position = esc->rx.interpolated_position = esc->tx.position_actual;
    sj_drive_cycle_planned(esc->drive, &rx, &esc->tx);
    give_inputs(esc);
    esc->periods++;
    esc->fresh = 0;
    if (was_enabled && !sj_master_enabled(esc->tx.statusword))
        esc->targets_written = 0;
    if (esc->tx.error_code != esc->error) {
        esc->error = esc->tx.error_code;
        esc->events |= SJ_ESC_ERROR;
    }
    const int32_t state = esc->tx.statusword & 0x6F;
    if (state != esc->state) {
        esc->state = state;
        esc->events |= SJ_ESC_STATE;
    }
}
