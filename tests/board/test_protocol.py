# SPDX-License-Identifier: Apache-2.0
"""The wire format: whatever the wire does to the bytes, only frames that were sent come out."""

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_skin.board import protocol
from tactile_skin.board.formats import PROTOCOLS, make_parser
from tactile_skin.board.frame import Counters
from tactile_skin.board.protocol import BinaryParser, crc16, encode
from tactile_skin.board.recognise import explain
from tactile_skin.board.text import TextParser


def samples_of(k: int, rows: int = 3, cols: int = 5) -> np.ndarray:
    """Samples of frame k: 10 bits and 6 bits of fraction, different in every frame."""
    return np.random.default_rng(k).integers(0, 1 << 16, (rows, cols)).astype(np.uint16)


def frame_bytes(k: int, rows: int = 3, cols: int = 5) -> bytes:
    return encode(k, 10_000 * k, samples_of(k, rows, cols), 10, 6)


def stream(*sequence: int) -> bytes:
    return b"".join(frame_bytes(k) for k in sequence)


def content(frame) -> tuple:
    return (
        frame.sequence,
        frame.device_time_us,
        frame.adc_bits,
        frame.samples.shape,
        frame.samples.tobytes(),
    )


def sent(k: int) -> tuple:
    samples = samples_of(k)
    return k, 10_000 * k, 10, samples.shape, samples.tobytes()


# --- layout -----------------------------------------------------------------------------------


def test_crc_has_the_published_check_value():
    """CRC-16/CCITT-FALSE of "123456789" is 0x29B1."""
    assert crc16(b"123456789") == 0x29B1


FIELDS = {  # the docstring's table: field -> (offset, size, value in the frame below)
    "magic": (0, 2, b"\xa5\x5a"),
    "version": (2, 1, b"\x01"),
    "rows": (3, 1, b"\x02"),
    "cols": (4, 1, b"\x03"),
    "adc_bits": (5, 1, b"\x0a"),
    "fraction_bits": (6, 1, b"\x04"),
    "sequence": (7, 2, b"\xcd\xab"),
    "device time": (9, 4, b"\x78\x56\x34\x12"),
    "samples": (15, 12, bytes([1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 0xFF, 0x3F])),
}
SMALL = encode(0xABCD, 0x12345678, np.array([[1, 2, 3], [4, 5, 0x3FFF]]), 10, 4)


@pytest.mark.parametrize("field", FIELDS)
def test_field_lies_where_the_table_says(field):
    offset, size, expected = FIELDS[field]
    assert SMALL[offset : offset + size] == expected


def test_checksums_lie_where_the_table_says():
    assert SMALL[13:15] == crc16(SMALL[:13]).to_bytes(2, "little")
    assert SMALL[-2:] == crc16(SMALL[:-2]).to_bytes(2, "little")
    assert len(SMALL) == 15 + 2 * 6 + 2


def test_the_docstring_names_the_same_offsets_and_sizes():
    table = re.findall(r"^ {4}(\d+) +(\S+) +([\w ]+)", protocol.__doc__, re.MULTILINE)
    written = {(int(offset), size): name for offset, size, name in table}
    for field, (offset, size, _) in FIELDS.items():
        name = written[offset, "2*n" if field == "samples" else str(size)]
        assert name.startswith(field)


def test_sequence_and_time_wrap():
    """Their fields keep the low bits."""
    (frame,) = BinaryParser().feed(encode(65_536 + 7, 2**32 + 9, samples_of(0), 10, 6))
    assert (frame.sequence, frame.device_time_us) == (7, 9)


@pytest.mark.parametrize(
    ("adc_bits", "fraction_bits"), [(10, 6), (10, 0), (12, 4), (16, 0), (8, 3)]
)
def test_samples_come_out_in_one_scale(adc_bits, fraction_bits):
    """Whatever fraction was sent, a frame's samples are ADC steps * 2**(16 - adc_bits)."""
    steps = np.array([[0, 1, 2**adc_bits - 1]])
    data = encode(0, 0, steps << fraction_bits, adc_bits, fraction_bits)
    (frame,) = BinaryParser().feed(data)
    np.testing.assert_array_equal(frame.samples, steps << (16 - adc_bits))
    assert frame.adc_bits == adc_bits


