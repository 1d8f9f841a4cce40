# SPDX-License-Identifier: Apache-2.0
"""The reader of a serial port: whatever happens to the port, it goes on, and says so."""

import contextlib
import errno
import os
import threading
import time
import tty

import pytest
import serial
from serial.tools.list_ports_common import ListPortInfo
from support.patience import PATIENCE
from support.simulated import CIRCUIT, Serving, make_board, serving

from tactile_skin import Circuit
from tactile_skin.board import serial_port
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.board.serial_port import SerialReader, check_port, open_port

pytestmark = pytest.mark.live


class Heard:
    """What a reader delivers and says, to be waited for."""

    def __init__(self):
        self.frames, self.lines = [], []
        self._news = threading.Condition()

    def on_frame(self, frame) -> None:
        with self._news:
            self.frames.append(frame)
            self._news.notify_all()

    def say(self, line: str) -> None:
        with self._news:
            self.lines.append(line)
            self._news.notify_all()

    def wait_for(self, condition) -> None:
        with self._news:
            assert self._news.wait_for(condition, PATIENCE), self.lines

    def wait_for_frames(self, more: int = 10) -> None:
        wanted = len(self.frames) + more
        self.wait_for(lambda: len(self.frames) >= wanted)

    def wait_for_line(self, text: str) -> None:
        self.wait_for(lambda: any(text in line for line in self.lines))


@pytest.fixture
def heard():
    return Heard()


@pytest.fixture
def reading(heard):
    """A function that starts a reader on a port; it is closed after the test."""
    readers = []

    def start(port, **kwargs) -> SerialReader:
        reader = SerialReader(
            str(port), 1_000_000, BinaryParser, heard.on_frame, heard.say, **kwargs
        )
        readers.append(reader)
        reader.start()
        return reader

    yield start
    for reader in readers:
        reader.close()


@pytest.fixture
def line(tmp_path):
    """Both ends of a serial line, and the name of ours."""
    master, slave = os.openpty()
    tty.setraw(slave)
    link = tmp_path / "line"
    link.symlink_to(os.ttyname(slave))
    yield master, slave, link
    for end in (master, slave):
        with contextlib.suppress(OSError):  # it is closed
            os.close(end)


@pytest.fixture
def silent_port(line):
    """A port that is there, and says nothing."""
    return line[2]


def test_frames_arrive(tmp_path, heard, reading):
    with serving(tmp_path / "skin"):
        reader = reading(tmp_path / "skin")
        heard.wait_for_frames(30)
        assert reader.connected_to == str(tmp_path / "skin")
        assert (reader.trouble, reader.reconnects) == ("", 0)
        reader.close()
    assert heard.lines == [f"frames arrive on {tmp_path / 'skin'}"]
    first = heard.frames[0].sequence
    assert [f.sequence for f in heard.frames] == list(range(first, first + len(heard.frames)))
    assert {f.samples.shape for f in heard.frames} == {CIRCUIT.shape}
    assert reader.parser.counters.corrupt == 0


def test_an_unplugged_board_is_found_again(tmp_path, heard, reading):
    """Counted and said; the counters of the whole run go on."""
    link = tmp_path / "skin"
    served = Serving(link)
    reader = reading(link)
    try:
        heard.wait_for_frames()
    finally:
        served.unplug()
    heard.wait_for(lambda: reader.connected_to is None)
    heard.wait_for(lambda: len(heard.lines) >= 2)
    assert reader.trouble.startswith(f"port {link} ")
    before = len(heard.frames)
    with serving(link):
        heard.wait_for_frames()
        assert reader.connected_to == str(link)
        assert reader.reconnects == 1
        assert reader.trouble == ""
        reader.close()
    assert heard.lines.count(f"frames arrive on {link}") == 2
    assert reader.parser.counters.frames == len(heard.frames) > before


