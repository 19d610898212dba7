"""Recordings that were cut, edited or spoilt: read as far as they are whole, or told in a line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from pyarrow import parquet

from sjerk import Axis, InputError, Limits, MotionKernel, Recorder, Recording, replay
from sjerk.__main__ import main
from sjerk._binding import lib

AXES = 3
CYCLES = 4000  # some chunks of an MCAP file
spoilt = settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same motion in either format."""
    folder = tmp_path_factory.mktemp("whole")
    found = {}
    for suffix in ("parquet", "mcap"):
        found[suffix] = folder / f"whole.{suffix}"
        axis = Axis(Limits(90.0, 500.0, 5000.0, position=(-170.0, 170.0)), 2**24 / 360.0)
        kernel = MotionKernel([axis] * AXES)
        with Recorder(kernel, found[suffix]), kernel.host() as host:
            host.enable()
            for goal in range(1, 9):
                host.move([10.0 * goal, -5.0 * goal, 1.0 * goal])
                kernel.step(CYCLES // 8 - 200)
                lib.sj_stop_request(kernel.core.segment, 0, 0b1, 0)  # beside the host
                kernel.step(200)
    return found


def read(file: Path) -> Recording | None:
    """The recording with all its cycles; None where it was refused, by the name of the file."""
    try:
        recording = Recording.open(file)
        assert len(recording) == len(recording.all.missed)
        assert len(recording.events) == len(recording.all.events)
        assert len(recording.knots(0)[0]) == 0
    except InputError as fault:
        refused = fault
    else:
        return recording
    assert str(file) in str(refused)
    assert "\n" not in str(refused)
    return None


def same_cycles(found: Recording, original: Recording) -> None:
    """What was read is a beginning of what was written, bit for bit."""
    frames = original.all.frames[: len(found)]
    assert found.all.frames.tobytes() == frames.tobytes()
    last = int(found.cycle[-1]) if len(found) else 0
    for part in ("commands", "events", "stops"):
        rows = getattr(original.all, part)
        cycle = rows["cycle"]
        assert getattr(found.all, part).tobytes() == rows[cycle <= last].tobytes(), part


@spoilt
@given(share=st.floats(0.0, 1.0))
@example(share=1.0)
def test_a_cut_mcap_is_read_up_to_its_last_whole_chunk(
    whole: dict[str, Path], tmp_path: Path, share: float
) -> None:
    """Wherever it ends: a beginning of the recording, which is replayed, or refused by its name."""
    data = whole["mcap"].read_bytes()
    file = tmp_path / "cut.mcap"
    file.write_bytes(data[: min(int(share * len(data)), len(data) - 1)])
    found = read(file)
    if found is None:
        assert share < 0.1  # only where what it is of is not there
        return
    same_cycles(found, Recording.open(whole["mcap"]))
    if len(found):
        assert replay(found).identical
    else:
        with pytest.raises(InputError, match=r"cut\.mcap.*has no cycle"):
            replay(found)


def test_an_mcap_whose_end_alone_is_missing_has_every_cycle(
    whole: dict[str, Path], tmp_path: Path
) -> None:
    """The last byte, the magic, the footer: none of them holds a cycle."""
    data = whole["mcap"].read_bytes()
    for less in (1, 8, 20, 37):
        file = tmp_path / "cut.mcap"
        file.write_bytes(data[:-less])
        assert len(Recording.open(file)) == CYCLES


@spoilt
@given(data=st.data())
def test_flipped_bits_of_an_mcap_are_found(
    whole: dict[str, Path], tmp_path: Path, data: st.DataObject
) -> None:
    """What is read all the same is a beginning of what was written."""
    spoiled = bytearray(whole["mcap"].read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        spoiled[data.draw(st.integers(0, len(spoiled) - 1))] ^= data.draw(st.integers(1, 255))
    file = tmp_path / "flipped.mcap"
    file.write_bytes(spoiled)
    found = read(file)
    if found is not None:
        same_cycles(found, Recording.open(whole["mcap"]))


@spoilt
@given(data=st.data())
def test_a_spoilt_parquet_is_told_with_its_name(
    whole: dict[str, Path], tmp_path: Path, data: st.DataObject
) -> None:
    """Bits flipped, anywhere or in the footer, or the end cut off."""
    spoiled = bytearray(whole["parquet"].read_bytes())
    begin = data.draw(st.sampled_from([0, max(0, len(spoiled) - 12_000)]))
    for _ in range(data.draw(st.integers(1, 3))):
        spoiled[data.draw(st.integers(begin, len(spoiled) - 1))] ^= data.draw(st.integers(1, 255))
    keep = data.draw(st.one_of(st.just(len(spoiled)), st.integers(0, len(spoiled))))
    file = tmp_path / "spoilt.parquet"
    file.write_bytes(spoiled[:keep])
    read(file)


def edited(whole: Path, file: Path, edit: Callable[[dict[str, Any]], object]) -> None:
    """The recording with another description."""
    table = parquet.read_table(whole)
    description = json.loads(table.schema.metadata[b"sjerk"])
    given = edit(description)
    text = json.dumps(description if given is None else given)
    parquet.write_table(table.replace_schema_metadata({"sjerk": text}), file)


@pytest.mark.parametrize(
    ("edit", "place"),
    [
        (lambda d: d.update(cycle_time="zz"), "cycle_time = 'zz'"),
        (lambda d: d.update(cycle_time=1e99), "cycle_time"),
        (lambda d: d.update(axes=None), "axes: needs"),
        (lambda d: d.update(axes="zz"), "axes = 'zz'"),
        (lambda d: d.update(axes=[]), "axes"),
        (lambda d: d["axes"].__setitem__(1, "zz"), r"axes\[1\] = 'zz': must be a table"),
        (lambda d: d["axes"][1].update(limits="zz"), r"axes\[1\].limits = 'zz'"),
        (lambda d: d["axes"][1]["limits"].update(jerk=-1), r"axes\[1\].limits.jerk = -1"),
        (lambda d: d["axes"][2].update(drive={"feed": 0.5}), r"axes\[2\].drive.feed = 0.5"),
        (lambda d: d["axes"].__delitem__(1), "column = "),
        (lambda d: d["axes"].append(d["axes"][0]), "column = "),
        (lambda d: d.__delitem__("axes"), "axes: needs"),
        (lambda d: d.update(reactions={"overrun": 1}), "reactions.overrun"),
        (lambda d: [1], r"description = \[1\]: must be a table"),
    ],
)
def test_an_edited_description_is_told_with_its_place(
    whole: dict[str, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    edit: Callable[[dict[str, Any]], object],
    place: str,
) -> None:
    """The file, the place in its description, the value; by the command line in one line."""
    file = tmp_path / "edited.parquet"
    edited(whole["parquet"], file, edit)
    with pytest.raises(InputError, match=rf"edited\.parquet.*{place}"):
        len(Recording.open(file))
    for job in (["simulate", str(file)], ["plot", str(file)]):
        assert main(job) == 1
        told = capsys.readouterr().err
        assert told.startswith("sjerk: ")
        assert len(told.splitlines()) == 1
        assert "edited.parquet" in told


def test_missing_columns_are_told_by_their_names(whole: dict[str, Path], tmp_path: Path) -> None:
    """Each column of the table, and the description itself."""
    table = parquet.read_table(whole["parquet"])
    file = tmp_path / "less.parquet"
    for name in table.column_names:
        parquet.write_table(table.drop_columns([name]), file)
        with pytest.raises(
            InputError, match=rf"less\.parquet.*'(frames\.)?{name}(\.cycle)?'"
        ) as caught:
            len(Recording.open(file))
        assert caught.value.field == "file"
        assert caught.value.value == str(file)
    parquet.write_table(table.replace_schema_metadata({}), file)
    with pytest.raises(InputError, match=r"less\.parquet.*no metadata 'sjerk'"):
        Recording.open(file)


@spoilt
@given(data=st.data())
def test_columns_of_another_type_are_told(
    whole: dict[str, Path], tmp_path: Path, data: st.DataObject
) -> None:
    """Text, nothing, numbers of another kind, lists of another length."""
    table = parquet.read_table(whole["parquet"])
    name = data.draw(st.sampled_from(table.column_names))
    n = len(table)
    other = data.draw(
        st.sampled_from(
            [
                pa.array(["zz"] * n),
                pa.nulls(n),
                pa.array(np.zeros(n, np.float16)),
                pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(5 * n)), 5),
                pa.array([[1]] * n),
                pa.array([{"cycle": 1}] * n),
                pa.array([[{"cycle": 1}]] * n),
            ]
        )
    )
    file = tmp_path / "other.parquet"
    changed = table.set_column(table.column_names.index(name), name, other)
    parquet.write_table(changed.replace_schema_metadata(table.schema.metadata), file)
    assert read(file) is None
