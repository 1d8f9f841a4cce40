# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin flash`: the real avrdude, and a boot loader on a pseudo-terminal."""

import os
import struct
import threading
import tty

import pytest
from support.chips import needs_avrdude

from tactile_skin import cli
from tactile_skin.board import description
from tactile_skin.board.firmware import build
from tactile_skin.board.protocol import VERSION, crc16

pytestmark = pytest.mark.live

ATMEGA328P, ATMEGA2560 = 0x1E950F, 0x1E9801
OK, END, IN_SYNC = b"\x10", b"\x20", b"\x14"  # of the STK500 protocol, version 1


class BootLoader:
    """What Optiboot answers (STK500 version 1), and the firmware that runs after it.

    Attributes:
        flash: what was written.
    """

    def __init__(self, signature: int):
        self.signature = signature.to_bytes(3, "big")
        self.flash = bytearray(b"\xff" * 32768)
        self._at = 0
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self):
        os.write(self._slave, b"\xff")  # ends the loop, if nobody has the port open
        self._thread.join(5.0)
        os.close(self._slave)
        os.close(self._master)

    def _take(self, n: int) -> bytes:
        data = b""
        while len(data) < n:
            data += os.read(self._master, n - len(data))
        return data

    def _serve(self):
        lengths = {0x41: 1, 0x42: 20, 0x45: 5, 0x55: 2, 0x56: 4, 0x74: 3}
        while True:
            code = self._take(1)[0]
            if code == 0xFF:
                return
            if code == description.COMMAND_MAGIC:
                self._take(4)
                os.write(self._master, described())
                continue
            if code == 0x64:
                size = int.from_bytes(self._take(2), "big")
                data = self._take(1 + size)[1:]
                self.flash[self._at : self._at + size] = data
                answer = b""
            else:
                given = self._take(lengths.get(code, 0))
                answer = self._answer(code, given)
            assert self._take(1) == END
            os.write(self._master, IN_SYNC + answer + OK)

    def _answer(self, code: int, given: bytes) -> bytes:
        if code == 0x55:
            self._at = 2 * int.from_bytes(given, "little")
        if code == 0x74:
            return bytes(self.flash[self._at : self._at + int.from_bytes(given[:2], "big")])
        return {0x41: b"\x03", 0x56: b"\0", 0x75: self.signature}.get(code, b"")


def described() -> bytes:
    body = description._BODY.pack(description.MAGIC, VERSION, 1, 16, 16, 10, 6, 100, 3, 2590, 1)
    return body + struct.pack("<H", crc16(body))


@pytest.fixture
def board(request):
    loader = BootLoader(getattr(request, "param", ATMEGA328P))
    yield loader
    loader.close()


@needs_avrdude
def test_the_image_is_written_and_the_board_asked(board, capsys, tmp_path):
    assert cli.main(["flash", f"port:={board.port}"]) == 0
    image = build.hex_file(build.firmware(tmp_path)).read_text()
    data = b"".join(bytes.fromhex(line[9:-2]) for line in image.split() if line[7:9] == "00")
    assert bytes(board.flash[: len(data)]) == data
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if not line.startswith(" ")] == [
        "compiling the firmware for 16 x 16",
        f"reading the signature of the chip on {board.port}; nothing is written yet",
        "writing the firmware over the present program, and reading it back",
        "asking the board what it is",
    ]
    assert "ATmega328P, boot loader at 115200 baud" in lines[3]
    assert "firmware 1, 16 x 16" in lines[-1]


@needs_avrdude
@pytest.mark.parametrize("board", [ATMEGA2560], indirect=True)
def test_another_chip_is_never_written(board, capsys):
    assert cli.main(["flash", f"port:={board.port}"]) == 2
    assert "signature is 0x1e9801, the firmware is for ATmega328P" in capsys.readouterr().err
    assert set(board.flash) == {0xFF}
