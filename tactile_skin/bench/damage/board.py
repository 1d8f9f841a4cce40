"""A board that can be damaged: Kirchhoff's laws for any wiring, its ADC, its bytes, its link.

It shares no code with the solvers' `circuit`: a frame is read from the inverse of the nodal matrix
of rows, columns and severed parts, with whatever branches a fault adds, through whatever addresses
the multiplexers have. A fault (fault_data, fault_wires) changes attributes of it, at any time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import lfilter

from ...board import protocol as wire
from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve

KNOTS = 100  # a second: the force is given, and the network solved, so often
SCANS = 390  # a second, paper section III-B; between two knots readings are interpolated
RATE = 100  # frames a second, at most
BAUD = 1_000_000  # what the link carries limits the frames of a large skin
NOWHERE = -1  # what an address selects when it selects no line
BINARY, TEXT = "binary", "text"
BOTH = (BINARY, TEXT)
READOUTS = ("low-pass", "single", "mean of 4")  # what a frame is made of: scans
_INSULATION = 1e-10  # S between stripes where no cell is: keeps severed parts solvable
_DRIVER = 1e-3  # ohm of a driver that holds its line
_INFINITE = 1e9  # ohm of what is not there: of an ADC's input, say
_LATERAL = 0.005  # of what a cell conducts above rest, gained by its neighbours (DESIGN: 0.5 %)
_SCATTER = (0.05, 0.08)  # RMS of what a load adds to a cell's conductance, from board to board
_REST = 0.03  # RMS scatter of the cells' resistance at rest
_HISTORY = 100  # frames kept for a board that repeats them: 1 s


@dataclass
class Wiring:
    """How cells, stripes and multiplexers are joined; nodes are rows first, then columns.

    Attributes:
        row_of, col_of: (rows, cols) stripe (or severed part) on which each cell hangs.
        rows, cols: stripe that each address of the multiplexer selects, or NOWHERE.
        ties: (kind a, index a, kind b, index b, S): conductances between two stripes; kind 0 is a
            row, 1 a column.
        row_lead, col_lead: resistance of each address's way to its stripe [ohm].
        bare: sense addresses whose reference resistor is missing; not of floating matrices.
    """

    row_of: np.ndarray
    col_of: np.ndarray
    rows: np.ndarray
    cols: np.ndarray
    ties: list[tuple[int, int, int, int, float]] = field(default_factory=list)
    row_lead: np.ndarray = None
    col_lead: np.ndarray = None
    bare: set[int] = field(default_factory=set)

    @classmethod
    def sound(cls, rows: int, cols: int) -> Wiring:
        row_of, col_of = np.indices((rows, cols))
        return cls(
            row_of,
            col_of,
            np.arange(rows),
            np.arange(cols),
            row_lead=np.zeros(rows),
            col_lead=np.zeros(cols),
        )


def between_leads(conductance: np.ndarray, wiring: Wiring) -> np.ndarray:
    """Resistance between each row and column address with every other line floating.

    With the nodal matrix L of all stripes and severed parts, and K = (L + fill)^-1, where fill is a
    constant matrix (L is singular along the constant vector, which no difference of voltages sees):
    rho_ij = K_aa + K_bb - 2 K_ab for the nodes a and b that the addresses i and j select.

    Args:
        conductance: (n, rows, cols) of the cells [S], 0 where there is none.

    Returns:
        (n, rows, cols) [ohm], infinite for an address that selects nothing.
    """
    nodal, n_rows = nodal_matrix(conductance, wiring)
    every = np.arange(nodal.shape[1])
    fill = nodal[:, every, every].mean(1) / len(every)
    k = np.linalg.inv(nodal + fill[:, None, None])
    own = k[:, every, every]
    a, b = wiring.rows, n_rows + wiring.cols
    rho = own[:, a, None] + own[:, None, b] - 2.0 * k[:, a[:, None], b[None, :]]
    rho += wiring.row_lead[:, None] + wiring.col_lead
    rho[:, wiring.rows == NOWHERE] = np.inf
    rho[:, :, wiring.cols == NOWHERE] = np.inf
    return rho


def driven_ratio(conductance: np.ndarray, wiring: Wiring, circuit: Circuit) -> np.ndarray:
    """ADC ratio of a loaded or grounded matrix, by Kirchhoff's laws for all its nodes at once.

    Each sense address has its resistor on the board's side of its lead, each drive address its
    driver. One that selects nothing reads 0, and drives nothing.

    Args:
        conductance: (n, rows, cols) of the cells [S], 0 where there is none.
        circuit: as it truly is.

    Returns:
        (n, rows, cols).
    """
    nodal, n_rows = nodal_matrix(conductance, wiring)
    cols = np.where(wiring.cols == NOWHERE, NOWHERE, wiring.cols + n_rows)
    lines = (wiring.rows, wiring.row_lead), (cols, wiring.col_lead)
    (drive, before), (sense, behind) = lines if circuit.driven == "rows" else lines[::-1]
    grounded = circuit.readout == "grounded"
    r_ref = np.full(len(sense), circuit.r_ref)
    r_ref[list(wiring.bare)] = _INFINITE
    load = r_ref + behind + (circuit.r_par if grounded else 0.0)  # ohm
    _lead_to_ground(nodal, sense, 1.0 / load)
    if grounded:
        driver = max(circuit.r_drive, _DRIVER)
        _lead_to_ground(nodal, drive, 1.0 / (before + driver))
    k = np.linalg.inv(nodal)
    series = before + (driver if grounded else k[:, drive, drive] + circuit.r_par)  # ohm
    u = k[:, drive[:, None], sense] / np.broadcast_to(series, (len(k), len(drive)))[:, :, None]
    u *= r_ref / load
    u[:, drive == NOWHERE], u[:, :, sense == NOWHERE] = 0.0, 0.0
    return u if circuit.driven == "rows" else u.swapaxes(1, 2)


def _lead_to_ground(nodal: np.ndarray, nodes: np.ndarray, siemens: np.ndarray) -> None:
    there = nodes != NOWHERE  # several addresses may select one node
    every = np.arange(nodal.shape[1])
    nodal[:, every, every] += np.bincount(nodes[there], siemens[there], len(every))


def nodal_matrix(conductance: np.ndarray, wiring: Wiring) -> tuple[np.ndarray, int]:
    """L of all stripes and severed parts, (n, nodes, nodes) [S], and how many of them are rows."""
    n_rows, n_cols = int(wiring.row_of.max()) + 1, int(wiring.col_of.max()) + 1
    n_rows = max(n_rows, int(wiring.rows.max()) + 1)
    n_cols = max(n_cols, int(wiring.cols.max()) + 1)
    n, nodes = len(conductance), n_rows + n_cols
    joined = np.full((n, n_rows, n_cols), _INSULATION)
    joined[:, wiring.row_of, wiring.col_of] += conductance
    nodal = np.zeros((n, nodes, nodes))
    nodal[:, :n_rows, n_rows:] = -joined
    nodal[:, n_rows:, :n_rows] = -joined.swapaxes(1, 2)
    for kind_a, a, kind_b, b, siemens in wiring.ties:
        a, b = a + kind_a * n_rows, b + kind_b * n_rows
        nodal[:, [a, b], [b, a]] -= siemens
    every = np.arange(nodes)
    nodal[:, every, every] = -nodal.sum(2)
    return nodal, n_rows


@dataclass
class Sent:
    """A frame on its way out of the board; samples in ADC steps * 2**fraction bits."""

    t: float  # s, when its last scan ended
    samples: np.ndarray
    sequence: int
    device_us: int


class FaultBoard:
    """Fabric, wiring, ADC, low-pass and framing of one board, and the link that carries its bytes.

    Args:
        circuit, curve: the skin's configuration; the true cells scatter about it.
        noise: RMS of a sample [ADC steps].
        protocol: "binary" or "text" (whole steps, no checksum).
        readout: one of READOUTS.

    Attributes:
        wiring, r_par, r_ref: the true circuit.
        fixed: (row, col) -> conductance [S] of a cell that has its own; added: on top of the
            fabric's; restless: relative RMS by which it changes from knot to knot.
        gain, offset: function of the time since the damage [s] -> factor, ADC steps.
        ceiling: ADC ratio above which nothing is read; rail: the same before the noise.
        signal: whether the ADC sees the matrix; else `stuck_ratio`.
        or_mask, and_mask: bits of a sample that are always 1; and that may be 1.
        settling: share of the previous reading that stays on the sampling capacitor.
        extra_noise: (rows, cols) RMS on top [ADC steps].
        flicker: (axis, line, share of time open) or None.
        stuck_samples: what every sample reads instead, or None.
        kept: (rows, cols) bool, samples that are never updated again.
        shift: number of samples by which the frame is off.
        tamper: takes each Sent; gives the one that goes out, or None.
        link: takes (t, bytes); gives what arrives, and when: a list of such pairs.
    """

    def __init__(
        self,
        circuit: Circuit,
        curve: PressureCurve,
        rng,
        noise: float = 1.0,
        protocol: str = "binary",
        readout: str = "low-pass",
    ):
        if readout not in READOUTS:
            raise ValueError(f"readout {readout!r}: must be one of {', '.join(READOUTS)}")
        self.circuit, self.curve, self.rng = circuit, curve, rng
        self.noise, self.protocol, self.readout = noise, protocol, readout
        shape = circuit.shape
        scatter = rng.uniform(*_SCATTER)
        self._gain = np.exp(scatter * rng.standard_normal(shape))
        self._rest = np.exp(_REST * rng.standard_normal(shape)) / curve.rest_resistance
        self.wiring = Wiring.sound(*shape)
        self.r_par, self.r_ref = circuit.r_par, circuit.r_ref
        self.fixed: dict[tuple[int, int], float] = {}
        self.added: dict[tuple[int, int], float] = {}
        self.restless: dict[tuple[int, int], float] = {}
        self.gain: Callable = lambda t: 1.0
        self.offset: Callable = lambda t: 0.0
        self.ceiling, self.rail = 1.0, np.inf
        self.signal, self.stuck_ratio = True, 0.0
        self.or_mask, self.and_mask = 0, circuit.full_scale
        self.settling = 0.0
        self.extra_noise = np.zeros(shape)
        self.flicker = None
        self.stuck_samples = None
        self.kept = np.zeros(shape, bool)
        self.shift = 0
        self.tamper: Callable[[Sent], Sent | None] = lambda sent: sent
        self.link: Callable = lambda t, data: [(t, data)]
        self.damaged_at = 0.0  # s
        self.pushes: list[tuple[float, float]] = []  # start and end of those that will come [s]
        self.history: deque[Sent] = deque(maxlen=_HISTORY)
        self.fraction_bits = min(6, 16 - circuit.adc_bits) if protocol == "binary" else 0
        cells = circuit.rows * circuit.cols
        worst = 17 + 2 * cells if protocol == "binary" else 5 * cells + 1  # bytes a frame
        self.rate = min(RATE, BAUD / 10 / worst)
        self.on_the_way = worst * 10 / BAUD  # s, the longest that a frame's bytes take
        self._knots = self._scans = self._frames = 0
        self._last_ratio = self._filtered = self._closed = None
        self._recent: deque[np.ndarray] = deque(maxlen=4)

    @property
    def t(self) -> float:
        return self._knots / KNOTS

    def conductance(self, force: np.ndarray) -> np.ndarray:
        """(n, rows, cols) [N] -> [S]. Beyond the curve's end the fabric goes on conducting more."""
        curve = self.curve
        beyond = np.maximum(force / curve.max_force, 1.0)
        added = (1.0 / curve.resistance(force) - 1.0 / curve.rest_resistance) * beyond * self._gain
        around = np.pad(added, ((0, 0), (1, 1), (1, 1)))
        neighbours = around[:, :-2, 1:-1] + around[:, 2:, 1:-1]
        neighbours += around[:, 1:-1, :-2] + around[:, 1:-1, 2:]
        g = np.where(self.circuit.populated, self._rest + added + _LATERAL * neighbours, 0.0)
        for cell, siemens in self.fixed.items():
            g[(slice(None), *cell)] = siemens
        for cell, siemens in self.added.items():
            g[(slice(None), *cell)] += siemens
        for cell, share in self.restless.items():
            g[(slice(None), *cell)] *= np.exp(share * self.rng.standard_normal(len(g)))
        return g

    def ratio(self, force: np.ndarray) -> np.ndarray:
        """(n, rows, cols) [N] -> ADC ratio that the wires carry to the converter, before noise."""
        moving = force.any((1, 2)) | bool(self.restless)
        ratio = np.empty(force.shape)
        for part, scenes in ((moving, force[moving]), (~moving, force[~moving][:1])):
            if part.any():  # rest is solved once
                ratio[part] = self._read(self.conductance(scenes))
        return ratio

    def _read(self, conductance: np.ndarray) -> np.ndarray:
        if self.circuit.readout != "floating":
            true = replace(self.circuit, r_ref=self.r_ref, r_par=self.r_par)
            return driven_ratio(conductance, self.wiring, true)
        rho = between_leads(conductance, self.wiring)
        return self.r_ref / (self.r_ref + self.r_par + rho)

    def advance(self, force: np.ndarray) -> list[tuple[float, bytes]]:
        """Take the force at the next knots, (n, rows, cols) [N]: what arrives, and when [s]."""
        ratio = self.ratio(force)
        first = ratio[:1] if self._last_ratio is None else self._last_ratio[None]
        ratio, start = np.concatenate([first, ratio]), self._knots
        self._last_ratio = ratio[-1]
        self._knots += len(force)
        rows = self.circuit.rows
        last = int(self._knots / KNOTS * SCANS)
        scans = np.arange(self._scans, last)
        self._scans = last
        # a row's readings are made when the scan has come to it
        at = (scans[:, None] + np.arange(rows) / rows) / SCANS * KNOTS - start
        knot = np.clip(np.floor(at).astype(int), 0, len(force) - 1)
        part = np.clip(at - knot, 0.0, 1.0)[..., None]
        row = np.arange(rows)
        seen = (1.0 - part) * ratio[knot, row] + part * ratio[knot + 1, row]
        arriving = []
        for scan, sample in zip(scans, self._convert(seen, scans / SCANS), strict=True):
            arriving += self._take(int(scan), sample)
        return arriving

    def _convert(self, ratio: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(n, rows, cols) ADC ratio at times (n,) -> whole ADC steps."""
        full, since = self.circuit.full_scale, np.maximum(t - self.damaged_at, 0.0)
        if not self.signal:
            ratio = np.full_like(ratio, self.stuck_ratio)
        if self.flicker:
            ratio = ratio * self._contact(len(t))
        if self.settling:
            flat = ratio.reshape(len(ratio), -1)
            flat = lfilter([1.0 - self.settling], [1.0, -self.settling], flat, axis=1)
            ratio = flat.reshape(ratio.shape)
        gain, offset = (np.vectorize(f)(since)[:, None, None] for f in (self.gain, self.offset))
        steps = np.minimum(ratio * gain, self.rail) * full + offset
        noise = np.hypot(self.noise, self.extra_noise)
        steps = np.rint(steps + noise * self.rng.standard_normal(steps.shape))
        steps = np.clip(steps, 0, np.rint(self.ceiling * full)).astype(np.int32)
        if self.stuck_samples is not None:
            steps[:] = self.stuck_samples
        return steps & self.and_mask | self.or_mask

    def _contact(self, n: int) -> np.ndarray:
        """(n, rows, cols), 0 while a loose contact is open; it lasts a tenth of a second or so."""
        axis, line, share = self.flicker
        state = np.ones((n, *self.circuit.shape))
        closed = True if self._closed is None else self._closed
        for k, (change, chance) in enumerate(self.rng.random((n, 2))):
            if change < 10.0 / SCANS:
                closed = chance > share
            if not closed:
                state[k].swapaxes(0, axis)[line] = 0.0
        self._closed = closed
        return state

    def _take(self, scan: int, sample: np.ndarray) -> list[tuple[float, bytes]]:
        """One scan: the low-pass, and the frame if one is due."""
        self._recent.append(sample)
        if self.readout == "low-pass":
            sample = sample << 6  # the fraction of the board's arithmetic
            before = sample if self._filtered is None else self._filtered
            sample = before + ((3 * (sample - before)) >> 3)
            sample = np.where(self.kept, before, sample) if self.kept.any() else sample
            self._filtered = sample
        elif self.kept.any():
            sample = np.where(self.kept, self._filtered, sample)
        else:
            self._filtered = sample
        due = int((scan + 1) * self.rate / SCANS)
        if due == self._frames:
            return []
        self._frames = due
        if self.readout == "low-pass":
            drop = 6 - self.fraction_bits
            samples = (sample + (1 << drop >> 1)) >> drop
        elif self.readout == "mean of 4":
            samples = np.mean(self._recent, 0) * 2**self.fraction_bits
            samples = np.where(self.kept, sample << self.fraction_bits, np.rint(samples))
        else:
            samples = sample << self.fraction_bits
        if self.shift:
            samples = np.roll(samples.ravel(), self.shift).reshape(samples.shape)
        t = (scan + 1) / SCANS
        sent = Sent(t, samples.astype(np.int64), due - 1, round(t * 1e6))
        self.history.append(sent)
        out = self.tamper(replace(sent))
        return [] if out is None else self.link(out.t + self.on_the_way, self.encode(out))

    def encode(self, sent: Sent) -> bytes:
        """The frame's bytes."""
        if self.protocol == "text":
            return b",".join(b"%d" % v for v in sent.samples.ravel().tolist()) + b"\r\n"
        return wire.encode(
            sent.sequence,
            sent.device_us,
            sent.samples,
            self.circuit.adc_bits,
            self.fraction_bits,
        )


@dataclass(frozen=True)
class Fault:
    """Attributes:
    name, about: for tables, and one line for docs.
    damage: changes the board at the moment of the fault; may draw from board.rng.
    must_stop: none of the data that comes can be trusted: the robot must be stopped at once.
    live_again: the data is good again after a while, so that the robot may be free again.
    protocols: on which it can happen.
    stalls: whether it needs pushes that begin while the link stalls.
    """

    name: str
    about: str
    damage: Callable[[FaultBoard], None]
    must_stop: bool = False
    live_again: bool = False
    protocols: tuple[str, ...] = (BINARY,)
    stalls: bool = False
