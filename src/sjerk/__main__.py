"""The command line of sjerk, thin: arguments in, exit code out.

Exit codes: 0 done, 1 an error that is reported in one line, 2 wrong arguments,
3 refused by the kernel, 4 stopped or superseded on the way, 5 not within the time, 6 no such
kernel, or it ended, 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import sys

from sjerk.cli import (
    clean,
    completion,
    demo,
    doctor,
    drive,
    ethercat,
    follow,
    home,
    jog,
    kernel,
    monitor,
    move,
    new,
    panel,
    plot,
    power,
    record,
    report,
    ros1,
    ros2,
    simulate,
    status,
    stop,
)
from sjerk.cli.arguments import shielded
from sjerk.cli.next_step import next_step
from sjerk.cli.parser import Parser
from sjerk.cli.version import Version
from sjerk.errors import (
    KernelGoneError,
    MotionStoppedError,
    RefusedError,
    SegmentMissingError,
    SjerkError,
)

_EPILOG = (__doc__ or "").partition("\n\n")[2]

#: The verbs in the order in which the help lists them.
_VERBS = (
    demo,
    new,
    kernel,
    power,
    home,
    move,
    jog,
    stop,
    status,
    monitor,
    panel,
    report,
    record,
    plot,
    simulate,
    follow,
    drive,
    ros1,
    ros2,
    ethercat,
    clean,
    doctor,
    completion,
)


def arguments() -> Parser:
    """The parser of ``python -m sjerk``."""
    parser = Parser(prog="sjerk", description="A motion kernel.", epilog=_EPILOG)
    parser.add_argument("--version", action=Version, help="of sjerk and of its build, then end")
    jobs = parser.add_subparsers(dest="job", required=True)
    for verb in _VERBS:
        verb.add_arguments(jobs)
    parser.set_defaults(parser=parser)
    return parser


_CODES: dict[type[Exception], int] = {
    RefusedError: 3,
    MotionStoppedError: 4,
    TimeoutError: 5,
    KernelGoneError: 6,
    SegmentMissingError: 6,
}


def told(error: Exception) -> str:
    """An error in one line, with what helps; of the system's own without the number."""
    said = str(error)
    if isinstance(error, OSError) and error.filename is not None:
        said = f"{error.filename}: {error.strerror}"
    elif isinstance(error, OSError) and error.strerror is not None:
        said = error.strerror
    return "; ".join(filter(None, (said, next_step(error))))


def main(argv: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    options = arguments().parse_args(shielded(sys.argv[1:] if argv is None else argv))
    try:
        return int(options.run(options))
    except (SjerkError, TimeoutError, OSError) as error:
        print(f"sjerk: {told(error)}", file=sys.stderr)
        return next((code for kind, code in _CODES.items() if isinstance(error, kind)), 1)
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    raise SystemExit(main())
