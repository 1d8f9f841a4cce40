# SPDX-License-Identifier: Apache-2.0
"""Draws what each gesture is: where a hand touches, how it moves, and its force over time.

    python -m benchmarks.gestures.drawing [--out docs/gestures.svg]

Hands and forces are those of the simulated people.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_skin.simulation.people.hands import POSES, Person, perform
from tactile_skin.simulation.people.mat import Mat
from tactile_skin.touch.recogniser import PERIOD

from .. import harness

_MAT = Mat(12, 10, 0.018)
_PERSON = 34  # with one stroke, and forces that are usual
_SCALE = 750.0  # pixels a metre
_COLUMNS = 4
_PANEL = (205.0, 268.0)  # pixels
_LEFT, _TOP = 35.0, 30.0  # of the mat in its panel, pixels
_CURVE = 36.0  # height of a curve, pixels
_SECONDS = 3.5  # that a curve is wide
_HARD = 50.0  # N: the top of a curve, and the darkest hand
_ARROW = 'fill="none" stroke="#b71c1c" stroke-width="2.5" marker-end="url(#a)"'
_BOTH = _ARROW + ' marker-start="url(#a)"'


class Drawing(NamedTuple):
    """How one gesture is drawn; places are in metres from the middle of the mat, y up."""

    hands: tuple[tuple[str, float, float], ...]  # pose, x, y
    arrows: tuple[str, ...] = ()  # paths of SVG
    both: bool = False  # ways of the arrows: to and fro


_TICKLED = tuple(f"M{x:.3f} {y - 0.085:.3f}v.035" for x, y, *_ in POSES["four tips"])
GESTURES = {  # in the order of the table in docs/gestures.md
    "tap": Drawing((("two tips", 0.02, -0.09),)),
    "poke": Drawing((("tip", 0.0, 0.0),)),
    "pat": Drawing((("flat", 0.0, -0.01),)),
    "slap": Drawing((("flat", 0.0, -0.01),)),
    "stroke": Drawing((("fingers", 0.0, -0.03),), ("M-.075 .01H.075",)),
    "rub": Drawing((("palm", 0.0, 0.01),), ("M-.07 .055H.07",), True),
    "scratch": Drawing((("four tips", 0.0, -0.08),), ("M0 -.03V-.08",), True),
    "tickle": Drawing((("four tips", 0.0, -0.1),), _TICKLED, True),
    "press": Drawing((("palm", 0.0, 0.02),)),
    "hold": Drawing((("flat", 0.0, -0.01),)),
    "squeeze": Drawing(
        (("four tips", 0.0, -0.04), ("thumb", 0.0, -0.06)), ("M0 .025V0", "M0 -.04V-.015")
    ),
    "massage": Drawing(
        (("four tips", 0.0, -0.02), ("palm", 0.0, -0.035)),
        ("M-.03 -.02A.03 .022 0 1 1 0 .002",),
    ),
}


def panel(name: str, drawing: Drawing) -> str:
    """Return the SVG of one gesture: its name, the mat, the hand, its way and its force."""
    width, height = _MAT.size * _SCALE
    total = perform(name, Person(_PERSON), _MAT, 0, PERIOD).sum((1, 2))
    middle = f"translate({_LEFT + width / 2} {_TOP + height / 2}) scale({_SCALE} {-_SCALE})"
    dark = 0.25 + 0.65 * min(total.max() / _HARD, 1.0)
    pads = "".join(
        f'<ellipse cx="{x + px:.3f}" cy="{y + py:.3f}" rx="{rx}" ry="{ry}"/>'
        for pose, x, y in drawing.hands
        for px, py, rx, ry, _ in POSES[pose]
    )
    look = _BOTH if drawing.both else _ARROW
    arrows = "".join(
        f'<path d="{path}" vector-effect="non-scaling-stroke" {look}/>' for path in drawing.arrows
    )
    return (
        f'<text x="{_LEFT}" y="22" font-weight="bold">{name}</text>'
        f'<rect x="{_LEFT}" y="{_TOP}" width="{width}" height="{height}" '
        'fill="url(#cells)" stroke="#999"/>'
        f'<g transform="{middle}"><g fill="#00695c" opacity="{dark:.2f}">{pads}</g>{arrows}</g>'
        f"{_curve(total, _TOP + height + 26.0, width)}"
    )


def _curve(total: np.ndarray, top: float, width: float) -> str:
    """Return the force over time, as high as it is hard: the root shows light ones as well."""
    touched = total[: round(_SECONDS / PERIOD)]
    x = _LEFT + np.arange(len(touched)) * PERIOD / _SECONDS * width
    y = top + _CURVE * (1.0 - np.sqrt(touched / _HARD).clip(0.0, 1.0))
    points = " ".join(f"{a:.0f},{b:.0f}" for a, b in zip(x, y, strict=True))
    return (
        f'<polyline points="{points}" fill="none" stroke="#222" stroke-width="1.5"/>'
        f'<path d="M{_LEFT} {top + _CURVE}h{width}" stroke="#999"/>'
        f'<text x="{_LEFT + width}" y="{top - 10}" text-anchor="end" font-size="11">'
        f"up to {total.max():.0f} N in {_touched(total):.1f} s</text>"
    )


def _touched(total: np.ndarray) -> float:
    """Return the time from the first touch to the last [s]."""
    return float(np.ptp(np.flatnonzero(total)) + 1) * PERIOD


def picture() -> str:
    """Return the SVG of all gestures."""
    rows = -(-len(GESTURES) // _COLUMNS)
    width, height = _COLUMNS * _PANEL[0], rows * _PANEL[1]
    cell = _MAT.pitch * _SCALE
    panels = "\n".join(
        f'<g transform="translate({k % _COLUMNS * _PANEL[0]} {k // _COLUMNS * _PANEL[1]})">'
        f"{panel(name, drawing)}</g>"
        for k, (name, drawing) in enumerate(GESTURES.items())
    )
    return f"""\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" \
font-family="sans-serif" font-size="15">
<title>Where a hand touches, how it moves (red) and its force over {_SECONDS:g} s</title>
<defs><marker id="a" viewBox="0 0 10 10" refX="8" refY="5" markerWidth="5" markerHeight="5" \
orient="auto-start-reverse"><path d="M0 0L10 5L0 10z" fill="#b71c1c"/></marker>
<pattern id="cells" x="{_LEFT}" y="{_TOP}" width="{cell}" height="{cell}" \
patternUnits="userSpaceOnUse"><path d="M{cell} 0H0V{cell}" fill="none" stroke="#ddd"/></pattern>
</defs>
<rect width="{width:g}" height="{height:g}" fill="#fff"/>
{panels}
</svg>
"""


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--out", type=Path, default=Path("docs/gestures.svg"), metavar="FILE")
    parser.parse_args(arguments).out.write_text(picture())


if __name__ == "__main__":
    harness.run(main)
