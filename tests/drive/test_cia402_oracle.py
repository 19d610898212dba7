"""The whole state machine against an oracle written from the standard's tables, not from the code.

8 states x command bits 7, 3, 2, 1, 0 x bit 7 of the word before x 605Ah x 605Bh x 605Ch x power x
fault x cause x standing: every case, in C and in the table of `sjerk.cia402`.
"""

from __future__ import annotations

from itertools import product

from sjerk._binding import ffi, lib
from sjerk.cia402 import DriveState, Situation, next_state

NRTSO, SOD, RTSO, SO, OE, QSA, FRA, FAULT = range(8)

# Commands as printed: bits 3 2 1 0, x = any. Bit 7 = 1 blocks none of them.
COMMANDS = {
    "disable voltage": "xx0x",
    "quick stop": "x01x",
    "shutdown": "x110",
    "switch on": "0111",
    "enable operation": "1111",
}

# Transitions that a command alone causes: (from, command) -> to, numbers.
BY_COMMAND = {
    (RTSO, "disable voltage"): (SOD, (7,)),
    (RTSO, "quick stop"): (SOD, (7,)),
    (RTSO, "switch on"): (SO, (3,)),
    (RTSO, "enable operation"): (OE, (3, 4)),
    (SO, "disable voltage"): (SOD, (10,)),
    (SO, "quick stop"): (SOD, (10,)),
    (SO, "shutdown"): (RTSO, (6,)),
    (SO, "enable operation"): (OE, (4,)),
    (OE, "disable voltage"): (SOD, (9,)),
    (OE, "quick stop"): (QSA, (11,)),
    (QSA, "disable voltage"): (SOD, (12,)),
}


def command_in(word: int) -> str:
    bits = format(word & 0xF, "04b")
    fitting = [
        name
        for name, pattern in COMMANDS.items()
        if all(p in ("x", b) for p, b in zip(pattern, bits, strict=True))
    ]
    assert len(fitting) == 1, "the commands part all words among them"
    return fitting[0]


def oracle(state: int, case: Situation) -> tuple[int, tuple[int, ...]]:
    stays = (state, ())
    command = command_in(case.controlword)
    if case.fault and state not in (FRA, FAULT):
        return FRA, (13,)
    if state == FRA:
        return (FAULT, (14,)) if case.standing else stays
    if state == FAULT:
        rises = case.controlword & 0x80 != 0 and case.previous & 0x80 == 0
        return (SOD, (15,)) if rises and not case.cause else stays
    if state == NRTSO:
        return SOD, (1,)
    if (state, command) in BY_COMMAND:
        return BY_COMMAND[state, command]
    if state == SOD and command == "shutdown" and case.power:
        return RTSO, (2,)
    if state == OE and command == "shutdown":  # 605Bh: 0 at once, 1 after the ramp
        return (RTSO, (8,)) if case.shutdown_option == 0 or case.standing else stays
    if state == OE and command == "switch on":  # 605Ch, read as Disable operation
        return (SO, (5,)) if case.disable_option == 0 or case.standing else stays
    if state == QSA:
        if case.quick_stop_option in (5, 6, 7, 8):
            return (OE, (16,)) if command == "enable operation" else stays
        if case.quick_stop_option == 0 or case.standing:
            return SOD, (12,)
    return stays


def test_every_case_of_the_state_machine_is_the_oracles() -> None:
    """0 differences between the oracle, the C and the table in Python."""
    numbers = {state.number: state for state in DriveState}
    c_case = ffi.new("sj_drive_input *")
    ran = ffi.new("uint32_t *")
    step = lib.sj_drive_next
    words = [high << 7 | low for high in (0, 1) for low in range(16)]
    flags = (False, True)
    differences = []
    cases = 0
    for values in product(words, (0, 0x80), range(9), (0, 1), (0, 1), flags, flags, flags, flags):
        case = Situation(*values)
        (
            c_case.controlword,
            c_case.previous,
            c_case.quick_stop_option,
            c_case.shutdown_option,
            c_case.disable_option,
            c_case.power,
            c_case.fault,
            c_case.cause,
            c_case.standing,
        ) = values
        for state in range(8):
            cases += 1
            expected = oracle(state, case)
            target = step(state, c_case, ran)
            in_c = target, tuple(n for n in range(17) if ran[0] >> n & 1) if ran[0] else ()
            table = next_state(numbers[state], case)
            if in_c != expected or (table[0].number, table[1]) != expected:
                differences.append((state, case, expected, in_c, table))
    assert cases == 8 * 32 * 2 * 9 * 2 * 2 * 16
    assert not differences, differences[:5]


def test_other_bits_of_the_controlword_change_no_state() -> None:
    """Bits 4, 5, 6 and 8 to 15 are no command: the next state is the same with and without."""
    c_case = ffi.new("sj_drive_input *")
    ran = ffi.new("uint32_t *")
    for state, command, extra in product(range(8), range(16), (0x10, 0x20, 0x40, 0x100, 0xFE00)):
        c_case.standing = 1
        c_case.power = 1
        c_case.controlword = command
        plain = lib.sj_drive_next(state, c_case, ran)
        c_case.controlword = command | extra
        assert lib.sj_drive_next(state, c_case, ran) == plain


def test_each_state_shows_its_pattern() -> None:
    """The statusword bits of a state in C are the pattern of the table."""
    for state in DriveState:
        number, mask, pattern = state.value
        assert lib.sj_drive_state_bits(number) & mask == pattern
        assert DriveState.of(lib.sj_drive_state_bits(number)) is state