@pytest.mark.parametrize("error", [serial.SerialException("gone"), OSError(5, "gone"), "termios"])
def test_whatever_a_vanished_port_raises_is_survived(monkeypatch, heard, reading, error):
    """pyserial lets all of these through, depending on where it was when the port went."""
    if error == "termios":
        error = pytest.importorskip("termios").error(5, "gone")
    opened_again = threading.Event()

    def open_port(*_, **__):
        if not heard.lines:
            return Dying(error)
        opened_again.set()
        return serial.Serial()  # one that is not open: reading it fails as well

    monkeypatch.setattr(serial, "serial_for_url", open_port)
    reading("/dev/ttyTEST")
    heard.wait_for_line("port /dev/ttyTEST")
    assert "gone" in heard.lines[0]
    assert opened_again.wait(PATIENCE)


class Dying:
    """A port that fails when it is read."""

    name, in_waiting = "/dev/ttyTEST", 0

    def __init__(self, error):
        self._error = error

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def reset_input_buffer(self):
        pass

    def read(self, n):
        raise self._error


def test_a_port_that_is_lent_is_read_again_once_it_is_free(tmp_path, heard, reading, monkeypatch):
    monkeypatch.setattr(serial_port, "_LENT", 0.3)
    link = str(tmp_path / "skin")
    with serving(tmp_path / "skin"):
        reader = reading(link)
        heard.wait_for_frames()
        with pytest.raises(ValueError, match="in use by another program"):
            open_port(link, 1_000_000)
        reader.lend()
        heard.wait_for_line(f"port {link} is lent to another program")
        with open_port(link, 1_000_000):
            time.sleep(0.5)
            assert reader.connected_to is None and "is lent" in reader.trouble
        heard.wait_for(lambda: heard.lines.count(f"frames arrive on {link}") == 2)
        assert reader.reconnects == 1
        reader.close()


def test_a_line_that_is_open_already_is_read_and_left_open(tmp_path, heard, reading):
    """As a page reads a board that the skin has lent it; that the board has gone is said once."""
    link = str(tmp_path / "skin")
    served = Serving(tmp_path / "skin")
    with open_port(link, 1_000_000) as line:
        reader = reading(link, line=line)
        heard.wait_for_frames()
        reader.close()
        assert line.is_open
        reader = reading(link, line=line)
        heard.wait_for(lambda: reader.connected_to == link)
        served.unplug()
        heard.wait_for(lambda: reader.connected_to is None)
        assert reader.trouble.startswith(f"port {link}")
        assert line.is_open


def test_a_silent_port_is_opened_anew(silent_port, heard, reading):
    """By the watchdog; that it never sent is said, and no connection is counted."""
    reader = reading(silent_port, watchdog=0.02)
    heard.wait_for_line(f"{silent_port}: no bytes for 0.02 s, reopening it")
    assert reader.connected_to is None
    assert reader.reconnects == -1


class Restarting:
    """A port whose board begins anew when it is opened, and takes its time; as of pyserial."""

    openings = 0
    name = portstr = "/dev/board"
    in_waiting = 1

    def __init__(self, boot: float):
        self._sends, self._board = time.monotonic() + boot, make_board()
        Restarting.openings += 1

    def reset_input_buffer(self): ...

    def read(self, _):
        time.sleep(0.005)
        return self._board.scan() if time.monotonic() > self._sends else b""


@pytest.mark.parametrize("boot", [0.05, 0.5])
def test_a_board_that_restarts_as_it_is_opened_is_waited_for(boot, monkeypatch, heard, reading):
    """It was opened, and so restarted, after each watchdog, for ever; then after 3, 6, 12, 24 s."""
    Restarting.openings = 0
    opened = lambda name, baud: contextlib.nullcontext(Restarting(boot))  # noqa: E731
    monkeypatch.setattr(serial_port, "_opened", opened)
    monkeypatch.setattr(serial_port, "is_simulated", lambda port: False)
    reading("/dev/board", watchdog=0.1)
    heard.wait_for_frames()
    assert Restarting.openings <= 2


