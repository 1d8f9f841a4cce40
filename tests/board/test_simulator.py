# SPDX-License-Identifier: Apache-2.0
"""The simulated board: what the ATmega328P does, and the real bytes on a real serial device."""

import os
import threading
import time

import numpy as np
import pytest
import serial
from support.simulated import CIRCUIT, make_board, serving

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.board import terminal
from tactile_skin.board.formats import make_parser
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.physics.adc import Adc
from tactile_skin.simulation import matrix, scenes, simulator


def frames_of(simulated, scans: int) -> list:
    parser = BinaryParser()
    frames = [f for _ in range(scans) for f in parser.feed(simulated.scan())]
    assert parser.counters.skipped_bytes == 0
    return frames


# --- the electronics ---


@pytest.mark.parametrize("rate", [1, 50, 99.5, 390])
def test_the_frame_rate_is_kept(rate):
    frames = frames_of(make_board(frames_per_second=rate), 2 * simulator.SCANS_PER_SECOND)
    assert len(frames) == int(2 * rate)


def test_device_time_is_that_of_the_scan():
    """In microseconds since the start; frames come with whole scans, 10 ms apart on average."""
    frames = frames_of(make_board(), simulator.SCANS_PER_SECOND)
    times = [f.device_time_us for f in frames]
    assert times[-1] == 1_000_000
    scan = 1e6 / simulator.SCANS_PER_SECOND
    assert times == [round(round(t / scan) * scan) for t in times]
    assert set(np.round(np.diff(times) / scan)) <= {3, 4}


@pytest.mark.parametrize("scene", ["idle", "two_fingers"])
@pytest.mark.parametrize("adc_bits", [8, 10, 12])
def test_without_noise_it_sends_the_forward_models_reading(scene, adc_bits):
    """To half an ADC step for its rounding, and less than a step for that of the low-pass."""
    circuit = Circuit(6, 7, adc_bits=adc_bits)
    simulated = make_board(scene, circuit, noise=0.0)
    frame = frames_of(simulated, 40)[-1]
    assert frame.adc_bits == adc_bits
    force = scenes.script(scene, *circuit.shape)(0.0)
    steps = forward(circuit, simulated.curve.resistance(force)) * circuit.full_scale
    sent = frame.samples / 2 ** (16 - adc_bits)
    assert np.abs(sent - np.rint(steps)).max() < 0.5
    assert np.abs(sent - steps).max() <= 1.0


def test_its_cells_differ_at_rest():
    """As those of every fabric do; one voltage for all is what a board without a matrix reads."""
    simulated = make_board(circuit=Circuit(16, 16), seed=3)
    scatter = np.log(simulated.curve.rest_resistance / PressureCurve().rest_resistance)
    assert scatter.std() == pytest.approx(matrix.REST_SCATTER, rel=0.2)
    pressed = simulated.curve.resistance(5.0) / PressureCurve().resistance(5.0)
    assert np.abs(pressed - 1.0).max() < 0.01


@pytest.mark.parametrize(
    "wired",
    [
        {"readout": "loaded", "driven": "columns", "inverted": True},
        {"readout": "loaded", "diode": 0.58},
        {"readout": "grounded", "r_drive": 40.0, "offset": -20.0},
        {"full_scale": 676.0},
    ],
)
def test_it_is_wired_as_the_configuration_says(wired):
    """What `Adc` makes of its counts is the circuit's reading, within rounding."""
    of_adc = {k: wired.pop(k) for k in [*wired] if k not in ("readout", "driven", "r_drive")}
    circuit = Circuit(6, 8, **wired)
    adc, force = Adc(circuit, **of_adc), scenes.script("two_fingers", 6, 8)(0.0)
    simulated = simulator.Board(
        circuit, PressureCurve(), lambda t: force, noise=0.0, frames_per_second=390, adc=adc
    )
    ratio = forward(circuit, simulated.curve.resistance(force))
    sent = frames_of(simulated, 40)[-1].samples
    # rounded to whole steps, and by the low-pass; below 20 steps the offset leaves nothing
    seen = np.maximum(adc.count(ratio), 0.0)
    np.testing.assert_allclose(sent / 64, seen, atol=0.6)
    shown = adc.count(ratio) > 1.0
    step = 0.7 / adc.full_scale
    np.testing.assert_allclose(adc.ratio_of(sent)[shown], ratio[shown], atol=1.3 * step)


def test_the_low_pass_follows_a_step():
    """5 scans after a finger came, nine tenths of it are there; and nothing overshoots."""
    circuit = CIRCUIT

    def scene(t):
        pressed = t > 9.5 / simulator.SCANS_PER_SECOND
        return np.full(circuit.shape, 1.0 if pressed else 0.0)

    simulated = simulator.Board(circuit, PressureCurve(), scene, noise=0.0, frames_per_second=390)
    level = np.array([f.samples.mean() for f in frames_of(simulated, 60)])
    rise = (level - level[0]) / (level[-1] - level[0])
    assert rise[9] == 0.0
    assert rise[10] == pytest.approx(3 / 8, abs=0.01)
    assert rise[14] > 0.9
    assert (np.diff(rise) >= 0).all()


def test_the_low_passs_noise_is_that_of_a_mean_of_4_scans():
    """Half of a sample's; the sample's is the given noise with the ADC's rounding."""
    simulated = make_board(noise=2.0, circuit=Circuit(8, 8), frames_per_second=390)
    sent = np.array([f.samples / 64 for f in frames_of(simulated, 1500)[20:]])
    of_a_sample = np.hypot(2.0, 1 / np.sqrt(12))
    assert sent.std(0).mean() == pytest.approx(of_a_sample / 2, rel=0.05)


