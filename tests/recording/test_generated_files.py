# SPDX-License-Identifier: Apache-2.0
"""Sixty files as loggers, sketches and spreadsheets write them: read right, or refused by name.

A file is what lines of a frame look like, in a form of numbers, with times in some unit. It is
read with the frames and times that it was made of, or refused with a sentence that says what to
add; there is no trace, and no time that is wrong by a factor.
"""

import json
import tracemalloc
from datetime import datetime, timedelta

import numpy as np
import pytest
from support.strangers import sim

from tactile_skin import Circuit
from tactile_skin.cli import main
from tactile_skin.errors import FileError
from tactile_skin.recording.frames import read_frames

CIRCUIT = Circuit(6, 5, r_ref=10e3, r_par=140.0, adc_bits=12)
N, STEP = 120, 0.05  # frames; s between two
SINCE = 1_760_000_000  # s since 1970
DAY = datetime(2025, 10, 9, 11, 59, 57)
TICKS = {"s": 1, "ms": 1000, "us": 10**6, "ns": 10**9}
ROWS, COLS = CIRCUIT.shape
CELLS = [f"R{r + 1}C{c + 1}" for r in range(ROWS) for c in range(COLS)]


@pytest.fixture(scope="module")
def steps():
    """(n, rows, cols) whole ADC steps of a skin that is touched."""
    force = sim.touches(CIRCUIT.shape, N * STEP, 1.0 / STEP)
    return sim.counts(CIRCUIT, sim.fabric(CIRCUIT), force, np.random.default_rng(3))


def when(k: int, unit: str, since: int = 0) -> str:
    """Return the time of a frame as it is printed: of seconds with three decimals."""
    ticks = since * TICKS[unit] + round(k * STEP * 1000) * TICKS[unit] // 1000
    return f"{since + k * STEP:.3f}" if unit == "s" else str(ticks)


def words(frame, separator=",", point=".") -> str:
    return separator.join(f"{v:g}".replace(".", point) for v in np.ravel(frame).tolist())


# --- a file is a function of the frames; it gives its lines, or its arrays ---


def timed(unit, since=0, head="", separator=",", point=".", decimals=0.0, behind=False):
    """A time in front of, or behind, each frame's numbers."""

    def lines(steps):
        for k, frame in enumerate(steps):
            cells = words(frame + decimals, separator, point)
            time = when(k, unit, since).replace(".", point)
            yield separator.join([cells, time] if behind else [time, cells])

    names = [*(f"a{k}" for k in range(29)), "last"]  # that number no cell

    def text(steps):
        line = separator.join([*names, head] if behind else [head, *names])
        return [*([line] if head else []), *lines(steps)]

    return text


def dated(form, separator=","):
    def text(steps):
        for k, frame in enumerate(steps):
            at = (DAY + timedelta(seconds=k * STEP)).strftime(form)
            yield f"{at}{separator}{words(frame, separator)}"

    return text


def named(names, front="", write=None):
    """A header that names the cells, and other columns in front of them."""

    def text(steps):
        yield ",".join([*front.split(","), *names] if front else names)
        for k, frame in enumerate(steps):
            yield (write(k) + "," if write else "") + words(frame)

    return text


def labelled(steps):
    yield "time_ms," + ",".join(f"s{k}" for k in range(30)) + ",gesture"
    for k, frame in enumerate(steps):
        yield f"{50 * k},{words(frame)},{['pat', 'tap', 'rub', 'hit'][k * 4 // N]}"


def in_turn(steps):
    """A table whose time begins again with each gesture."""
    for k, line in enumerate([*labelled(steps)]):
        yield line if k == 0 else f"{50 * (k % 15)},{line.partition(',')[2]}"


def blocks(head="Frame {k}", absent="", separator=",", mark=None, top=()):
    def text(steps):
        yield from top
        for k, frame in enumerate(steps):
            yield from [head.format(k=k)] * bool(head)
            for r, row in enumerate(frame):
                cells = words(row, separator).split(separator)
                if mark and r == 0:
                    cells[1:] = [mark] * (COLS - 1)
                yield separator.join(cells)
            yield absent

    return text


def log(form):
    def text(steps):
        for k, frame in enumerate(steps):
            at = DAY + timedelta(seconds=k * STEP)
            yield form.format(
                at=at, ms=at.microsecond // 1000, k=k, t=50 * k, words=words(frame, " ")
            )

    return text