def test_garbage_is_silence_to_the_watchdog(line, heard, reading):
    """A port that sends, but no frame, is no board."""
    reading(line[2], watchdog=0.02)
    while not heard.lines:
        os.write(line[0], b"hello ")
        time.sleep(0.005)
    heard.wait_for_line("bytes arrive, but no frame: check serial_driver.baud and")
    assert heard.frames == []


def test_a_missing_port_is_waited_for(tmp_path, heard, reading):
    """Said once, not with every attempt; when the board is plugged in, its frames come."""
    link = tmp_path / "later"
    reader = reading(link)
    heard.wait_for_line("does not exist")
    assert reader.connected_to is None
    with serving(link):
        heard.wait_for_frames()
        reader.close()
    assert heard.lines == [f"port {link} does not exist", f"frames arrive on {link}"]
    assert reader.reconnects == 0


def test_a_port_may_take_its_time_without_a_word(tmp_path, heard, reading):
    reader = reading(tmp_path / "later", wait=3600.0)
    assert reader.trouble == f"waiting for {tmp_path / 'later'}"
    with serving(tmp_path / "later"):
        heard.wait_for_frames()
        reader.close()
    assert heard.lines == [f"frames arrive on {tmp_path / 'later'}"]


@pytest.mark.parametrize("relative", [False, True])
def test_a_port_is_ours_alone_by_whatever_path(silent_port, relative):
    """A relative one was shared: each reader got half of the bytes."""
    name = os.path.relpath(silent_port) if relative else str(silent_port)
    with open_port(name, 115200), pytest.raises(ValueError, match="in use by another program"):
        open_port(str(silent_port), 115200)


def test_a_port_in_use_is_said_to_be(silent_port, heard, reading):
    """Two readers would get half of the bytes each; when the other one leaves, this one goes on."""
    with serial.Serial(str(silent_port), exclusive=True):
        reader = reading(silent_port, watchdog=0.02)
        heard.wait_for_line(
            f"port {silent_port} is in use by another program (two programs cannot read one board)"
        )
        assert len(heard.lines) == 1
    heard.wait_for_line("no bytes for 0.02 s")
    assert reader.connected_to is None


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.EBUSY, "is in use by another program"),
        (errno.EACCES, "may not be opened by this user: is it in the group dialout?"),
        (errno.EPERM, "may not be opened by this user: is it in the group dialout?"),
        (errno.ENXIO, "is gone: was the board unplugged?"),
        (errno.EMFILE, os.strerror(errno.EMFILE)),
    ],
)
def test_what_keeps_a_port_from_being_opened_is_said(monkeypatch, heard, reading, number, said):
    def refuse(*_, **__):
        raise serial.SerialException(number, "could not open port")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    reading("/dev/ttyTEST")
    heard.wait_for_line(said)
    assert heard.lines[0].startswith("port /dev/ttyTEST")


NO_PORTS = {  # what is there -> what is said of it
    "directory": "is a directory, not a serial device",
    "file": "is a regular file, not a serial device",
    "fifo": "is not a device, not a serial device",
    "/dev/null": "is not a serial device",
}


def no_port(tmp_path, kind):
    path = tmp_path / kind.strip("/").replace("/", "_")
    if kind == "directory":
        path.mkdir()
    elif kind == "fifo":
        os.mkfifo(path)
    else:
        path.symlink_to(kind) if kind.startswith("/") else path.touch()
    return path


@pytest.mark.parametrize("kind", NO_PORTS)
def test_what_is_no_serial_device_is_said_to_be_none(tmp_path, heard, reading, kind):
    """And refused at the start, but for a device."""
    path = no_port(tmp_path, kind)
    reading(path)
    heard.wait_for_line(f"port {path} {NO_PORTS[kind]}")
    if not kind.startswith("/"):
        with pytest.raises(ValueError, match=f"port {path}: {NO_PORTS[kind]}"):
            check_port(str(path))


def test_a_hangup_is_called_one(line, heard, reading):
    """However pyserial tells it: here as a port that can be read and gives nothing."""
    master, slave, link = line
    reader = reading(link, watchdog=PATIENCE)
    while not reader.parser.counters.skipped_bytes:  # it reads
        os.write(master, b"hello ")
        time.sleep(0.005)
    os.close(slave)
    os.close(master)
    heard.wait_for_line(f"port {link} is gone: was the board unplugged?")


