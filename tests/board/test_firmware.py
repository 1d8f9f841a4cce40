# SPDX-License-Identifier: Apache-2.0
"""The firmware's binary on a simulated chip: what it sends, takes, and survives."""

import re
import subprocess
import threading

import numpy as np
import pytest
from support import chip as simulated
from support.chips import needs_both, needs_chip
from support.firmware import (
    BROWN_OUT,
    CURVE,
    STEPS,
    WATCHDOG,
    Chip,
    frames_of,
    on_both,
    resistance,
    steady,
    time_constant,
)
from support.marks import ci
from support.patience import PATIENCE

from tactile_skin import Circuit, compensate, forward, measure_rest
from tactile_skin.board import description
from tactile_skin.board.description import command, find_description
from tactile_skin.board.firmware import build
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.errors import FirmwareError
from tactile_skin.launch import launch, read_skin, share_dir
from tactile_skin.physics.adc import Adc
from tactile_skin.simulation import scenes
from tactile_skin.simulation.matrix import resting_curve

# --- the binary ---


@needs_chip
def test_it_compiles_without_a_warning(tmp_path):
    source = build.HERE / "firmware.c"
    run = [*build._COMPILE, *build._WARNINGS, "-Werror", source, "-o", tmp_path / "firmware.elf"]
    assert build.run(run, "") == ""


@needs_chip
def test_it_fits_without_a_heap(tmp_path):
    """It leaves nearly half of the RAM to the stack."""
    elf = build.firmware(tmp_path)
    size = build.size(elf)
    assert size.flash < build.FLASH // 10
    assert size.ram < 0.6 * build.RAM
    names = subprocess.run(["avr-nm", elf], capture_output=True, text=True, check=True).stdout
    assert "main" in names
    assert "malloc" not in names


def test_a_skin_that_two_multiplexers_cannot_read_is_refused(tmp_path):
    with pytest.raises(FirmwareError, match="rows = 17: the firmware reads from 1 to 16"):
        build.firmware(tmp_path, rows=17)


def test_what_is_not_installed_is_named():
    with pytest.raises(FirmwareError, match=r"needs no-such-tool.*apt-get install tools"):
        build.run(["no-such-tool"], "tools")


# --- scans and frames ---


@needs_chip
def test_two_seconds_of_scans_are_those_of_the_model():
    """The paper's rates, no damaged or missing frame, readings to half a step and its rounding."""
    found = steady(2.0)
    assert found.scans >= 385.0
    assert found.cells >= 98_000.0
    assert 99.0 < found.frames < 101.0
    assert found.counters.corrupt == found.counters.lost == 0
    assert found.counters.skipped_bytes == description.SIZE
    assert found.error < 0.6


@needs_chip
def test_each_tick_is_in_time():
    """No work is longer than a tick; the input is held and has settled as board.h says."""
    numbers = (build.HERE / "board.h").read_text()
    settle = int(re.search(r"#define SETTLE_CYCLES (\d+)", numbers)[1])
    measured = steady(0.5).measured
    assert measured.settling >= settle
    assert measured.hold >= 28  # HOLD_CYCLES
    assert measured.late - measured.early < 16


@needs_chip
def test_the_slower_clock_of_the_adc_is_in_time_as_well():
    found = steady(0.5, adc_mhz=1)
    assert found.scans == pytest.approx(241.3, abs=0.1)
    assert found.frames == pytest.approx(80.4, abs=0.5)  # a byte in each tick of 16 us
    assert found.error < 0.6
    assert found.measured.settling >= 64
    assert found.measured.hold >= 56
    assert found.measured.late - found.measured.early < 16


@needs_chip
@pytest.mark.parametrize("shape", [(1, 1), ci((3, 5)), ci((16, 1)), (8, 12)])
def test_skins_of_other_sizes(shape):
    circuit = Circuit(*shape)
    found = steady(0.3, "one_finger", circuit)
    assert found.counters.corrupt == found.counters.lost == 0
    assert found.error < 0.6
    assert found.frames == pytest.approx(100.0, abs=3.0)


@needs_chip
@pytest.mark.parametrize("eighths", [ci(1), 3, ci(6)])
def test_a_step_arrives_with_the_stated_time_constant(eighths):
    measured, stated = time_constant(eighths, steps=10)
    assert measured == pytest.approx(stated, rel=0.1)


# --- commands ---


@pytest.fixture
def chip():
    """A chip that has begun to send, and feels two fingers."""
    with Chip(Circuit(), noise=1.0) as running:
        running.feel(resistance(running.circuit, "two_fingers"))
        running.run(0.1)
        yield running


