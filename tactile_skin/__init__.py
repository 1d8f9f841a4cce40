"""tactile_skin: a robot's skin from a low-cost resistive pressure matrix.

from tactile_skin import Circuit, PressureCurve, forward, compensate
from tactile_skin import measure_rest, identify, fit_curve, fit_reference, measure_creep
"""

from .calibration.creep import measure_creep
from .calibration.curve_fit import FittedCurve, fit_curve, fit_reference
from .calibration.doctor import Finding, diagnose
from .calibration.identify import Identified, identify
from .calibration.rest import Rest, measure_rest
from .physics.circuit import Circuit, forward
from .physics.creep import Creep
from .physics.curve import PressureCurve
from .solvers import Estimate, compensate

__all__ = [
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
__version__ = "0.1.0"  # setup.py reads it here; package.xml repeats it