def objects(**names):
    def text(steps):
        for k, frame in enumerate(steps):
            one = {name: int(when(k, unit, SINCE)) for name, unit in names.items()}
            yield json.dumps(one | {"data": frame.ravel().tolist()})

    return text


def arrays(make):
    return lambda steps: make(steps.astype(np.uint16), np.arange(len(steps)))


def stamps(unit, since=SINCE):
    def of(steps, k):
        ticks = since * TICKS[unit] + k * TICKS[unit] // 20
        return {"frames": steps, "times": ticks if unit != "s" else since + k * STEP}

    return arrays(of)


TIMES = {"time_s": "s", "t_ms": "ms", "stamp [us]": "us", "time_ns": "ns", "Time (sec)": "s"}
READ = {  # what -> file, and whether its times are known
    **{f"csv: {head}": (timed(unit, head=head), True) for head, unit in TIMES.items()},
    **{
        f"csv, behind: {head}": (timed(TIMES[head], SINCE, head, behind=True), True)
        for head in TIMES
    },
    **{f"csv, {unit} since 1970": (timed(unit, SINCE, "time"), True) for unit in TICKS},
    **{f"csv, {unit} without a name": (timed(unit), True) for unit in TICKS},
    "semicolons": (timed("ms", head="time_ms", separator=";"), True),
    "semicolons, decimal commas": (timed("s", 0, "Zeit [s]", ";", ",", 0.25), True),
    "tabs, decimal commas": (timed("ms", 0, "t_ms", "\t", ",", 0.5), True),
    "a date": (dated("%Y-%m-%dT%H:%M:%S.%f"), True),
    "a date as in Germany": (dated("%d.%m.%Y %H:%M:%S.%f", ";"), True),
    "a time of day": (dated("%H:%M:%S.%f"), True),
    "noon": (dated("%m/%d/%Y %I:%M:%S.%f %p", "\t"), True),
    "R1C1": (named(CELLS), False),
    "s_0_0": (named([f"s_{r}_{c}" for r in range(ROWS) for c in range(COLS)]), False),
    "s11": (named([f"s{r + 1}{c + 1}" for r in range(ROWS) for c in range(COLS)]), False),
    "FSR01 behind six": (
        named(
            [f"FSR{k + 1:02}" for k in range(30)],
            "id,trial,x,y,z,time_ms",
            lambda k: f"7,{k // 9},{k % 5 / 8},{k % 7 / 8},0.1,{50 * k}",
        ),
        True,
    ),
    "sensor1 behind a date in the middle": (
        named(
            [f"sensor{k + 1}" for k in range(30)],
            "a,b,c,d,e,datetime,f",
            lambda k: f"1,2.5,3,4,{k % 3},{DAY + timedelta(seconds=k * STEP):%H:%M:%S.%f},x",
        ),
        True,
    ),
    "numbers as names, a time": (
        named(map(str, range(30)), "time_ms", lambda k: f"{50 * k}"),
        True,
    ),
    "numbers as names": (named([*map(str, range(30))]), False),
    "seconds and nanoseconds": (
        named(CELLS, "secs,nsecs", lambda k: f"{SINCE + k // 20},{k % 20 * 50_000_000}"),
        True,
    ),
    "whole seconds": (named(CELLS, "time", lambda k: f"{SINCE + k // 20}"), True),
    "gestures by a label": (labelled, True),
    "blocks": (blocks(), False),
    "blocks, empty lines": (blocks(head=""), False),
    "blocks, tabs": (blocks(separator="\t"), False),
    "a map's head": (blocks(top=["ROWS 6", "SECONDS_PER_FRAME 0.05", ""]), True),
    "a head, Hz": (blocks(top=["Sampling rate: 20 Hz", ""]), True),
    "a log": (log("[{at:%H:%M:%S}.{ms:03}] {words}"), True),
    "a serial monitor": (log("{at:%H:%M:%S}.{ms:03} -> {words}"), True),
    "a log of ms": (log("{t} {words}"), True),
    "json": (objects(stamp_ms="ms"), True),
    "json, ns": (objects(t_ns="ns"), True),
    "a.npy": (arrays(lambda steps, k: steps), False),
    "stacked.npy": (arrays(lambda steps, k: steps.reshape(-1, COLS)), False),
    "flat.npy": (arrays(lambda steps, k: steps.reshape(N, -1)), False),
    "last.npy": (arrays(lambda steps, k: np.moveaxis(steps, 0, -1)), False),
    **{f"{unit}.npz": (stamps(unit), True) for unit in TICKS},
    **{f"{unit} from 0.npz": (stamps(unit, 0), True) for unit in TICKS},
    "logger.npz": (
        arrays(
            lambda steps, k: {
                "t_ns": k * 50_000_000,
                "frame_id": k,
                "gray": (steps // 16).astype("u1"),
                "raw": steps,
            }
        ),
        True,
    ),
}


def write(folder, what, made):
    name = what if what.endswith((".npy", ".npz")) else "a.csv"
    name = {"json": "a.jsonl", "a log": "a.log"}.get(what, name)
    path = folder / name
    if isinstance(made, dict):
        np.savez(path, **made)
    elif isinstance(made, np.ndarray):
        np.save(path, made)
    else:
        path.write_text("\n".join(made) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("what", READ)
def test_a_file_is_read_with_its_frames_and_times(what, tmp_path, steps):
    make, known = READ[what]
    found = read_frames(write(tmp_path, what, make(steps)), CIRCUIT)
    assert np.abs(found.values - steps).max() < 1.0  # of decimals
    assert (found.times is not None) == known
    if known:
        within = 0.06 if what == "whole seconds" else 1e-5
        np.testing.assert_allclose(np.diff(found.times), STEP, atol=within)


def slow(unit, every, head=""):
    return lambda steps: [
        *([",".join([head, *(f"a{k}" for k in range(30))])] if head else []),
        *(f"{k * every * TICKS[unit]:g},{words(frame)}" for k, frame in enumerate(steps)),
    ]


LABEL = "most lines hold .* or a header that names the cells"
REFUSED = {
    "every two seconds": (slow("s", 2), "rises by 2 a frame: name its unit: time_s, time_ms"),
    "every two seconds, named": (slow("s", 2, "time"), "name its unit: time_s, time_ms"),
    "days": (slow("s", STEP / 86400.0, "time"), "name its unit"),
    "a time that begins again": (in_turn, "it begins again 8 times: must be a file for each part"),
    "six more without names": (
        lambda s: [f"{k},1,2.5,3,4,5,{words(f)}" for k, f in enumerate(s)],
        LABEL,
    ),
    "rows and columns of another mat": (
        named([f"r{r}c{c}" for r in range(3) for c in range(10)]),
        "the header names 3 x 10 cells, from r0c0 to r2c9: the circuit is 6 x 5",
    ),
    "a smaller mat": (lambda s: map(words, s[:, :5, 0]), "frames of a smaller mat.* An empty line"),
    "kilo-ohms": (
        lambda s: [words(np.round(4.7 * (4095.0 / f - 1.0) + 6.0, 2)) for f in s],
        "falling under touches: resistances, in kilo-ohms.* must be what the ADC reads",
    ),
    "two.npz": (lambda s: {"left": s, "right": s}, "which are the readings.* Must be named frames"),
    "a jump.npz": (
        lambda s: {"frames": s, "time_s": np.arange(N) * STEP + 6e8 * (np.arange(N) > 9)},
        "times from 0 to 6e.08 s: their unit is another one, or the clock was set",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_file_that_may_be_two_things_is_refused_with_what_to_add(what, tmp_path, steps):
    make, said = REFUSED[what]
    with pytest.raises(FileError, match=f"(?i){said}"):
        read_frames(write(tmp_path, what, make(steps)), CIRCUIT)


MASK = "\n".join(["000000"] + ["001110"] * 3 + ["000000"])  # of a mat of 3 x 3 on a board of 5 x 6
KINDS = {
    "a.csv": lambda path, a: path.write_text("\n".join(map(words, a))),
    "rows.csv": lambda path, a: path.write_text("\n".join(blocks()(a))),
    "a.npy": np.save,
    "a.npz": lambda path, a: np.savez(path, frames=a),
}


@pytest.mark.parametrize("kind", KINDS)
def test_lines_that_a_mask_leaves_empty_are_no_lines_of_a_file(kind, tmp_path, capsys):
    (tmp_path / "mine.yaml").write_text(
        "/**:\n  ros__parameters:\n    circuit: {rows: 5, cols: 6, r_ref: 10000.0, "
        f"mask: '{MASK.replace(chr(10), ' ')}'}}\n"
    )
    circuit = Circuit(3, 3, r_ref=10e3)
    force = sim.touches(circuit.shape, 10.0, 20.0)
    inside = sim.counts(circuit, sim.fabric(circuit), force, np.random.default_rng(5))
    sent = np.zeros((len(inside), 5, 6), int)
    sent[:, 1:4, 2:5] = inside
    path, config = tmp_path / kind, f"config:={tmp_path / 'mine.yaml'}"
    KINDS[kind](path, sent)
    exported = tmp_path / "b.npy"
    assert main(["replay", str(path), config, "--export", str(exported)]) == 0
    np.testing.assert_array_equal(np.load(exported), inside)
    assert main(["replay", str(exported), config, "--export", str(tmp_path / "c.npy")]) == 0
    np.testing.assert_array_equal(np.load(tmp_path / "c.npy"), inside)
    assert main(["doctor", str(path), config]) in (0, 1)
    assert "200 frames of 3 x 3" in capsys.readouterr().out


@pytest.mark.parametrize("heading", [True, False])
@pytest.mark.parametrize("mark", ["B", "x", "n/a"])
def test_a_mark_where_a_sheet_has_no_cell_is_no_reading(mark, heading, tmp_path, steps):
    """In most of a row, as at the toe of an insole."""
    lines = list(blocks(head="Frame {k}" if heading else "", mark=mark)(steps))
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines))
    found = read_frames(path, CIRCUIT)
    right = steps.astype(float)
    right[:, 0, 1:] = np.nan
    np.testing.assert_array_equal(found.values, right)
    assert any(f"'{mark}' at the same 4 cells of all frames" in note for note in found.notes)


def test_text_that_stands_elsewhere_is_damage(tmp_path, steps):
    lines = list(map(words, steps))
    lines[7] = lines[7].replace(",", ",B,", 1).rpartition(",")[0]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines))
    found = read_frames(path, CIRCUIT)
    np.testing.assert_array_equal(found.values, np.delete(steps, 7, 0))
    assert "1 lines with text for a number: dropped (the first: line 8)" in found.notes