@settings(deadline=None, max_examples=50)
@given(st.integers(1, 64), st.integers(1, 64), st.integers(0, 65_535), st.integers(0, 2**32 - 1))
def test_round_trip_of_every_size(rows, cols, sequence, device_time):
    samples = samples_of(sequence, rows, cols)
    (frame,) = BinaryParser().feed(encode(sequence, device_time, samples, 10, 6))
    np.testing.assert_array_equal(frame.samples, samples)
    assert (frame.sequence, frame.device_time_us) == (sequence, device_time)


# --- chunks -----------------------------------------------------------------------------------


def test_a_frame_comes_with_its_last_byte():
    """Neither earlier nor only with the next frame."""
    parser, data = BinaryParser(), frame_bytes(0)
    assert parser.feed(data[:-1]) == []
    assert len(parser.feed(data[-1:])) == 1


# --- damage -----------------------------------------------------------------------------------


@pytest.mark.parametrize("place", range(len(frame_bytes(1))))
def test_no_flipped_byte_passes(place):
    """A CRC of 16 bits finds every damage of one byte; the frames around it arrive."""
    for flip in (0x01, 0x80, 0xFF):
        data = bytearray(stream(0, 1, 2))
        data[len(frame_bytes(0)) + place] ^= flip
        parser = BinaryParser()
        assert [content(f) for f in parser.feed(bytes(data))] == [sent(0), sent(2)]
        corrupt = int(place > 1)  # without its magic it was no frame
        assert parser.counters == Counters(2, corrupt, 1, 0, len(frame_bytes(1)))


@pytest.mark.parametrize("start", range(1, len(frame_bytes(0))))
def test_a_start_in_the_middle_is_no_error(start):
    """Whoever opens the port while a frame is on its way has seen no damage."""
    parser = BinaryParser()
    assert [content(f) for f in parser.feed(stream(0, 1, 2)[start:])] == [sent(1), sent(2)]
    assert parser.counters == Counters(frames=2, skipped_bytes=len(frame_bytes(0)) - start)


def test_magic_within_the_samples_does_not_confuse():
    """Neither in a whole frame nor in one of which only the end was seen."""
    magic = np.full((4, 4), int.from_bytes(protocol.MAGIC, "little"), np.uint16)
    data = encode(0, 0, magic, 10, 6)
    parser = BinaryParser()
    assert [f.sequence for f in parser.feed(data[20:] + data + frame_bytes(1, 4, 4))] == [0, 1]
    assert parser.counters.corrupt == 0


HEADER_LIES = {
    "version": {2: 9},
    "no rows": {3: 0},
    "rows above 64": {3: 65},
    "no columns": {4: 0},
    "columns above 64": {4: 200},
    "no ADC bits": {5: 0},
    "more than 16 bits": {5: 12, 6: 6},
}


@pytest.mark.parametrize("lie", HEADER_LIES)
def test_a_header_out_of_range_is_no_frame(lie):
    """Even with a CRC that is right; the parser does not wait for the size that it claims."""
    data = bytearray(frame_bytes(1))
    for place, value in HEADER_LIES[lie].items():
        data[place] = value
    data[13:15] = crc16(data[:13]).to_bytes(2, "little")
    data[-2:] = crc16(data[:-2]).to_bytes(2, "little")
    parser = BinaryParser()
    frames = parser.feed(frame_bytes(0) + bytes(data) + frame_bytes(2))
    assert [content(f) for f in frames] == [sent(0), sent(2)]
    assert parser.counters.corrupt == 1


@pytest.mark.parametrize("change", [{"rows": 64}, {"cols": 4}, {"adc_bits": 9}])
def test_a_header_of_another_board_keeps_no_frame_waiting(change):
    """Its CRC is right, as one damaged header's in 65,536 is: the frame behind it comes with its
    last byte, not after the thousands that were announced."""
    layout = {"rows": 3, "cols": 5, "adc_bits": 10} | change
    samples = np.zeros((layout["rows"], layout["cols"]), int)
    foreign = encode(1, 0, samples, layout["adc_bits"], 6)[:15]
    parser = BinaryParser()
    frames = parser.feed(frame_bytes(0) + foreign + frame_bytes(2))
    assert [content(f) for f in frames] == [sent(0), sent(2)]
    assert parser.counters == Counters(2, 1, 1, 0, len(foreign))


