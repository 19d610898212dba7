"""A line whose process data have the lengths that a main device with fixed ones wants.

    lengths_line.py DRIVES OUTPUTS INPUTS NAME PPM

Controlword and statusword, the rest is padding; what becomes of the devices is printed.
"""

from __future__ import annotations

import signal
import sys
import threading

from sjerk.ports.ethercat import Behaviour, Line


def padded(word: int, length: int) -> tuple[int, ...]:
    """A mapping of a word of 16 bits and padding, `length` bytes in all."""
    rest = length - 2
    return (word, *(31 * 8 for _ in range(rest // 31)), *((rest % 31 * 8,) if rest % 31 else ()))


def main() -> None:
    """Answer until SIGTERM."""
    drives, outputs, inputs, name, ppm = sys.argv[1:]
    behaviour = Behaviour(
        name=name,
        rx_pdos={0x1600: padded(0x60400010, int(outputs))},
        tx_pdos={0x1A00: padded(0x60410010, int(inputs))},
    )
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    line = Line(
        "ecs",
        drives=int(drives),
        behaviour=behaviour,
        drift_ppm=float(ppm),
        tell=lambda number, what: print(number, what, flush=True),
    )
    with line:
        print("ready", flush=True)
        while not ended.wait(0.1):
            pass
        for number, device in enumerate(line.status()["devices"]):
            print(number, f"deviation {device['deviation_ns']:.0f}", flush=True)


if __name__ == "__main__":
    main()
