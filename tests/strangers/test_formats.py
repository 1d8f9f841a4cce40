# SPDX-License-Identifier: Apache-2.0
"""Formats that strangers' boards send: recognised without a word, and read by what was found."""

import json
from functools import cache

import numpy as np
import pytest
from support.marks import ci
from support.strangers import boards, sim

from tactile_skin import Circuit
from tactile_skin.board.formats import make_format, make_parser
from tactile_skin.board.recognise import explain, recognise

SHAPE = 6, 8
BITS = 10


@cache
def pictures(n=30, shape=SHAPE, seed=7, force=True) -> np.ndarray:
    """(n, rows, cols) ADC steps of a touched matrix."""
    circuit = Circuit(*shape, r_ref=10_000.0, r_par=140.0)
    rng = np.random.default_rng(seed)
    curve = sim.fabric(circuit, seed)
    forces = sim.touches(shape, n / 20, 20, seed=seed, rest=0.5) * force
    read = np.array([sim.counts(circuit, curve, each, rng) for each in forces])
    read.flags.writeable = False
    return read


def read(data: bytes, seen, shape=SHAPE, full_scale=0.0) -> np.ndarray:
    """(n, rows, cols) ADC steps that a parser reads by what was recognised."""
    fmt = seen.format
    if full_scale:
        fmt = type(fmt)(**{**vars(fmt), "full_scale": full_scale})
    parser = make_parser(seen.protocol, *shape, BITS, fmt)
    frames = parser.feed(data)
    assert parser.counters.corrupt <= 1
    return np.array([frame.samples for frame in frames]) / 2 ** (16 - BITS)


@pytest.mark.parametrize("known", [None, SHAPE])
@pytest.mark.parametrize("name", boards.TEXT)
def test_a_text_format_is_recognised_and_read(name, known):
    right = pictures()
    data = boards.sent(boards.TEXT[name], right)
    seen = recognise(data[37:], known)
    assert seen.protocol == "text"
    assert seen.sure, seen
    assert seen.cells == right[0].size
    assert seen.shape in (None, SHAPE)
    full = {"volts": 5.0, "millivolts": 5000.0}.get(name, 0.0)
    found = read(data, seen, full_scale=full)
    assert len(found) >= len(right) - 3
    tolerance = {"volts": 1.1, "millivolts": 0.15}.get(name, 0.0)
    start = next(k for k in range(4) if np.allclose(found[0], right[k], atol=tolerance))
    np.testing.assert_allclose(found, right[start : start + len(found)], atol=tolerance)


def _joined(a) -> str:
    return ",".join(map(str, a.ravel()))


@pytest.mark.parametrize("front", ["$MAT,", ""])
def test_a_checksum_behind_a_star_takes_no_reading_with_it(front):
    """It is hexadecimal: some are numbers, some are not."""
    right = pictures(60)
    data = boards.sent(lambda a, k: f"{front}{_joined(a)}*{a.sum() % 256:02X}\r\n", right)
    seen = recognise(data)
    assert seen.sure and seen.cells == right[0].size, seen
    np.testing.assert_array_equal(read(data, seen), right[1:])


@pytest.mark.parametrize("mark", ["#", ";", "|"])
def test_a_last_field_that_may_hold_a_reading_is_never_sure(mark):
    data = boards.sent(lambda a, k: f"{_joined(a)}{mark}{a.sum() % 256:02X}\n", pictures())
    seen = recognise(data)
    assert not seen.sure and "may be a reading" in seen.about


@pytest.mark.parametrize("rows", [False, True])
@pytest.mark.parametrize("second", [1, 2])
def test_arrays_under_two_keys_may_be_two_mats(rows, second):
    """The second may be smaller."""

    def two(a, k) -> str:
        mats = {"a": a, "b": a[::-second]}
        return json.dumps({n: (m if rows else m.ravel()).tolist() for n, m in mats.items()}) + "\n"

    seen = recognise(boards.sent(two, pictures()))
    assert not seen.sure and "of one mat, or of two?" in seen.about


NO_NUMBERS = {
    "decimal commas": lambda v: ";".join(f"{x / 100:.2f}".replace(".", ",") for x in v),
    "decimal commas, blanks": lambda v: " ".join(f"{x / 100:.2f}".replace(".", ",") for x in v),
    "decimal commas, commas": lambda v: ", ".join(f"{x / 100:.2f}".replace(".", ",") for x in v),
    "bars": lambda v: "|".join(map(str, v)),
}