def test_auto_takes_the_first_port_that_sends_frames(
    tmp_path, monkeypatch, silent_port, heard, reading
):
    """Not the first that is there."""
    ports = [str(tmp_path / "gone"), str(silent_port), str(tmp_path / "skin")]
    monkeypatch.setattr(serial_port, "candidates", lambda *_: ports)
    with serving(tmp_path / "skin"):
        reader = reading("auto", watchdog=0.5)
        heard.wait_for_frames()
        assert reader.connected_to == ports[2]
        reader.close()


class Sockets:
    """USB sockets of a computer, and the boards in them.

    Attributes:
        boards: device -> (identity, parameters of its circuit).
    """

    def __init__(self, folder, monkeypatch):
        self._folder, self._served = folder, {}
        self.boards = {}
        monkeypatch.setattr(serial_port, "candidates", lambda *_: sorted(self.boards))
        monkeypatch.setattr(
            serial_port, "identity", lambda name: self.boards.get(name, ((name,),))[0]
        )

    def plug(self, name, board=("1a86", "7523", "A"), circuit=CIRCUIT) -> str:
        link = self._folder / name
        self._served[str(link)] = Serving(link, make_board(circuit=circuit))
        self.boards[str(link)] = (board, circuit)
        return str(link)

    def unplug(self, link) -> None:
        del self.boards[link]
        self._served.pop(link).unplug()


@pytest.fixture
def sockets(tmp_path, monkeypatch):
    sockets = Sockets(tmp_path, monkeypatch)
    yield sockets
    for link in list(sockets.boards):
        sockets.unplug(link)


def refuse(frame) -> str:
    """As the driver does."""
    wanted = CIRCUIT.shape
    return "" if frame.samples.shape == wanted else f"sends {frame.samples.shape}, not {wanted}"


def test_auto_leaves_a_board_of_another_size_for_the_next_port(sockets, heard, reading):
    """Named, and once for all the times that it is looked at."""
    other = sockets.plug("a", ("1a86", "7523", "B"), Circuit(4, 6))
    reader = reading("auto", refuse=refuse)
    heard.wait_for_line(f"{other}: sends (4, 6), not (4, 5)")
    assert reader.connected_to is None
    assert heard.frames == []
    own = sockets.plug("b")
    heard.wait_for_frames()
    assert reader.connected_to == own
    assert {f.samples.shape for f in heard.frames} == {(4, 5)}
    reader.close()
    assert heard.lines == [f"{other}: sends (4, 6), not (4, 5)", f"frames arrive on {own}"]


def test_auto_takes_no_other_board_while_its_own_is_unplugged(sockets, heard, reading):
    """It may sit elsewhere on the robot; the same one is found again in another socket."""
    own = sockets.plug("a")
    reader = reading("auto", refuse=refuse)
    heard.wait_for_frames()
    other = sockets.plug("b", ("1a86", "7523", "B"))
    sockets.unplug(own)
    heard.wait_for_line("the board is unplugged; other boards are not used")
    already = len(heard.frames)
    time.sleep(0.6)  # two looks
    assert reader.connected_to is None
    assert reader.trouble == "the board is unplugged; other boards are not used"
    assert len(heard.frames) == already
    again = sockets.plug("c")
    heard.wait_for_frames()
    assert reader.connected_to == again
    assert reader.reconnects == 1
    reader.close()
    assert f"frames arrive on {other}" not in heard.lines
    assert heard.lines[-1] == f"frames arrive on {again}"


def there(device, number, where):
    """Return a port on USB."""
    port = ListPortInfo(device)
    port.vid, port.pid, port.serial_number, port.location = 0x1A86, 0x7523, number, where
    return port


