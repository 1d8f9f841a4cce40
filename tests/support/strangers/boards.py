# SPDX-License-Identifier: Apache-2.0
"""What strangers' sketches print of a picture, and what a UART makes of it at another rate."""

import binascii
import struct
import zlib
from bisect import bisect_left

import numpy as np


def _joined(values, separator=",") -> str:
    return separator.join(map(str, values))


def frame_a_line(a, k, separator=",", end="\r\n") -> str:
    return _joined(a.ravel(), separator) + end


def counter_in_front(a, k) -> str:
    return f"{1000 + 20 * k},{_joined(a.ravel())}\r\n"


def time_and_class(a, k) -> str:
    at, label = f"12:03:{k // 20 % 60:02d}.{k % 20 * 50:03d}", ["none", "fist"][k // 9 % 2]
    return f"{at},{_joined(a.ravel())},{label}\n"


def bracketed(a, k) -> str:
    return "[" + ", ".join("[" + ", ".join(map(str, row)) + "]" for row in a) + "]\n"


def labelled(a, k) -> str:
    return " ".join(f"S{i}:{v}" for i, v in enumerate(a.ravel())) + "\n"


def json_line(a, k) -> str:
    return f'{{"t":{17 * k + 5},"data":[{_joined(a.ravel())}]}}\n'


def nested_json(a, k) -> str:
    rows = ", ".join(f"[{_joined(row, ', ')}]" for row in a)
    return f'{{"n": {k}, "skin": {{"rows": [{rows}]}}, "volt": 3.7{k % 9}, "ok": 1}}\n'


def json_lines(a, k) -> str:
    rows = ",\r\n".join(f'"row{i}": [{_joined(row)}]' for i, row in enumerate(a))
    return '{\r\n"FSR": {\r\n' + rows + "\r\n}\r\n}\r\nEND\r\n"


def row_a_line(a, k, separator="   ", behind="\r\n") -> str:
    return "".join(_joined(row, separator) + separator + "\r\n" for row in a) + behind


def on_a_terminal(a, k) -> str:
    """It is cleared, the cursor goes home, and what is pressed is red."""
    lines = (_joined((f"\x1b[31m{v}\x1b[0m" if v > 400 else v for v in row), "\t") for row in a)
    return "\x1b[2J\x1b[H" + "".join(f"{line}\r\n" for line in lines)


def rows_under_a_heading(a, k) -> str:
    return f"Frame {k}\n" + "".join(_joined(row, "\t") + "\n" for row in a)


def rows_with_a_label(a, k) -> str:
    return "".join(f"Row {i}: {_joined(row, ' ')}\n" for i, row in enumerate(a))


def rows_with_a_word(a, k) -> str:
    return "".join(f"row {r} {_joined(row)}\n" for r, row in enumerate(a))


def clock_in_front(a, k) -> str:
    return f"12:{k // 60 % 60:02d}:{k % 60:02d} {_joined(a.ravel())}\r\n"


def rows_with_a_hash(a, k) -> str:
    return "".join(f"row #{r}: {_joined(row)}\n" for r, row in enumerate(a))


def rows_with_a_number(a, k) -> str:
    return "".join(f"{i},{_joined(row)}\n" for i, row in enumerate(a))


def numpy_print(a, k) -> str:
    return str(a) + "\n"


def index_value(a, k) -> str:
    return "".join(f"{i},{v}\r\n" for i, v in enumerate(a.ravel()))


def row_col_value(a, k) -> str:
    return "".join(f"{i},{j},{a[i, j]}\r\n" for i, j in np.ndindex(a.shape))


def cell_in_words(a, k) -> str:
    return "".join(f"R{i + 1}C{j + 1}: {a[i, j]}\n" for i, j in np.ndindex(a.shape))


def volts(a, k) -> str:
    return "".join(f"{v * 5.0 / 1023:.2f};" for v in a.ravel()) + "\r\n"


def millivolts(a, k) -> str:
    return ",".join(f"{v * 5000 / 1023:.0f}" for v in a.ravel()) + "\n"


def carriage_returns(a, k) -> str:
    return _joined(a.ravel(), " ") + "\r"


def angle_brackets(a, k) -> str:
    return f"<{_joined(a.ravel())}>"


def status_lines(a, k) -> str:
    link = f"--- link: server=OK, connected={k % 2} ---"
    return f"{_joined(a.ravel())}\r\n{link}\r\nmax: {a.max()}  fps: 20.{k % 9}\r\n"


TEXT = {
    f.__name__: f
    for f in (
        frame_a_line, counter_in_front, time_and_class, bracketed, labelled, json_line, json_lines,
        nested_json, row_a_line, on_a_terminal, rows_under_a_heading, rows_with_a_label,
        rows_with_a_number, numpy_print, rows_with_a_word, clock_in_front, rows_with_a_hash,
        index_value, row_col_value, cell_in_words, volts, millivolts, carriage_returns,
        angle_brackets, status_lines,
    )
}  # fmt: skip


def words(a, k) -> bytes:
    return b"\xff\xff" + a.astype("<u2").tobytes()


def words_with_a_sum(a, k) -> bytes:
    body = struct.pack("<HBB", 0xAA55, 1, k % 256) + (a // 4).astype("u1").tobytes()
    return body + struct.pack("<H", sum(body) & 0xFFFF)


def words_with_an_end(a, k) -> bytes:
    return b"\xa0" + a.astype(">u2").tobytes() + b"\xc0\x0d"


def packed(a, k) -> bytes:
    bits = "".join(f"{v:010b}" for v in a.ravel().tolist())
    bits += "0" * (-len(bits) % 8)
    return b"\x01" + bytes(int(bits[i : i + 8], 2) for i in range(0, len(bits), 8)) + b"\x00"


def slip_with_a_crc(a, k) -> bytes:
    body = bytes([k & 255]) + a.astype(">u2").tobytes()
    body += zlib.crc32(body).to_bytes(4, "little")
    return body.replace(b"\xdb", b"\xdb\xdd").replace(b"\xc0", b"\xdb\xdc") + b"\xc0"


def cobs_with_a_crc(a, k) -> bytes:
    body = b"\xa5" + a.astype("<u2").tobytes()
    parts = (body + binascii.crc_hqx(body, 0xFFFF).to_bytes(2, "big")).split(b"\0")
    return b"".join(bytes([len(part) + 1]) + part for part in parts) + b"\0"


PACKETS = {
    f.__name__: f
    for f in (words, words_with_a_sum, words_with_an_end, packed, slip_with_a_crc, cobs_with_a_crc)
}


def run_lengths(a, k) -> bytes:
    out, zeros = bytearray(), 0
    for value in np.where(a > np.median(a), a // 4, 0).ravel().tolist():
        if value == 0:
            zeros += 1
            continue
        out += bytes([0, zeros]) if zeros else b""
        out.append(min(value, 254))
        zeros = 0
    return bytes(out) + (bytes([0, zeros]) if zeros else b"") + b"\xff"


def sent(make, pictures, first=0) -> bytes:
    """The bytes of pictures, (n, rows, cols) ADC steps."""
    out = [make(a, first + k) for k, a in enumerate(pictures)]
    return b"".join(chunk.encode() if isinstance(chunk, str) else chunk for chunk in out)


def received(data: bytes, sent_at: int, read_at: int) -> bytes:
    """What a UART at `read_at` baud makes of bytes that are sent without a pause at `sent_at`.

    8N1: it waits for a falling edge, samples each bit in its middle, and takes a byte whose stop
    bit is wrong as it is, as Linux does.
    """
    bits = np.ones((len(data), 10), np.uint8)
    bits[:, 0] = 0
    bits[:, 1:9] = np.unpackbits(np.frombuffer(data, np.uint8)[:, None], axis=1, bitorder="little")
    line, heard, t, width = bits.ravel(), [], 0.0, sent_at / read_at
    falls = np.flatnonzero((line[:-1] == 1) & (line[1:] == 0)) + 1
    middles = width * (1.5 + np.arange(8))
    starts, k = falls.tolist(), 0
    while True:
        k = bisect_left(starts, t, k)
        if k == len(starts) or starts[k] + 10 * width >= len(line):
            break
        heard.append(starts[k])
        t = starts[k] + 9.5 * width
    at = (np.array(heard, int)[:, None] + middles).astype(int)
    return np.packbits(line[at], axis=1, bitorder="little").tobytes()