@pytest.mark.parametrize("noise", [b"\x00", b"\xa5", protocol.MAGIC, frame_bytes(0)[:-1] + b"\x00"])
def test_the_buffer_stays_bounded(noise):
    """However long no frame comes, less than one largest frame is kept."""
    parser = BinaryParser()
    largest = 15 + 2 * protocol.MAX_LINES**2 + 2
    for _ in range(500):
        assert parser.feed(noise * 37) == []
        assert len(parser._buffer) < largest


@pytest.mark.parametrize(("adc_bits", "fraction_bits"), [(10, 4), (12, 0), (8, 3), (1, 0)])
def test_a_sample_beyond_full_scale_is_no_small_reading(adc_bits, fraction_bits):
    """The CRCs are right, so the board is wrong: the frame is dropped, counted and skipped, and the
    largest sample that the header allows passes. Scaled to 16 bits it would wrap to 0.
    """
    most = 2 ** (adc_bits + fraction_bits) - 1
    for beyond in (most + 1, 2 * most, 65_535):
        samples = np.array([[0, most], [most, 0]])
        good = encode(0, 0, samples, adc_bits, fraction_bits)
        samples[1, 1] = beyond
        bad = encode(1, 0, samples, adc_bits, fraction_bits)
        parser = BinaryParser()
        frames = parser.feed(good + bad + encode(2, 0, samples * 0, adc_bits, fraction_bits))
        assert [f.sequence for f in frames] == [0, 2]
        assert frames[0].samples[0, 1] == most << (16 - adc_bits - fraction_bits)
        assert parser.counters == Counters(
            frames=2, corrupt=1, lost=1, skipped_bytes=len(bad), out_of_range=1
        )


@pytest.mark.parametrize("sample", [-1, 65_536, math.nan])
def test_a_sample_that_two_bytes_cannot_hold_is_not_sent(sample):
    """Cut off, it would be another reading."""
    with pytest.raises(ValueError, match="from 0 to 65535"):
        encode(0, 0, np.array([[sample, 0]]), 10, 6)


# --- counters ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sequences", "lost", "restarts"),
    [
        ([0, 1, 2], 0, 0),
        ([0, 3, 4], 2, 0),
        ([65_534, 65_535, 0, 1], 0, 0),
        ([65_534, 2], 3, 0),
        ([4000, 0, 1], 0, 1),
        ([4000, 0, 2], 1, 1),
        ([500], 0, 0),
        ([0, 1001], 1000, 0),
        ([0, 1002], 0, 1),
    ],
)
def test_gaps_of_the_sequence_are_counted(sequences, lost, restarts):
    """Across the wrap-around too; a jump back or far ahead is a board that started anew."""
    parser = BinaryParser()
    parser.feed(stream(*sequences))
    assert parser.counters == Counters(len(sequences), 0, lost, restarts, 0)


# --- text -------------------------------------------------------------------------------------


def line(values, end=b"\n") -> bytes:
    return ",".join(map(str, np.ravel(values))).encode() + end


def text_parser() -> TextParser:
    """A parser of 2 x 3 cells that has seen a line end."""
    parser = TextParser(2, 3)
    parser.feed(b"\n")
    parser.counters.skipped_bytes = 0
    return parser


STEPS = np.array([[0, 1, 2], [500, 1022, 1023]])


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b",\n", b", \r\n", b"  \n"])
def test_the_line_ends_of_hobby_sketches_are_understood(end):
    (frame,) = text_parser().feed(line(STEPS, end))
    np.testing.assert_array_equal(frame.samples, STEPS * 64)
    assert frame.device_time_us is None


def test_text_with_fractions_keeps_them():
    (frame,) = text_parser().feed(b"0.5,1.25,2,3,4,50\n")
    assert frame.samples[0].tolist() == [32, 80, 128]


