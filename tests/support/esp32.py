# SPDX-License-Identifier: Apache-2.0
"""Boards whose converter is an ESP32: two that others measured, more that scatter about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from support.chain import Chain
from support.lab.unknown import Unknown
from support.strangers.sim import fabric, touches
from tactile_skin import Circuit, forward
from tactile_skin.physics.adc import TABLES, Adc

SUPPLY = 3.3  # V
# (V, reading of 12 bits) of single chips: github.com/espressif/arduino-esp32, issue 92, with the
# dead zone and the end that others report there; github.com/kisel/esp32_adc_test, f2/adc.csv
ISSUE_92 = "0.142 0 0.819 823 1.641 1814 2.462 2811 3.15 4095"
KISEL = (
    "0.139 0 0.2 70 0.5 436 0.8 816 1.1 1184 1.494 1676 1.8 2059 2.103 2421 2.35 2730 2.505 2930 "
    "2.603 3065 2.701 3216 2.808 3394 2.906 3581 3.001 3785 3.055 3906 3.119 4060 3.134 4095"
)
CHIPS = [np.array(chip.split(), float).reshape(-1, 2) for chip in (ISSUE_92, KISEL)]
_READING, _SHARE = np.loadtxt(TABLES["esp32"], delimiter=",").T
EXACT = np.stack([SUPPLY * _SHARE, _READING], 1)  # the chip that follows the shipped table
OFFSET = 0.025  # V RMS, from chip to chip
GAIN = 0.02  # RMS, from chip to chip
LARGEST = 4095  # reading
NOISE = 0.0015  # V RMS of a reading
RATE = 20.0  # Hz
REST = 5.0  # s before the first touch
TOUCHED = 3.0  # N in all, from which a frame is scored
LATEST = 3  # frames of a touch that comes or goes, on either side, which are not scored


class Chip:
    """One ESP32's ADC: volts -> readings."""

    def __init__(self, rng: np.random.Generator, of: int | None, offset=0.0, gain=0.0):
        volts, self._readings = (EXACT if of is None else CHIPS[of]).T
        self._volts = volts * (1.0 + gain * rng.standard_normal()) + offset * rng.standard_normal()

    def read(self, volts: np.ndarray) -> np.ndarray:
        readings = np.rint(np.interp(volts, self._volts, self._readings)).astype(int)
        return np.minimum(readings, LARGEST)


class UnknownEsp32(Unknown):
    """An unknown board whose converter is that of an ESP32; nobody entered its r_par."""

    def __init__(self, shape, seed: int, r_ref: float, of: int | None, **spread):
        super().__init__(shape, seed)
        self.supposed = replace(self.supposed, r_ref=r_ref, adc_bits=12)
        self.matrix.circuit = replace(self.matrix.circuit, r_ref=r_ref, adc_bits=12)
        spread = {"offset": OFFSET, "gain": GAIN} | spread
        self.chip = Chip(np.random.default_rng([seed, 7]), of, **spread)
        self.adc = Adc(self.supposed, table="esp32")

    def sample(self, ratio: np.ndarray) -> np.ndarray:
        volts = SUPPLY * ratio + NOISE * self._rng.standard_normal(ratio.shape)
        return np.asarray(self.adc.ratio(self.chip.read(volts)))


def frames(circuit: Circuit, seed, of, seconds: float = 90.0, *, offset=OFFSET, gain=GAIN):
    """Return (n, rows, cols) readings of one board, and the forces [N].

    Args:
        of: index into `CHIPS`; None: the chip follows the shipped table.
        offset, gain: RMS by which its converter is off that chip's [V, share].
    """
    rng = np.random.default_rng(seed)
    chip, curve = Chip(rng, of, offset, gain), fabric(circuit, seed=int(rng.integers(1 << 30)))
    force = touches(
        circuit.shape,
        seconds,
        RATE,
        seed=int(rng.integers(1 << 30)),
        rest=REST,
        hard=(3, 40),
        hold=1.2,
    )
    volts = SUPPLY * forward(circuit, curve.resistance(force))
    return chip.read(volts + NOISE * rng.standard_normal(volts.shape)), force


def felt(circuit: Circuit, readings, force, adc: dict) -> tuple[np.ndarray, float, dict]:
    """Ratio of felt to true force while touched; share of time in a fault stop; reasons."""
    driver = {name: value for name, value in adc.items() if name.startswith("circuit.")}
    parameters = {"serial_driver": driver, "compensation": adc}
    parameters |= {"gesture_feature": {"geometry.shape": "plane"}}
    chain = Chain(circuit, "text", parameters)
    total = force.sum((1, 2))
    near = np.array([total[max(k - LATEST, 0) : k + LATEST + 1].min() for k in range(len(total))])
    ratio, faults, why = [], 0, {}
    try:
        for k, frame in enumerate(readings):
            chain.feed(k / RATE + 0.01, b",".join(b"%d" % v for v in frame.ravel()) + b"\n")
            chain.until(k / RATE + 0.04)
            if near[k] > TOUCHED:
                ratio.append(chain.force.sum() / total[k])
            fault = chain.stop and "push" not in chain.reason
            if k / RATE > REST and fault:
                faults += 1
                why[chain.reason] = why.get(chain.reason, 0) + 1
    finally:
        chain.close()
    return np.array(ratio), faults / (len(readings) - REST * RATE), why