@needs_chip
def test_it_says_what_it_is_when_it_starts_and_when_it_is_asked():
    with Chip(Circuit(8, 12)) as chip:
        first = find_description(chip.run(0.02))
        chip.send(command(description.DESCRIBE))
        again = find_description(chip.run(0.02))
    assert (first.rows, first.cols, first.adc_bits, first.fraction_bits) == (8, 12, 10, 6)
    assert first.reset_cause == 1
    assert again == first
    assert str(first).startswith("firmware 1, 8 x 12 at 10 + 6 bits, 1010 scans and 100 frames")


@needs_chip
def test_a_rate_is_taken(chip):
    chip.send(command(description.RATE, 20))
    assert find_description(chip.run(0.1)).rate == 20
    assert 19 <= len(frames_of(chip, BinaryParser(), 1.0)) <= 21


@needs_chip
def test_a_raw_scan_has_no_fraction(chip):
    """One frame of ADC steps as they were read; those around it are low-passed."""
    chip.send(command(description.RAW))
    frames = frames_of(chip, BinaryParser(), 0.1)
    raw = [bool((f.samples % 64 == 0).all()) for f in frames]
    assert raw.count(True) == 1
    assert not raw[0] or not raw[-1]


@needs_chip
def test_without_the_low_pass_readings_have_their_noise(chip):
    chip.send(command(description.FILTER, 8))
    frames_of(chip, BinaryParser(), 0.1)
    samples = np.array([f.samples / 64 for f in frames_of(chip, BinaryParser(), 1.0)])
    assert samples.std(0).mean() == pytest.approx(np.hypot(1.0, 12**-0.5), rel=0.1)
    assert (samples % 1.0 == 0.0).all()


@needs_chip
def test_a_damaged_command_changes_nothing(chip):
    rate = command(description.RATE, 20)
    for k in range(len(rate)):
        chip.send(rate[:k] + bytes([rate[k] ^ 1]) + rate[k + 1 :])
        chip.run(0.02)
    chip.send(b"\0" * 10 + command(description.DESCRIBE))
    assert find_description(chip.run(0.1)).rate == 100


# --- what it survives ---


@needs_chip
def test_10000_random_bytes_do_not_hang_it(chip):
    noise = np.random.default_rng(0).integers(0, 256, 10_000, dtype=np.uint8)
    parser = BinaryParser()
    chip.send(noise.tobytes())
    frames_of(chip, parser, 0.2)
    chip.send(b"\0" * 10 + command(description.RATE, 100))
    assert find_description(chip.run(0.1)).reset_cause == 1  # no watchdog was needed
    assert len(frames_of(chip, parser, 0.5)) in (49, 50, 51)
    assert parser.counters.restarts == 0


@needs_chip
def test_a_program_that_hangs_is_restarted_by_the_watchdog(chip):
    chip.hang()
    data = chip.run(0.2)
    assert find_description(data).reset_cause == WATCHDOG
    assert len(BinaryParser().feed(data)) > 10


@needs_chip
def test_a_brown_out_in_the_middle_of_a_frame_gives_no_wrong_frame():
    """40 resets at any moment; each frame that the driver's parser passes on is the model's."""
    rng = np.random.default_rng(0)
    circuit = Circuit()
    cells = resistance(circuit, "two_fingers")
    steps = forward(circuit, cells) * STEPS
    parser = BinaryParser()
    with Chip(circuit) as chip:
        chip.feel(cells)
        for _ in range(40):
            data = chip.run(rng.uniform(0.03, 0.06))
            for frame in parser.feed(data):
                assert np.abs(frame.samples / 64 - steps).max() < 0.6
            chip.reset(BROWN_OUT)
        assert find_description(chip.run(0.02)).reset_cause == BROWN_OUT
    assert parser.counters.frames > 80
    assert parser.counters.skipped_bytes > 40 * description.SIZE  # halves of frames


@needs_chip
@pytest.mark.parametrize("cycles", [160, ci(320), ci(700)])
def test_a_line_that_is_held_up_gives_no_mixed_frame(cycles):
    """The load rises all the time: a frame of one scan spans 2.6 ms of it, one of two more."""
    circuit = Circuit()
    parser = BinaryParser()
    spans = []
    with Chip(circuit) as chip:
        chip.run(0.1)
        chip.send(command(description.FILTER, 8))
        chip.slow_line(cycles)
        for k in range(500):  # a step of 3 counts in each ms
            chip.feel(np.full(circuit.shape, rho_of(circuit, 0.1 + 1.5 * k / STEPS / 2)))
            for frame in parser.feed(chip.run(0.0005)):
                spans.append(int(np.ptp(frame.samples.astype(int)) / 64))
    assert max(spans, default=0) <= 10
    assert (len(spans) > 20) == (cycles == 160)