def test_small_numbers_with_decimals_may_be_volts_until_a_larger_one_arrives():
    parser = text_parser()
    assert not parser.feed(b"0.5,1.25,2,3,4,5\n")
    assert len(parser.feed(b"0.5,1.25,2,3,4,50\n0.5,1.25,2,3,4,5\n")) == 2


def test_what_comes_before_the_first_line_end_is_no_frame():
    """It may be the rest of a line, and still hold the right number of values."""
    parser = TextParser(2, 3)
    (frame,) = parser.feed(line(STEPS) + line(STEPS[::-1]))
    np.testing.assert_array_equal(frame.samples, STEPS[::-1] * 64)
    assert parser.counters == Counters(frames=1, skipped_bytes=len(line(STEPS)))


BAD_LINES = {
    "a value too few": b"1,2,3,4,5",
    "a value too many": b"1,2,3,4,5,6,7",
    "above the ADC's range": b"1,2,3,4,5,1024",
    "below 0": b"1,2,-30,4,5,6",
    "no reading at all": b"nan,nan,nan,nan,nan,nan",
    "two kinds of separators": b"1;2,3;4,5;6",
    "a sign before nan": b"1,2,-nan,4,5,6",
    "infinity": b"1,2,inf,4,5,6",
    "an exponent": b"1,2,1e2,4,5,6",
    "a sign": b"1,2,+3,4,5,6",
    "an underscore": b"1,2,1_0,4,5,6",
    "a NUL": b"1,2,3,4,5,6\0",
    "a word": b"1,2,x,4,5,6",
    "another word for nothing": b"1,2,NA,4,5,6",
    "nothing": b"",
    "no text": b"\xff\xfe,2,3,4,5,6",
}


@pytest.mark.parametrize("bad", BAD_LINES)
def test_a_bad_line_is_dropped_and_counted(bad):
    """The next line is read again."""
    parser = text_parser()
    frames = parser.feed(BAD_LINES[bad] + b"\n" + line(STEPS))
    assert len(frames) == 1
    beyond, passed = (
        int(bad == "above the ADC's range"),
        int(bad in ("nothing", "infinity", "no text")),
    )
    wrong = Counters(frames=1, corrupt=1 - passed, passed=passed, out_of_range=beyond)
    assert parser.counters == wrong


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([b"1,2,3,4,5"], "circuit.rows = 2 x circuit.cols = 3 are 6 readings"),
        ([b"1,2,3,4,3890,6"], "adc_bits = 10 ends at 1023: millivolts"),
        (
            [b"1,2,3,4,3890,6"],
            "or an ADC of 12 bits or more, or sums of several readings, or resistances?",
        ),
        ([b"1,2,3,4,5,1023.5"], "numbers up to 1023.5, but circuit.adc_bits = 10 ends at 1023: "),
        ([b"1,2,-30,4,5,6"], "negative numbers: print what the ADC reads, nothing subtracted"),
        ([b"hello, world"], "text arrives, but no lines of numbers"),
        ([b"1,2,3,4", b"1,2,3,4", b"1,2,3,4", b"hello"], "4 numbers a line, 3 lines, then another"),
    ],
)
def test_lines_that_do_not_go_with_the_configuration_say_what_they_are(lines, said):
    parser = text_parser()
    parser.feed(b"\n".join(lines * 20) + b"\n")
    assert parser.counters.frames == 0
    assert said in explain(parser)


@pytest.mark.ci
def test_the_largest_number_that_is_named_does_not_change_with_each_line():
    """Each other text is another reason to stop, and a call of each hook."""
    parser, said = text_parser(), set()
    for k in range(200):
        parser.feed(b"1,2,3,4,5,%d\n" % (1500 + 10 * k))
        said.add(explain(parser).partition(" (")[0])
    assert len(said) <= 8
    assert 0.8 * (1500 + 1990) <= parser.counters.largest <= 1500 + 1990