def test_all_labels_are_named(tmp_path, steps):
    found = read_frames(write(tmp_path, "labels", labelled(steps)), CIRCUIT)
    assert any(n.startswith("4 labels, 'pat', 'tap', 'rub', 'hit': ") for n in found.notes)
    names, often = np.unique(found.labels["gesture"], return_counts=True)
    assert (names.tolist(), often.sum()) == (["hit", "pat", "rub", "tap"], len(found.values))


def test_frames_a_second_that_nothing_says_are_supposed_aloud(tmp_path, capsys):
    path = tmp_path / "a.npy"
    np.save(path, np.random.default_rng(1).integers(300, 320, (50, 16, 16)))
    assert main(["replay", str(path)]) == 0
    said = "has no times: 100 frames a second are supposed: give rate:="
    assert said in capsys.readouterr().err
    assert main(["replay", str(path), "rate:=50"]) == 0
    assert said not in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["text", "names", "marks", "u1.npy", "i2.npy", "u1 x.npy", "f8.npy", "u2.npz"]
)
def test_reading_takes_at_most_six_times_the_file_in_memory(kind, tmp_path):
    def peak_of(frames: int) -> tuple[int, int]:
        rng = np.random.default_rng(1)
        values = rng.integers(100, 250, (frames, 16, 16))
        values[:, 3, 4] = -1 if kind[0] == "i" else 120
        path = tmp_path / ("a.csv" if "." not in kind else f"a.{kind.split('.')[1]}")
        if kind.endswith("npy"):
            np.save(path, values.astype(kind[:2]))
        elif kind.endswith("npz"):
            np.savez(path, frames=values.astype(kind[:2]), t_ns=np.arange(frames) * 10**7)
        else:
            head = ["time_ms," + ",".join(f"S{255 - k}" for k in range(256))] * (kind == "names")
            lines = [f"{10 * k},{words(frame)}" for k, frame in enumerate(values)]
            if kind == "marks":
                lines = [
                    ",".join("B" if j % 3 else v for j, v in enumerate(line.split(",")))
                    for line in lines
                ]
            path.write_text("\n".join(head + lines))
        tracemalloc.start()
        found = read_frames(path, Circuit(16, 16), full_scale=255.0 if "x" in kind else None)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert len(found.values) == frames
        return path.stat().st_size, peak

    (small, least), (large, most) = peak_of(1000), peak_of(5000)
    print(f"{kind}: {(most - least) / (large - small):.2f} times")
    assert most - least < 6.0 * (large - small)
