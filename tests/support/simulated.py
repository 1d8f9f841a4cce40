# SPDX-License-Identifier: Apache-2.0
"""A simulated board in a thread of the test, on a real pseudo-terminal."""

import contextlib
import functools
import threading

import numpy as np

from support.patience import PATIENCE
from tactile_skin import Circuit, PressureCurve
from tactile_skin.simulation import scenes, simulator

CIRCUIT = Circuit(4, 5)  # small frames: little to compute


def remembering(board: simulator.Board) -> simulator.Board:
    """The board; what it feels again is not computed again."""
    shape, ratio = (1, *board.circuit.shape), board.matrix.ratio
    of = functools.lru_cache(lambda felt: ratio(np.frombuffer(felt).reshape(shape)))
    board.matrix.ratio = lambda force: of(force.astype(float).tobytes())
    return board


def make_board(scene="idle", circuit=CIRCUIT, **kwargs) -> simulator.Board:
    script = scenes.script(scene, *circuit.shape)
    return remembering(simulator.Board(circuit, PressureCurve(), script, **kwargs))


class TextBoard(simulator.Board):
    """A hobby board as its maker describes it: 8 x 12 lines of text, 12 bits, 4.7 kohm, 70 ohm.

    Its cells scatter by 10 %, all of them drift by 5 % over five minutes, and two are noisy. It has
    no low-pass, and prints what it reads.

    Args:
        line: what it prints of its readings (rows, cols) in ADC steps.
        absent: (row, column) of crossings that it skips, and prints as NaN.
    """

    CIRCUIT = Circuit(8, 12, r_ref=4700.0, r_par=70.0, adc_bits=12)
    BAUD = 115_200
    NOISY = (2, 7), (5, 3)

    def __init__(self, scene="idle", rate=60.0, line=None, absent=(), noise=1.0, seed=0):
        script = scenes.script(scene, 8, 12)
        super().__init__(self.CIRCUIT, PressureCurve(), script, noise, rate, seed)
        self._line, self._absent = line or commas, absent
        self._gain = np.exp(0.1 * self._rng.standard_normal(self.CIRCUIT.shape))
        self._noise = np.full(self.CIRCUIT.shape, noise)
        self._noise[tuple(zip(*self.NOISY, strict=True))] *= 8.0

    def scan(self) -> bytes:
        self._scans += 1
        t = self._scans / simulator.SCANS_PER_SECOND
        due = int(t * self.frames_per_second)
        if due == self._frames:
            return b""
        self._frames = due
        drift = 1.0 + 0.05 * np.sin(2.0 * np.pi * t / 300.0)
        ratio = self.matrix.ratio(self.scene(t)[None], 1.0 / (self._gain * drift))[0]
        steps = ratio * self.circuit.full_scale
        steps = steps + self._noise * self._rng.standard_normal(steps.shape)
        steps = np.rint(np.clip(steps, 0, self.circuit.full_scale))
        for cell in self._absent:
            steps[cell] = np.nan
        return self._line(steps)


def commas(steps) -> bytes:
    return b",".join(b"nan" if s != s else b"%d" % int(s) for s in steps.ravel()) + b"\r\n"


class Serving:
    """The board behind the link, until `unplug`.

    Attributes:
        board: may be changed.
    """

    def __init__(self, link, simulated=None):
        self._tick = threading.Semaphore(0)
        self._done = threading.Event()
        self.board = simulated = simulated or make_board()
        args = (simulated, link, self._running, getattr(simulated, "BAUD", simulator.BAUD))
        self._thread = threading.Thread(target=simulator.serve, args=args)
        self._thread.start()
        self.let_it_notice()

    def _running(self) -> bool:
        self._tick.release()  # once for each turn of the board's loop
        return not self._done.is_set()

    def let_it_notice(self) -> None:
        """Until the board has looked at its port twice: it polls whether somebody opened it."""
        while self._tick.acquire(blocking=False):
            pass
        for _ in range(3):
            assert self._tick.acquire(timeout=PATIENCE)

    def unplug(self) -> None:
        self._done.set()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


@contextlib.contextmanager
def serving(link, simulated=None):
    served = Serving(link, simulated)
    try:
        yield served
    finally:
        served.unplug()
