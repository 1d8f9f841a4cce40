"""All that is watched on one running skin, and which of it is a fault."""

from __future__ import annotations

import numpy as np

from ...physics.adc import Adc
from ...solvers import Estimate
from .cells import Cells
from .contacts import Contacts
from .converter import Ceiling, RestPicture, Windows
from .doubt import Doubt
from .load import IDLE, Load
from .untouched import Untouched


class Watch:
    """Follows one skin; all times are of one clock [s].

    Attributes:
        load: whether half of the skin is loaded, and since when.
        contacts: readings that are set aside.
        untouched: what the skin at rest reads.
    """

    def __init__(self, adc: Adc, *, rest_known: bool):
        """Args:
        adc: the board's converter.
        rest_known: whether the rest of the cells need not be measured.
        """
        circuit = adc.circuit
        self._adc, self._cell_count = adc, np.count_nonzero(circuit.populated)
        short_circuit = adc.rising_count(float(circuit.ratio(0.0)))
        top = circuit.full_scale if adc.inverted else None
        self._ceiling = Ceiling(circuit.adc_bits, short_circuit, top)
        # the solvers know what a reading there means
        self._end = circuit.full_scale * 2 ** (16 - circuit.adc_bits)
        self._end_is_known = bool(adc.bounds(np.array(adc.range[1])))
        self._windows, self._picture = Windows(circuit.adc_bits), RestPicture()
        self._saturated = self._dead = self._odd = self._why = ""
        self._cells, self.contacts = Cells(circuit.shape), Contacts()
        self.untouched = Untouched(circuit)
        self.begin_anew(rest_known=rest_known)
        self.forget_doubts()

    def begin_anew(self, *, rest_known: bool = False) -> None:
        """The rest is measured from here on: a load is one since the start."""
        self.load = Load(rest_known, self._cell_count)
        self.untouched.forget()

    def forget_doubts(self) -> None:
        """The rest was measured for the first time: what was in doubt before was so without it."""
        self._doubt, self._doubtful = Doubt(), False

    def reset(self) -> None:
        """Somebody has checked the skin: past faults are over, what the last frames show is not."""
        self._doubt.reset()
        self.untouched.forget()
        self._doubtful, self._saturated = self._doubt.present, self._ceiling.forget()

    def frame(self, t: float, samples, estimate: Estimate, judged: bool, rest) -> None:
        """Take a frame.

        Args:
            t: when it was read.
            samples: (rows, cols) of skin/adc.
            estimate: what was found in it.
            judged: whether its status says anything of the circuit.
            rest: (rows, cols) ADC ratio of the skin at rest; None: not measured yet.
        """
        suspect = estimate.status == "suspect"
        if suspect or judged:
            touched = bool(estimate.force.max() >= IDLE)
            self._doubtful = self._doubt.frame(t, suspect, touched)
        self._why = estimate.message if suspect else self._why
        samples = self._adc.rising(samples)
        if not (self._end_is_known and samples.max() >= self._end):
            self._saturated = self._ceiling.frame(samples)
        if (window := self._windows.frame(samples)) is not None:
            self._saturated = self._ceiling.window(window)
            if rest is not None:
                self._dead = self._picture.window(window, self._adc.rising_count(rest))
        self._odd = self._cells.frame(t, estimate.force)
        self.contacts.frame(estimate.aside)
        self.load.frame(t, estimate.force)

    @property
    def fault(self) -> bool:
        """Whether readings cannot be trusted: a stop."""
        return bool(
            self._doubtful
            or self._saturated
            or self.load.since_start
            or self._dead
            or self.untouched.fault
        )

    @property
    def kept(self) -> str:
        """Why an earlier fault still holds; empty if none does."""
        return f"{self._why} ({self._doubt.kept})" if self._doubt.kept else ""

    @property
    def held(self) -> str:
        """What was seen under a touch, and is not over; empty if nothing."""
        return self._why if self._doubt.held else ""

    @property
    def certain(self) -> tuple[str, ...]:
        """What is wrong with the readings themselves, the worst first."""
        return self.load.since_start, self._dead, self._saturated, self.untouched.message

    @property
    def odd(self) -> tuple[str, ...]:
        """What one cell or contact does."""
        return self._odd or self.load.message, self.contacts.message
