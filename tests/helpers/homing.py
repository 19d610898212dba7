"""A drive that homes, run to the end of it."""

from __future__ import annotations

from sjerk.cia402 import Drive, DriveFeedback, Mode, StatusWord

ATTAINED, REACHED, ERROR = (
    StatusWord.FOLLOWS,
    StatusWord.TARGET_REACHED,
    StatusWord.FOLLOWING_ERROR,
)


def home(drive: Drive, seconds: float = 60.0) -> list[DriveFeedback]:
    """From a disabled drive to bits 10 and 12, or 10 and 13; what each period of it gave."""
    drive.enable(mode=Mode.HOMING)
    return search(drive, seconds)


def search(drive: Drive, seconds: float = 60.0) -> list[DriveFeedback]:
    """The same of an enabled drive."""
    seen = []
    for _ in range(round(seconds / drive.config.period_s)):
        seen.append(drive.cycle(0x1F, mode=Mode.HOMING))
        word = seen[-1].statusword
        if word & REACHED and word & (ATTAINED | ERROR):
            return seen
    raise AssertionError(f"homing does not end: {seen[-1]}")