@pytest.mark.parametrize("kind", NO_NUMBERS)
def test_what_is_no_line_of_numbers_is_shown_with_what_to_print(kind):
    lines = [NO_NUMBERS[kind](a.ravel()).encode() for a in pictures()]
    seen = recognise(b"\n".join(lines))
    assert not seen.protocol
    assert "print decimal numbers (no hexadecimal)" in seen.about
    assert seen.sample == lines[1]


@pytest.mark.parametrize("low", [15, 70])
def test_a_quiet_last_cell_is_no_class(low):
    """Nothing touches the skin, its cells move by a step, and the last reads less than most."""
    rng = np.random.default_rng(3)
    rest = np.append(low - 3, np.append(rng.integers(low, low + 60, 62), low))
    still = (rest + rng.integers(0, 2, (40, 64))).reshape(40, 8, 8)
    for name in ("json_line", "nested_json", "frame_a_line"):
        assert recognise(boards.sent(boards.TEXT[name], still)).sure, name


@pytest.mark.parametrize("zeros", [0, 20])
@pytest.mark.parametrize("most", [2, 5, 12])
def test_a_class_behind_is_never_sure_to_be_a_reading(zeros, most):
    """Neither where cells read 0."""
    rng = np.random.default_rng(3)
    still = 60 + rng.integers(0, 2, (40, 1, 65)) + rng.integers(0, 60, 65)
    still[:, 0, :zeros] = 0
    still[:, 0, -1] = np.arange(40) // 6 % most
    assert not recognise(boards.sent(boards.frame_a_line, still)).sure


PER_FRAME = {  # what each line of a frame begins with, and what ends a frame
    "a counter, and the row": (lambda k, row: f"{k},{row},", ""),
    "a time, and the row": (lambda k, row: f"{3000 + 50 * k},{row},", "\n"),
    "a counter": (lambda k, row: f"{k},", "\n"),
    "a time": (lambda k, row: f"{3000 + 50 * k},", "--\n"),
}


@pytest.mark.parametrize("known", [None, SHAPE])
@pytest.mark.parametrize("kind", PER_FRAME)
def test_a_number_that_is_the_same_in_all_lines_of_a_frame_is_no_reading(kind, known):
    front, behind = PER_FRAME[kind]

    def rows(a, k) -> str:
        lines = (f"{front(k, row)}{_joined(line)}\n" for row, line in enumerate(a))
        return "".join(lines) + behind

    right = pictures()
    data = boards.sent(rows, right)
    seen = recognise(data[37:], known)
    assert seen.sure and seen.shape == SHAPE, seen
    found = read(data[37:], seen)
    np.testing.assert_array_equal(found, right[1 : 1 + len(found)])
    assert len(found) >= len(right) - 3


@pytest.mark.parametrize(("front", "period"), [("{},", 2), ("{},", 10), ("Frame {}: ", 10)])
@pytest.mark.parametrize("force", [False, True])
def test_a_counter_of_frames_that_begins_again_is_never_sure_to_count_rows(period, force, front):
    right = pictures(60, force=force)
    data = boards.sent(lambda a, k: front.format(k % period) + f"{_joined(a)}\n", right)
    assert not recognise(data).sure
    np.testing.assert_array_equal(read(data, recognise(data, SHAPE)), right[1:])


@pytest.mark.parametrize("period", [10, 100, 256])
def test_a_counter_that_begins_again_once_is_no_reading(period):
    right = pictures(12)
    seen = recognise(boards.sent(lambda a, k: f"{(k - 3) % period},{_joined(a)}\n", right))
    assert seen.cells == right[0].size