def rho_of(circuit: Circuit, ratio: float) -> float:
    """Resistance of equal cells that read this ratio [ohm]."""
    low, high = 1.0, 1e6
    for _ in range(40):
        middle = np.sqrt(low * high)
        if forward(circuit, np.full(circuit.shape, middle))[0, 0] > ratio:
            low = middle
        else:
            high = middle
    return low


@needs_chip
@pytest.mark.parametrize(
    "circuit, wired",
    [
        (Circuit(8, 8, r_ref=2200.0, r_par=70.0, readout="loaded"), {}),
        (Circuit(8, 8, r_ref=2200.0, r_par=70.0, readout="loaded", driven="columns"), {}),
        (Circuit(8, 8, r_ref=2200.0, r_par=70.0, readout="loaded"), {"inverted": True}),
        (Circuit(8, 8, r_ref=2200.0, r_par=25.0, readout="loaded"), {"diode": 0.58}),
        (Circuit(8, 8, r_par=70.0, readout="grounded", r_drive=40.0), {}),
    ],
    ids=lambda value: "-".join(map(str, value)) if isinstance(value, dict) else value.readout,
)
def test_the_same_program_reads_boards_that_are_wired_otherwise(circuit, wired):
    """With resistors on the sense lines, and a decoder for the driven lines' multiplexer."""
    adc = Adc(circuit, full_scale=float(STEPS), **wired)
    rest, force = resting_curve(CURVE, circuit.shape, 5), scenes.script("two_fingers", 8, 8)(0.0)
    with Chip(circuit, noise=1.0, adc=adc) as chip:
        seen = []
        for scene in (np.zeros(circuit.shape), force):
            chip.feel(rest.resistance(scene))
            chip.run(0.3)  # the low-pass settles
            frames = BinaryParser().feed(chip.run(0.5))
            seen.append(np.mean([adc.ratio_of(frame.samples) for frame in frames], 0))
    found = measure_rest(np.repeat(seen[:1], 10, 0), circuit)
    assert np.abs(np.log(found.conductance * rest.rest_resistance)).max() < 0.15
    curve = CURVE.resting_at(1.0 / found.conductance)
    felt = compensate(seen[1], circuit, curve, "auto", noise=0.3)
    assert felt.status == "ok"
    assert felt.force.sum() == pytest.approx(force.sum(), rel=0.05)


# --- behind a port ---


@pytest.mark.live
@pytest.mark.ci
@needs_chip
def test_a_push_on_the_simulated_chip_stops_the_robot(tmp_path):
    """The skin on the demo's scene; a simulation that is too slow stops it as stale."""
    pushed, heard = threading.Event(), []

    def hook(stop: bool, reason: str):
        heard.append(reason)
        if stop and reason.startswith("push"):
            pushed.set()

    link, ended = tmp_path / "board", threading.Event()
    skin_of = read_skin(share_dir() / "config" / "demo.yaml")
    scene = scenes.script("demo", *skin_of.circuit.shape)

    def work():
        with simulated.Chip(skin_of.circuit, noise=1.0, adc=skin_of.adc) as chip:
            curve = resting_curve(skin_of.curve, skin_of.circuit.shape, 0)
            simulated.serve(chip, curve, scene, link, lambda: not ended.is_set())

    board = threading.Thread(target=work)
    board.start()
    given = {"config": share_dir() / "config" / "demo.yaml", "wait_for_port": 15.0}
    with launch("skin.launch.yaml", port=link, monitor=False, **given) as skin:
        skin.on_stop(hook)
        waited = 0.0
        while not pushed.is_set() and waited < PATIENCE:
            skin.spin(0.5)
            waited += 0.5
    ended.set()
    board.join()
    assert pushed.is_set(), heard


# --- simavr and avr8js, which share no code ---


@pytest.mark.ci
@needs_both
def test_both_send_the_same_frames():
    """Three loads one after the other, 1 ADC step of noise."""
    one, other = on_both(2.0)
    frames = BinaryParser().feed(one)
    assert len(frames) in range(195, 201)
    assert abs(len(one) - len(other)) <= 1  # one may have stopped a cycle later
    n = min(len(one), len(other))
    assert one[:n] == other[:n]
