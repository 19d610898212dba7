"""Pictures, by matplotlib (extra ``demo``). Never here: equations, decisions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use("Agg")
from matplotlib import pyplot as plt

from sjerk.errors import InputError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """One line of a panel."""

    label: str
    x: FloatArray
    y: FloatArray
    style: str = "-"


def check(out: Path) -> None:
    """Raise InputError for a picture that cannot be written by its suffix."""
    known = sorted(plt.figure().canvas.get_supported_filetypes())
    plt.close()
    if out.suffix[1:].lower() not in known:
        raise InputError("out", str(out), f"must end in .{', .'.join(known)}")


def panels(
    out: Path,
    title: str,
    content: Mapping[str, Sequence[Curve]],
    limits: Mapping[str, float],
    *,
    x_label: str = "time / s",
) -> None:
    """Draw panels one above the other, each a list of curves, with its limit as dashed lines."""
    figure, axes = plt.subplots(
        len(content), 1, sharex=True, figsize=(9.0, 2.3 * len(content)), layout="constrained"
    )
    for axis, (name, curves) in zip(np.atleast_1d(axes), content.items(), strict=True):
        for curve in curves:
            axis.plot(curve.x, curve.y, curve.style, label=curve.label, linewidth=1.2, markersize=4)
        if name in limits:
            for sign in (1.0, -1.0):
                axis.axhline(sign * limits[name], color="0.5", linestyle="--", linewidth=0.8)
        axis.set_ylabel(name)
        axis.grid(alpha=0.3)
        axis.legend(loc="best", fontsize="small")
    np.atleast_1d(axes)[-1].set_xlabel(x_label)
    figure.suptitle(title)
    figure.savefig(out, dpi=110)
    plt.close(figure)


def grid(
    out: Path, title: str, columns: Sequence[tuple[str, Mapping[str, Sequence[Curve]]]]
) -> None:
    """Draw columns of panels side by side; a curve without a label is not in the legend."""
    rows = max(len(content) for _, content in columns)
    figure, axes = plt.subplots(
        rows,
        len(columns),
        sharex=True,
        squeeze=False,
        figsize=(max(9.0, 4.5 * len(columns)), 2.2 * rows),
        layout="constrained",
    )
    for column, (heading, content) in enumerate(columns):
        axes[0, column].set_title(heading)
        for row, (name, curves) in enumerate(content.items()):
            axis = axes[row, column]
            for curve in curves:
                label = curve.label or "_"
                axis.plot(curve.x, curve.y, curve.style, label=label, linewidth=0.9)
            axis.set_ylabel(name)
            axis.grid(alpha=0.3)
            axis.legend(loc="upper left", fontsize="x-small")
        axes[-1, column].set_xlabel("time / s")
    figure.suptitle(title)
    figure.savefig(out, dpi=90)
    plt.close(figure)
