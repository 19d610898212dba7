"""Random frames against both ends of an EtherCAT cable, under ASan and UBSan.

Run it with ``./run stress ethercat [--frames N] [--seed S]``. Half of the frames go to a line
of emulated drives with states, mails and motion behind them; half are forged answers to a main
device that moves drives, in virtual time. Exit status 0 if nothing was found.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from helpers.root import TESTS, program
from helpers.sanitized import build, library

FILES = ("test_ethercat_fuzz.py", "test_ethercat_fuzz_main.py")


def main() -> int:
    """Build the C core with sanitizers, run both."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=random.randrange(10**6))
    arguments = parser.parse_args()
    if arguments.frames < 1000:
        parser.error(f"--frames {arguments.frames} must be >= 1000")
    asan = library("libasan.so")
    if asan is None:
        parser.error("the compiler has no libasan")
    begun, failed = time.monotonic(), 0
    with tempfile.TemporaryDirectory(prefix="sjerk-ethercat-") as folder:
        build(Path(folder))
        for name in FILES:
            file = str(TESTS / "ports" / "ethercat" / name)
            done = subprocess.run(
                program("helpers.sanitized", folder, "-s", file),
                env={
                    **os.environ,
                    "LD_PRELOAD": asan,
                    "ASAN_OPTIONS": "detect_leaks=0",
                    "UBSAN_OPTIONS": "print_stacktrace=1",
                    "SJERK_FUZZ_FRAMES": str(arguments.frames // 2),
                    "SJERK_FUZZ_SEED": str(arguments.seed),
                },
            )
            failed += done.returncode != 0
    print(f"seed {arguments.seed}; frames {arguments.frames}; files that failed {failed}; "
          f"took {time.monotonic() - begun:.0f} s")  # fmt: skip
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