OTHERS = {  # what stands before a line's readings, what behind, and whether that shows
    "a number of the board": (lambda a, k: "7,", lambda a, k: "", True),
    "a number, then a time": (lambda a, k: f"7,{50 * k},", lambda a, k: "", True),
    "two that hold the scale of a plot": (lambda a, k: "min:0,max:1023,", lambda a, k: "", True),
    "a temperature": (lambda a, k: f"{23.5 + k % 3},", lambda a, k: "", False),
    "a counter of one digit": (lambda a, k: f"{k % 10},", lambda a, k: "", True),
    "a time, and a temperature": (lambda a, k: f"{50 * k},", lambda a, k: f",{20.5 + k % 3}", True),
    "a charge": (lambda a, k: f"{820 + k * k % 5},", lambda a, k: "", False),
    "a charge at the end": (lambda a, k: "", lambda a, k: f",{820 + k * k % 5}", False),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_where_numbers_stand_that_are_none_is_seen_once_the_cells_are_known(kind):
    """Taken off the wrong end, each reading would be that of the cell before it."""
    front, behind, shows = OTHERS[kind]
    right = pictures(60)
    data = boards.sent(lambda a, k: f"{front(a, k)}{_joined(a)}{behind(a, k)}\n", right)
    seen = recognise(data, SHAPE)
    assert seen.sure == shows, seen
    np.testing.assert_array_equal(read(data, seen), right[1:])


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("seed", [2, 5])
def test_a_number_that_reads_as_the_cells_do_is_never_sure_to_be_none(front, seed):
    """As the time since the last frame may."""
    right = pictures(60, seed=seed)
    usual = int(np.median(right))

    def line(a, k) -> str:
        other = str(usual + k * k % 3)
        return ",".join([other, _joined(a)] if front else [_joined(a), other]) + "\n"

    assert not recognise(boards.sent(line, right), SHAPE).sure


@pytest.mark.parametrize("name", boards.PACKETS)
def test_packets_are_recognised_and_read(name):
    right = pictures()
    data = boards.sent(boards.PACKETS[name], right)
    seen = recognise(data[41:])
    assert seen.protocol == "packets"
    assert seen.sure == name.endswith(("sum", "crc"))
    assert seen.cells == right[0].size
    found = read(data, seen)
    right = right // 4 if name == "words_with_a_sum" else right
    start = next(k for k in range(2) if np.array_equal(found[0], right[k]))
    np.testing.assert_array_equal(found, right[start : start + len(found)])
    assert len(found) >= len(right) - 2


@pytest.mark.parametrize("seed", range(4))
def test_bytes_of_a_quiet_mat_are_surely_no_words(seed):
    """Two of them look like a word whose high byte has no noise."""
    rng = np.random.default_rng(seed)
    quiet = rng.integers(60, 480, SHAPE) + rng.integers(0, 2, (30, *SHAPE))
    data = boards.sent(boards.words_with_a_sum, quiet)
    seen = recognise(data)
    assert not seen.sure or seen.cells == quiet[0].size
    known = recognise(data, SHAPE)
    assert known.sure
    np.testing.assert_array_equal(read(data, known), quiet // 4)


def test_packets_of_no_fixed_size_are_named_by_what_ends_them():
    seen = recognise(boards.sent(boards.run_lengths, pictures()))
    assert (seen.sure, seen.protocol) == (False, "") and "FF after " in seen.about


@pytest.mark.parametrize("behind", ["", "\r\n"])
def test_a_reading_a_line_is_no_column_unless_that_is_said(behind):
    """No parser reads a frame of several columns so."""
    data = boards.sent(lambda a, k: "".join(f"{v}\r\n" for v in a.ravel()) + behind, pictures())
    for known in (None, SHAPE):
        seen = recognise(data, known)
        assert seen.protocol == "" and "a reading a line" in seen.about
    assert not behind or recognise(data, (48, 1)).sure


def test_numbers_without_a_line_end_are_named():
    data = "".join("\t".join(map(str, a.ravel())) for a in pictures(50, (2, 2))).encode()
    parser = make_parser("text", 2, 2, BITS)
    assert parser.feed(data) == []
    assert "no line ever ends" in explain(parser)


@pytest.mark.parametrize("baud", [4800, ci(19200), ci(38400), 57600, ci(74880), 230_400])
@pytest.mark.parametrize("name", [*boards.TEXT, *boards.PACKETS])
def test_a_wrong_baud_rate_is_never_sure(name, baud):
    data = boards.sent({**boards.TEXT, **boards.PACKETS}[name], pictures())
    assert not recognise(boards.received(data, 115_200, baud)).sure


@pytest.mark.parametrize(
    "name", ["row_a_line", "numpy_print", "rows_under_a_heading", "json_lines"]
)
def test_a_row_a_line_is_read_without_a_setting(name):
    """8 numbers a line are a row of 8 x 8; a frame comes with its last row once it is known."""
    right = pictures(12, (8, 8))
    parser = make_parser("text", 8, 8, BITS)
    frames = parser.feed(boards.sent(boards.TEXT[name], right))
    assert len(frames) >= 10
    np.testing.assert_array_equal(frames[-1].samples / 64, right[10 if len(frames) < 11 else 11])
    assert parser.counters.corrupt == 0


def test_a_damaged_row_spoils_its_frame_only():
    right = pictures(12, (8, 8))
    chunks = [boards.sent(boards.row_a_line, right[k : k + 1]) for k in range(12)]
    rows = chunks[5].split(b"\r\n")
    chunks[5] = b"\r\n".join([*rows[:3], rows[3].replace(b" ", b"x", 1), *rows[4:]])
    rows = chunks[8].split(b"\r\n")
    chunks[8] = b"\r\n".join([*rows[:3], *rows[4:]])  # one is lost
    parser = make_parser("text", 8, 8, BITS)
    frames = parser.feed(b"".join(chunks))
    assert parser.counters.corrupt == 2
    known = {picture.tobytes() for picture in right.astype(float)}
    assert len(frames) == 9
    assert all((frame.samples / 64).tobytes() in known for frame in frames)


def test_lines_that_are_no_frame_are_passed_over_and_damage_counts():
    right = pictures(40)
    chunks = [boards.sent(boards.status_lines, right[k : k + 1], k) for k in range(40)]
    chunks[20] = chunks[20].replace(b",", b"?", 1)
    parser = make_parser("text", *SHAPE, BITS)
    frames = parser.feed(b"".join(chunks))
    assert len(frames) == 38  # the first line may be the rest of one
    assert parser.counters.corrupt == 1
    assert parser.counters.passed == 80


@pytest.mark.parametrize(
    ("name", "said"),
    [("volts", "these look like volts: set"), ("millivolts", "millivolts")],
)
def test_another_scale_is_named_and_no_width(name, said):
    right = np.minimum(pictures(40) * 3, 1023)
    parser = make_parser("text", *SHAPE, BITS)
    parser.feed(boards.sent(boards.TEXT[name], right))
    assert parser.counters.frames < 20
    assert said in explain(parser)
    assert "set circuit.adc_bits" not in explain(parser)


def test_a_width_is_named_where_its_end_is_reached():
    right = np.minimum(pictures(40) * 12, 4095)
    parser = make_parser("text", *SHAPE, BITS)
    parser.feed(boards.sent(boards.frame_a_line, right))
    assert "4095 is the end of 12 bits: set circuit.adc_bits: 12" in explain(parser)


@pytest.mark.parametrize("rows_cols", [(1, 8), (8, 8), (8, 6), (4, 4), (16, 16)])
@pytest.mark.parametrize("name", boards.TEXT)
def test_no_advice_names_rows_and_columns_that_blind(name, rows_cols):
    parser = make_parser("text", *rows_cols, BITS)
    parser.feed(boards.sent(boards.TEXT[name], pictures()))
    said = explain(parser)
    assert "set circuit.rows" not in said
    assert "set circuit.cols" not in said


@pytest.mark.parametrize("name", boards.PACKETS)
def test_a_packet_that_lost_bytes_is_no_frame(name):
    right = pictures(40)
    rng = np.random.default_rng(3)
    chunks = [boards.sent(boards.PACKETS[name], right[k : k + 1], k) for k in range(40)]
    seen = recognise(b"".join(chunks))
    for k in range(3, 37, 3):
        at = rng.integers(4, len(chunks[k]) - 8)
        chunks[k] = chunks[k][:at] + chunks[k][at + rng.integers(1, 5) :]
    parser = make_parser("packets", *SHAPE, BITS, seen.format)
    frames = parser.feed(b"".join(chunks))
    known = right // 4 if name == "words_with_a_sum" else right
    known = {picture.tobytes() for picture in known.astype(float)}
    assert len(frames) >= 14
    assert all((frame.samples / 64).tobytes() in known for frame in frames)


@pytest.mark.parametrize(
    ("name", "given", "said"),
    [
        ("carriage_returns", {}, 'set serial_driver.format.end: "\\r"'),
        ("angle_brackets", {}, "set serial_driver.format.end: '>'"),
        ("frame_a_line", {"end": ">"}, 'set serial_driver.format.end: "\\n"'),
        ("frame_a_line", {"line": "{skip};{values}", "end": ">"}, "line: '{values}', serial_dri"),
        (
            "rows_with_a_number",
            {"line": "{row},{values}", "first": 1},
            "set serial_driver.format.fi",
        ),
    ],
)
def test_each_entry_of_a_format_that_differs_is_named_as_it_is_typed(name, given, said):
    parser = make_parser("text", *SHAPE, BITS, make_format("text", given))
    parser.feed(boards.sent(boards.TEXT[name], pictures()))
    assert parser.counters.frames == 0
    assert said in explain(parser)


def test_an_entry_of_another_protocol_says_what_to_do():
    with pytest.raises(ValueError, match=r"format.head = 'A0': no text has it, leave it out"):
        make_format("text", {"head": "A0"})
