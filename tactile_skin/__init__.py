# SPDX-License-Identifier: Apache-2.0
"""tactile_skin: a robot's skin from a low-cost resistive pressure matrix.

from tactile_skin import Circuit, PressureCurve, forward, compensate
from tactile_skin import measure_rest, identify, fit_curve, fit_reference, measure_creep

with tactile_skin.open("/dev/ttyUSB0", "mine.yaml") as skin:
    for t, force in skin: ...

Each name is loaded when it is first asked for: what the command does before anything else takes no
second (__main__.py).
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .calibration.creep import measure_creep
    from .calibration.curve_fit import FittedCurve, fit_curve
    from .calibration.identify import Identified, identify
    from .calibration.reference import fit_reference
    from .calibration.rest import Rest, measure_rest
    from .findings.finding import Finding
    from .health.doctor import diagnose
    from .opened import open as open
    from .physics.adc import Adc
    from .physics.circuit import Circuit, forward
    from .physics.creep import Creep
    from .physics.curve import PressureCurve
    from .solvers import Estimate, compensate

_HOME = {
    "calibration.creep": ("measure_creep",),
    "calibration.curve_fit": ("FittedCurve", "fit_curve"),
    "findings.finding": ("Finding",),
    "health.doctor": ("diagnose",),
    "calibration.identify": ("Identified", "identify"),
    "calibration.reference": ("fit_reference",),
    "calibration.rest": ("Rest", "measure_rest"),
    "opened": ("open",),
    "physics.adc": ("Adc",),
    "physics.circuit": ("Circuit", "forward"),
    "physics.creep": ("Creep",),
    "physics.curve": ("PressureCurve",),
    "solvers": ("Estimate", "compensate"),
}
__all__ = [
    "Adc",
    "Circuit",
    "Creep",
    "Estimate",
    "Finding",
    "FittedCurve",
    "Identified",
    "PressureCurve",
    "Rest",
    "compensate",
    "diagnose",
    "fit_curve",
    "fit_reference",
    "forward",
    "identify",
    "measure_creep",
    "measure_rest",
]
__version__ = "0.2.0"  # setup.py reads it here; package.xml repeats it


def __getattr__(name: str) -> object:
    for module, names in _HOME.items():
        if name in names:
            globals()[name] = value = getattr(import_module(f".{module}", __name__), name)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