def test_of_two_boards_the_one_of_the_given_number_or_socket_is_taken(monkeypatch):
    ports = [there("/dev/ttyUSB0", "A", "1-1"), there("/dev/ttyUSB1", None, "1-2")]
    monkeypatch.setattr(serial_port.list_ports, "comports", lambda: ports)
    assert serial_port.candidates("A") == ["/dev/ttyUSB0"]
    assert serial_port.candidates("1-2") == ["/dev/ttyUSB1"]
    with pytest.raises(ValueError, match="no USB board has serial_number B; there are: A, 1-2"):
        serial_port.check_port("auto", "B")


@pytest.mark.parametrize(
    ("serial_number", "location", "same"),
    [("A", "1-2", True), ("B", "1-1", False), (None, "1-1", True), (None, "1-2", False)],
)
def test_a_board_is_known_by_its_number_or_else_by_its_socket(
    monkeypatch, serial_number, location, same
):
    first = there("/dev/ttyUSB0", "A" if serial_number else None, "1-1")
    later = there("/dev/ttyUSB3", serial_number, location)
    monkeypatch.setattr(serial_port.list_ports, "comports", lambda: [first])
    before = serial_port.identity("/dev/ttyUSB0")
    monkeypatch.setattr(serial_port.list_ports, "comports", lambda: [later])
    assert serial_port.candidates() == ["/dev/ttyUSB3"]
    assert (serial_port.identity("/dev/ttyUSB3") == before) is same


def test_what_is_not_on_usb_is_known_by_its_name(monkeypatch):
    monkeypatch.setattr(serial_port.list_ports, "comports", lambda: [ListPortInfo("/dev/ttyS0")])
    assert serial_port.candidates() == []
    assert serial_port.identity("/dev/ttyS0") == ("/dev/ttyS0",)


def test_ports_that_cannot_be_listed_end_nothing(sockets, monkeypatch, heard, reading):
    def fail(*_):
        raise OSError("a port went")

    monkeypatch.setattr(serial_port, "candidates", fail)
    reader = reading("auto")
    heard.wait_for_line("the serial ports cannot be listed: OSError('a port went')")
    sockets.plug("a")
    monkeypatch.setattr(serial_port, "candidates", lambda *_: sorted(sockets.boards))
    heard.wait_for_frames()
    reader.close()


def test_who_raises_when_he_is_told_ends_no_reading(tmp_path, heard, capsys):
    """A log handler, say: the board is found, lost, and found again."""
    errors = RuntimeError("full"), SystemExit(1)

    def say(line):
        heard.say(line)
        raise errors[len(heard.lines) % 2]

    reader = SerialReader(str(tmp_path / "skin"), 1_000_000, BinaryParser, heard.on_frame, say)
    reader.start()
    try:
        heard.wait_for_line("does not exist")
        for _ in range(2):
            with serving(tmp_path / "skin"):
                heard.wait_for_frames()
            heard.wait_for(lambda: reader.connected_to is None)
    finally:
        reader.close()
    said = capsys.readouterr().err
    assert all(f"{error!r} while that was reported" in said for error in errors)


def test_auto_without_ports_says_so(monkeypatch, heard, reading):
    monkeypatch.setattr(serial_port, "candidates", lambda *_: [])
    reading("auto")
    heard.wait_for_line("no USB serial port found")
    with pytest.raises(ValueError, match="port auto: no USB serial port found"):
        check_port("auto")


# --- check_port ---


def test_a_missing_port_is_refused_by_name(monkeypatch, tmp_path):
    monkeypatch.setattr(serial_port, "candidates", lambda *_: ["/dev/ttyUSB3"])
    port = tmp_path / "ttyUSB0"
    with pytest.raises(ValueError, match=f"port {port}: does not exist.*found: /dev/ttyUSB3"):
        check_port(str(port))


def test_a_port_that_is_there_is_taken(monkeypatch, line):
    """So is auto with a candidate, and a URL that pyserial knows."""
    monkeypatch.setattr(serial_port, "candidates", lambda *_: ["/dev/ttyUSB3"])
    for port in (str(line[2]), "auto", "loop://"):
        check_port(port)
