# SPDX-License-Identifier: Apache-2.0
"""The mechanisms that doubt readings: what each watches, its null result and its lines of code."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

from tactile_skin import __file__ as _package
from tactile_skin.board.absent import Unread
from tactile_skin.board.liveness import _SETTLING, JITTER
from tactile_skin.findings.finding import Kind
from tactile_skin.nodes.serial_driver import _DOUBTFUL

from .switchboard import Field, Limit, Result, Switchboard


@dataclass(frozen=True)
class Mechanism:
    """Attributes:
    name, watches: for tables.
    source: files of the package, or "file:function", that exist for it.
    parts: what to patch, see switchboard.py.
    frame: whether it judges single frames, within `compensate`.
    """

    name: str
    watches: str
    source: tuple[str, ...]
    parts: tuple
    frame: bool = False

    @property
    def lines(self) -> int:
        """Lines of its functions, classes and files, docstrings and comments among them."""
        return sum(count_lines(place) for place in self.source)


def count_lines(place: str) -> int:
    """Return the lines of a file, or of "file:Class.function".

    Raises:
        KeyError: there is no such function.
    """
    path, _, name = place.partition(":")
    text = (Path(_package).parent / path).read_text(encoding="utf-8")
    if not name:
        return len(text.splitlines())
    node = ast.parse(text)
    for part in name.split("."):
        node = {n.name: n for n in node.body if isinstance(n, (ast.FunctionDef, ast.ClassDef))}[
            part
        ]
    first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
    return node.end_lineno - first + 1


def _attribute(where: str, null) -> Field:
    return Field(where, lambda found: null)


def _saturation_alone(found, reading):
    """Return what `suspect.by_reading` says of saturation, without its impossible readings."""
    return found if found and found.kind is Kind.SATURATION else None


def _finds(where: str, *forms: str) -> Result:
    """A function that returns findings, of which those of some forms are meant; all, if none is."""
    return Result(where, lambda found, *_: [f for f in found if forms and f.form not in forms])


def _finds_one(where: str) -> Result:
    """A function that returns a finding or None."""
    return Result(where, lambda found, *_: None)


def _without_restarts(verdict, *_):
    many = verdict.trouble.startswith("the board restarted")
    return verdict._replace(trouble="") if many else verdict


def _settled_after_start(settled: bool, delay) -> bool:
    last = delay._last
    return settled if last is None or last[0] - delay._since < _SETTLING else True


_HEALTH, _SOLVE = "health", "solvers"
MECHANISMS = (
    # --- of single frames ---
    Mechanism(
        "by_residual", "misfit beyond noise", (f"{_SOLVE}/suspect.py:by_residual",),
        (_finds_one("solvers.suspect:by_residual"),), True,
    ),
    Mechanism(
        "impossible readings", "readings that no skin can give",
        (f"{_SOLVE}/suspect.py:by_reading", f"{_SOLVE}/suspect.py:_place"),
        (Result("solvers.suspect:by_reading", _saturation_alone),), True,
    ),
    Mechanism(
        "saturation in a frame", "many equal readings at the top",
        (f"{_SOLVE}/suspect.py:saturation",),
        (_finds_one("solvers.aside:saturation"),
         _finds_one("solvers.suspect:saturation")), True,
    ),
    Mechanism(
        "aside", "readings that the others do not allow are left out",
        (f"{_SOLVE}/aside.py",),
        (Result("solvers.map:without_bad_contacts", lambda found, *_: None),), True,
    ),
    Mechanism(
        "two pictures", "a light and a hard load that read alike behind real drivers",
        (f"{_SOLVE}/map.py:_unless_another",),
        (Result("solvers.map:_unless_another", lambda found, reading, estimate: estimate),), True,
    ),
    # --- of the stream: readings and circuit ---
    Mechanism(
        "doubt.lasting", "a fault at rest goes on under a touch",
        (), (_attribute("health.doubt:Doubt._lasting", False),),
    ),
    Mechanism(
        "doubt.held", "a fault under a touch is kept without it",
        (), (_attribute("health.doubt:Doubt.held", False),),
    ),
    Mechanism(
        "odd cells", "one cell jumps about, or never moves",
        (f"{_HEALTH}/odd_cells.py",),
        (_finds("health.odd_cells:OddCells.findings", "jumps", "constant"),),
    ),
    Mechanism(
        "contacts", "one reading is left out again and again",
        (),
        (_finds("health.odd_cells:OddCells.findings", "set aside"),),
    ),
    Mechanism(
        "loose lines", "a line opens again and again",
        (f"{_HEALTH}/loose_lines.py",),
        (_finds("health.loose_lines:LooseLines.findings", "returns"),),
    ),
    Mechanism(
        "untouched.line", "a line at rest reads as another one did",
        (f"{_HEALTH}/untouched.py:_another_line",),
        (_finds_one("health.untouched:_another_line"),),
    ),
    Mechanism(
        "untouched.common", "all cells at rest gain or lose at once",
        (f"{_HEALTH}/untouched.py:Untouched._common",),
        (Result("health.untouched:Untouched._common",
                lambda found, *a: (0.0, True) if abs(found[0]) > a[-1] else found),),
    ),
    Mechanism(
        "voltage", "cells at rest read one voltage, from the start",
        ("calibration/at_rest.py:one_voltage", "calibration/at_rest.py:_fabric_spread"),
        (_finds_one("calibration.tare:one_voltage"),),
    ),
    Mechanism(
        "rest picture.flat", "cells read one voltage, later on", (),
        (_finds("health.rest_picture:RestPicture.findings", ""),),
    ),
    Mechanism(
        "bits", "a bit of the ADC is stuck, live",
        (f"{_HEALTH}/bits.py",), (_finds("health.bits:Bits.findings"),),
    ),
    Mechanism(
        "ceiling.frame", "the largest readings stand still while others do not",
        (f"{_HEALTH}/ceiling.py:Ceiling._still",),
        (Result("health.ceiling:Ceiling._still", lambda found, *_: False),),
    ),
    Mechanism(
        "ceiling.window", "touches end at one height",
        (f"{_HEALTH}/ceiling.py:Ceiling._stands",),
        (Result("health.ceiling:Ceiling._stands", lambda found, *_: False),),
    ),
    Mechanism(
        "sent", "the board sends numbers that its sketch has processed",
        (f"{_HEALTH}/sent.py", "readings/processed.py"),
        (_finds("health.sent:Sent.findings"),),
    ),
    Mechanism(
        "twins", "two lines, or half of them, read the same at rest",
        tuple(f"calibration/at_rest.py:{name}" for name in (
            "equal_lines", "address_bits", "which_are_one",
        )), (_finds_one("calibration.tare:which_are_one"),),
    ),
    Mechanism(
        "tare guards", "lines that a tare would hide",
        ("calibration/at_rest.py:weak_line",),
        (_finds_one("calibration.tare:weak_line"),),
    ),
    Mechanism(
        "odd cell at rest", "a cell at rest that no fabric has",
        ("calibration/at_rest.py:odd_cell",), (_finds_one("calibration.tare:odd_cell"),),
    ),
    Mechanism(
        "tracker", "what lies in series is learnt from touches",
        ("calibration/tracker.py",),
        (Result("health.skin:Skin._learn_circuit", lambda found, *_: None, skip=True),
         Result("calibration.tracker:CircuitTracker.ask", lambda found, *_: None, probe=True)),
    ),
    Mechanism(
        "tracker words", "the same is said, not only used",
        ("calibration/tracker.py:CircuitTracker._suggested",
         "calibration/tracker.py:CircuitTracker._differing"),
        (_finds("calibration.tracker:CircuitTracker.findings"),),
    ),
    Mechanism(
        "reserve", "a push counts with what an unknown r_par may hide",
        ("nodes/stop_on_push.py:StopOnPush._at_most",),
        (Result("nodes.stop_on_push:StopOnPush._at_most", lambda found, *_: 1.0),),
    ),
    # --- of the stream: the board and its link ---
    Mechanism(
        "live.frozen", "one frame repeats", (),
        (Result("board.liveness:Repeats.frame",
                lambda found, repeats, *_: "" if repeats._period == 1 else found),),
    ),
    Mechanism(
        "live.ring", "some frames repeat", (),
        (Result("board.liveness:Repeats.frame",
                lambda found, repeats, *_: "" if repeats._period > 1 else found),),
    ),
    Mechanism(
        "live.still", "lines stand still while others do not",
        ("board/liveness.py:StillLines",),
        (Result("board.liveness:StillLines.frame", lambda found, *_: ""),),
    ),
    Mechanism(
        "live.restarts", "the board restarts again and again", (),
        (Limit("board.liveness:_RESTARTS_WITHIN", 0.0),
         Result("board.liveness:Liveness.frame", _without_restarts, probe=True)),
    ),
    Mechanism(
        "live.lag", "frames come late, or a queue is emptied",
        ("board/liveness.py:Delay",),
        (Result("board.liveness:Delay.frame",
                lambda found, *_: (0.0, found[1]) if found[0] > JITTER else found),
         Result("board.liveness:Delay.settled", _settled_after_start)),
    ),
    Mechanism(
        "link share", "frames are damaged or lost", (),
        (Field("nodes.serial_driver:SerialDriver._bad",
               lambda share: 0.0 if share >= _DOUBTFUL else share),),
    ),
    Mechanism(
        "absent", "crossings without a reading",
        ("board/absent.py",), (Result("board.absent:Absent.frame", lambda found, *_: Unread()),),
    ),
)  # fmt: skip
ALL_ON = "all on"
BUNDLES = {  # switched off together
    "aside + contacts": ("aside", "contacts"),
}  # fmt: skip


def variants(frame: bool) -> dict[str, frozenset[str]]:
    """Return name -> mechanisms that are off: each by itself, then the bundles.

    Args:
        frame: only mechanisms of single frames, and bundles of two of them or more.
    """
    known = [m.name for m in MECHANISMS if m.frame or not frame]
    found = {name: frozenset({name}) for name in known}
    for name, members in BUNDLES.items():
        together = frozenset(members) & frozenset(known)
        if len(together) > 1 and together not in found.values():
            found[name] = together
    return found


def sweep(board: Switchboard, play, frame: bool) -> tuple[dict, frozenset[str]]:
    """Play one input with all mechanisms on, and with each variant off that can change anything.

    What said nothing changes nothing; a bundle of which one member spoke is that one by itself,
    unless another speaks in its place.

    Args:
        play: () -> numbers, the same for the same mechanisms.
        frame: see `variants`.

    Returns:
        variant -> numbers, `ALL_ON` first, without those that change nothing; what spoke.
    """
    results, heard = {}, {}

    def run(name, off=()):
        board.switch_off(off)
        results[name] = play()
        heard[name] = frozenset(board.spoke)

    run(ALL_ON)
    for name, off in variants(frame).items():
        spoke = off & heard[ALL_ON]
        alone = next(iter(spoke), None)
        if len(spoke) == 1 < len(off) and not off & heard[alone]:
            results[name] = results[alone]
        elif spoke:
            run(name, off)
    board.switch_off()
    return results, heard[ALL_ON]


def changes(results: dict[str, dict]) -> dict[str, dict]:
    """Return variant -> numbers that differ from those with all mechanisms on, which are complete.

    `numbers_of` is the way back.
    """
    base = results[ALL_ON]
    found = {
        name: {key: value for key, value in numbers.items() if value != base[key]}
        for name, numbers in results.items()
        if name != ALL_ON
    }
    return {ALL_ON: base} | {name: numbers for name, numbers in found.items() if numbers}


def numbers_of(row: dict, variant: str) -> dict:
    """Return the numbers of a variant in a row of results."""
    return row["results"][ALL_ON] | row["results"].get(variant, {})