ABSENT_LINES = {
    "nan": b"0,1,nan,500,1022,1023",
    "NaN": b"0, 1, NaN, 500, 1022, 1023,",
    "a dash": b"0;1;-;500;1022;1023",
    "nothing between commas": b"0,1,,500,1022,1023",
    "a blank between semicolons": b"0; 1; ; 500; 1022; 1023;",
    "nothing between tabs": b"0\t1\t\t500\t1022\t1023\t",
    "nan between spaces": b"  0 1  nan 500 1022 1023 ",
    "tabs beside commas": b"0,\t1,\t-,\t500,\t1022,\t1023",
}


@pytest.mark.parametrize("how", ABSENT_LINES)
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_a_crossing_that_was_not_read_is_told_from_one_that_reads_nothing(how, end):
    (frame,) = text_parser().feed(ABSENT_LINES[how] + end)
    np.testing.assert_array_equal(frame.unread, [[False, False, True], [False] * 3])
    np.testing.assert_array_equal(frame.samples, np.array([[0, 1, 0], [500, 1022, 1023]]) * 64)


@pytest.mark.parametrize("separator", [b",", b";", b"\t", b" ", b"   ", b", ", b" ;  ", b" \t"])
def test_numbers_may_be_separated_by_what_sketches_print(separator):
    words = [b"%d" % v for v in STEPS.ravel()]
    (frame,) = text_parser().feed(separator.join(words) + b"\n")
    np.testing.assert_array_equal(frame.samples, STEPS * 64)
    assert frame.unread is None


def test_an_empty_last_field_is_a_crossing_unless_lines_end_with_a_separator():
    """A line that ends so, and lost a number on its way, would have moved all behind it by one."""
    parser = text_parser()
    (frame,) = parser.feed(b"1,2,3,4,5,\n1,2,3,4,5,\n")
    assert frame.unread.tolist() == [[False] * 3, [False, False, True]]
    parser = text_parser()
    assert len(parser.feed(b"1,2,3,4,5,6,\n1,2,4,5,6,\n1,2,4,5,6,\n1,2,3,4,5,6,\n")) == 2


def test_text_that_arrives_where_frames_are_due_is_recognised():
    parser, rng = BinaryParser(), np.random.default_rng(1)
    for _ in range(40):
        parser.feed(line(rng.integers(200, 900, (2, 3))))
    said = "text arrives, a frame a line, 6 readings: set serial_driver.protocol: text"
    assert explain(parser).startswith(said)


def test_frames_that_arrive_where_text_is_due_are_recognised():
    parser = make_parser("text", 2, 3, 10)
    for k in range(20):
        parser.feed(frame_bytes(k))
    said = "binary frames of 3 x 5 at 10 bits arrive: set serial_driver.protocol: binary"
    assert explain(parser).startswith(said)


@pytest.mark.parametrize("protocol_name", PROTOCOLS[:2])
def test_a_wrong_baud_rate_is_named(protocol_name):
    """As a UART makes of bits that it samples at another rate: any bytes."""
    parser = make_parser(protocol_name, 2, 3, 10)
    rng = np.random.default_rng(1)
    for _ in range(20):
        parser.feed(rng.integers(0, 256, 40).astype(np.uint8).tobytes())
    assert "is serial_driver.baud that of the board's sketch?" in explain(parser)


def test_an_endless_line_is_not_kept():
    """Its end belongs to it as well, and the line after it is read again."""
    parser, fed = text_parser(), 0
    for _ in range(200):
        assert parser.feed(b"1,2,3,4,5,6,") == []
        fed += 12
        assert len(parser._buffer) <= 24 * 6 + 256
    assert parser.feed(line(STEPS)) == []
    assert len(parser.feed(line(STEPS))) == 1
    assert parser.counters.skipped_bytes == fed + len(line(STEPS))
    assert parser.counters.corrupt == 0


# --- choice -----------------------------------------------------------------------------------


def test_a_parser_is_chosen_by_name():
    assert isinstance(make_parser("binary", 2, 3, 10), BinaryParser)
    text = make_parser("text", 2, 3, 12)
    assert (text.rows, text.cols, text.adc_bits) == (2, 3, 12)
    with pytest.raises(ValueError, match=r"protocol 'morse': must be one of binary, text, packets"):
        make_parser("morse", 2, 3, 10)