def test_a_restart_begins_anew():
    """With sequence 0, time 0, and nothing left in the low-pass."""
    simulated = make_board("two_fingers", noise=0.0)
    before = b"".join(simulated.scan() for _ in range(50))
    simulated.restart()
    assert b"".join(simulated.scan() for _ in range(50)) == before


def test_a_board_that_prints_sends_the_same_readings_in_whole_steps():
    boards = [make_board("two_fingers", Circuit(6, 7), kind=kind) for kind in simulator.SPOKEN]
    binary, text = (make_parser(kind, 6, 7, 10) for kind in simulator.SPOKEN)
    for _ in range(50):
        sent = [b.scan() for b in boards]
        numbers = binary.feed(sent[0])
        printed = text.feed(sent[1])
        if printed:  # not the first: a reader may have come in the middle of a line
            np.testing.assert_array_equal(printed[0].samples, numbers[0].samples >> 6 << 6)
    assert text.counters.frames == binary.counters.frames - 1 > 10
    assert text.counters.corrupt == 0


# --- on a pseudo-terminal ---


def read_frames(port, n: int, parser: BinaryParser) -> list:
    """At least n frames; ends without them only when the port stays silent for its timeout."""
    frames = []
    while len(frames) < n:
        data = port.read(port.in_waiting or 1)
        assert data, f"silent after {len(frames)} frames"
        frames += parser.feed(data)
    return frames


@pytest.mark.live
def test_a_reader_gets_whole_frames_in_order(tmp_path):
    """Through pyserial, as from a real port; a second opening restarts the board."""
    parser = BinaryParser()
    with serving(tmp_path / "skin") as served:
        for restarts in (0, 1):
            with serial.Serial(str(tmp_path / "skin"), simulator.BAUD, timeout=30) as port:
                frames = read_frames(port, 40, parser)
            first = frames[0].sequence
            assert [f.sequence for f in frames] == list(range(first, first + len(frames)))
            assert {f.samples.shape for f in frames} == {CIRCUIT.shape}
            assert parser.counters.restarts == restarts
            served.let_it_notice()
    assert (parser.counters.corrupt, parser.counters.lost) == (0, 0)


@pytest.mark.live
def test_bytes_from_the_reader_do_no_harm(tmp_path):
    """The board takes no commands, and must not stop for what is written to it."""
    with (
        serving(tmp_path / "skin"),
        serial.Serial(str(tmp_path / "skin"), simulator.BAUD, timeout=30, write_timeout=30) as port,
    ):
        for _ in range(20):
            port.write(bytes(1000))
        assert len(read_frames(port, 5, BinaryParser())) >= 5


@pytest.mark.live
def test_a_link_left_behind_is_replaced(tmp_path):
    """By a board that was killed, say."""
    link = tmp_path / "skin"
    link.symlink_to("/dev/pts/999999")
    with serving(link):
        assert link.exists()


@pytest.mark.parametrize("later", ["its own", "another"])
def test_the_link_of_a_killed_board_is_replaced_though_a_later_pty_has_its_number(tmp_path, later):
    link, open_now = tmp_path / "skin", ()
    master, slave = os.openpty()
    link.symlink_to(os.ttyname(slave))
    os.utime(link, (1.0, 1.0), follow_symlinks=False)  # long ago
    if later == "another":
        open_now = master, slave
    else:
        os.close(slave)
        os.close(master)
    with terminal.open_terminal(link):
        assert (os.readlink(link) != os.ttyname(slave)) if open_now else link.exists()
    for number in open_now:
        os.close(number)


def test_the_link_to_a_pty_that_is_open_stays(tmp_path):
    link = tmp_path / "skin"
    with terminal.open_terminal(link), pytest.raises(FileExistsError, match="made by somebody"):
        terminal.open_terminal(link).__enter__()


@pytest.mark.live
def test_a_link_that_another_board_took_over_stays(tmp_path):
    link = tmp_path / "skin"
    with serving(link):
        link.unlink()
        link.symlink_to("another")
    assert os.readlink(link) == "another"


@pytest.mark.live
@pytest.mark.parametrize("make", ["write_text", "mkdir"])
def test_what_is_no_link_is_not_replaced(tmp_path, make):
    link = tmp_path / "skin"
    getattr(link, make)(*(["precious"] if make == "write_text" else []))
    with pytest.raises(FileExistsError, match="skin exists and is no link: remove it"):
        simulator.serve(make_board(), link, lambda: False)
    assert link.exists()


@pytest.mark.live
@pytest.mark.parametrize("there", [True, False])
def test_a_link_of_somebody_else_is_neither_replaced_nor_removed(tmp_path, there):
    """Also while it leads nowhere, as that of a device that is not plugged in."""
    link, device = tmp_path / "skin", tmp_path / "ttyUSB0"
    if there:
        device.touch()
    link.symlink_to(device)
    with pytest.raises(FileExistsError, match=f"skin exists and is a link to {device}"):
        simulator.serve(make_board(), link, lambda: False)
    assert os.readlink(link) == str(device)


@pytest.mark.live
def test_a_board_that_serves_once_ends_when_its_reader_has_left(tmp_path, monkeypatch):
    monkeypatch.setattr(terminal, "_LEFT_FOR", 0.05)
    link = tmp_path / "skin"
    serving = threading.Thread(
        target=simulator.serve, args=(make_board(), link, lambda: True), kwargs={"once": True}
    )
    serving.start()
    while not link.exists():
        time.sleep(0.01)
    time.sleep(0.2)
    assert serving.is_alive()  # nobody has come yet
    with open(link, "rb", buffering=0) as port:
        assert port.read(1)
        assert serving.is_alive()
    serving.join(20.0)
    assert not serving.is_alive()
    assert not link.is_symlink()
