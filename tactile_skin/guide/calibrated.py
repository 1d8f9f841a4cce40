# SPDX-License-Identifier: Apache-2.0
"""A guided calibration as a parameter file."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..calibration.creep import as_it_comes
from ..calibration.identify import names, values
from ..middleware.config import SkinConfig
from ..middleware.parameter_file import ParameterFile
from ..middleware.written import entered, replace_file
from ..physics.creep import Creep
from ..physics.curve import PressureCurve
from ..physics.proof import Proof
from .calibration import Guide


def write(path: Path, source: Path | None, guide: Guide, skin: SkinConfig) -> None:
    """Write the configuration with what was learnt; the old file stays as .bak.

    Its comments, order and mode stay. A crash at any point leaves the old file or the new one.
    """
    said = guide.circuit.describe()
    given = _given(source)
    circuit = {
        name: said[name] for name in ("rows", "cols", "r_ref", "adc_bits") if name not in given
    }
    notes = [
        f"made by tactile-skin calibrate {__version__}, {datetime.datetime.now():%Y-%m-%d %H:%M}",
        f"noise of a reading: {guide.rest.noise:.2f} ADC steps",
    ]
    notes += [f"row {row}, column {col} is noisy" for row, col in guide.rest.noisy]
    if guide.found and guide.scaled:
        circuit["r_par"] = round(guide.circuit.r_par, 1)
        # Where it is not told the curve makes up for it: a running skin must know.
        if guide.found.told["r_par"] or guide.fitted:
            circuit["r_par_std"] = float(f"{guide.found.std['r_par']:.2g}")
        circuit[names(guide.circuit)[1]] = round(values(guide.circuit)[1], 1)
        if len(guide.found.bent):
            circuit["adc_table"] = np.asarray(guide.adc.table).round(5).ravel().tolist()
        notes.append(guide.found.message)
    changes = {"circuit": circuit}
    creep = guide.creep or skin.creep
    share, seconds = round(creep.share, 4), round(creep.time, 2)
    if guide.fitted or guide.creep:
        by_file = skin.curve, skin.creep
        curve, known = (guide.fitted.curve, guide.fitted.creep) if guide.fitted else by_file
        curve = as_it_comes(curve, Creep(share, seconds), known)
        # Limits of the file, as stop_on_push.peak, lie on the curve that it had.
        changes["curve"] = points(curve.up_to(skin.curve.max_force))
        if share:
            changes["curve"] |= {"creep": share, "creep_time": seconds}
    if guide.fitted:
        notes.append(guide.fitted.message)
        changes["curve"] |= entries_of(guide.proof)
    if guide.creep:
        notes.append(
            f"a standing load gains {share:.1%} +- {guide.creep.std:.1%} in a decade of time"
        )
    replace_file(path, entered(source, changes, notes))


def known_of(skin: SkinConfig) -> dict[str, Any]:
    """Return what a guide is to know of a skin besides its circuit."""
    return {"pitch": skin.geometry.pitch, "known": skin.proof, "adc": skin.adc}


def entries_of(proof: Proof) -> dict:
    """Return the parameters curve.* of a proof; those of none say nothing of an earlier one."""
    date = proof.date.isoformat() if proof.date else ""
    return {"proof": proof.by, "proof_error": proof.error, "proof_date": date}


def _given(source: Path | None) -> set[str]:
    """Names of the circuit's parameters that a file gives."""
    sections = ParameterFile(source).sections if source else ()
    return {name.removeprefix("circuit.") for section in sections for name in section.values}


def points(curve: PressureCurve) -> dict:
    """Return the parameters curve.* of a curve."""
    described = curve.describe()
    return {
        "force": [round(float(v), 5) for v in described["force"]],
        "resistance": [round(float(v), 2) for v in described["resistance"]],
    } | ({} if curve.gain is None else {"gain": curve.gain.round(3).ravel().tolist()})
