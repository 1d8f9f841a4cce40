# SPDX-License-Identifier: Apache-2.0
"""What the page draws of a snapshot: pictures of the cells, contacts on the mat, numbers."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import replace
from functools import lru_cache
from typing import TypeVar

import numpy as np

from ..middleware.config import SkinConfig
from ..msg import DiagnosticStatus
from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from ..physics.proof import NOT_PROVED, NOTHING
from ..solvers import METHODS, Estimate, compensate
from ..touch import features
from .snapshot import Snapshot, lines_of, number

_T = TypeVar("_T")
PUBLISHED = "published"  # not a method: what the skin itself made of the reading
_DEFAULT = "auto"  # method of compensation, until it says which it takes
_CELL = 0.2  # N: a contact has a cell with more, as of gesture_feature's cell_threshold
_CELLS = 4096  # of which is kept how the mat lies there
_MM = 4  # decimals of a position [m], and of a normal
_TIME_LIMIT = 0.05  # s for a frame, as of compensation's time_limit
MISSING = ("map", "auto")  # methods that do without the readings that are missing


class Pictures:
    """Draws the snapshots of one skin."""

    def __init__(self, skin: SkinConfig):
        self.skin = skin
        self._snapshot: Snapshot | None = None
        self._estimates: dict[str, Estimate] = {}
        self._parts: dict[tuple[str, str], tuple[str, bytes]] = {}  # of its messages
        self._inverse = lru_cache(_CELLS)(self._inverse_at)
        self._last: dict[str, Estimate] = {}  # of the snapshot before, where the next one starts

    def hello(self) -> dict:
        """Return what holds for all snapshots; `position` and `normal`: of each cell in space."""
        circuit, geometry = self.skin.circuit, self.skin.geometry
        hello = {
            "rows": circuit.rows,
            "cols": circuit.cols,
            "populated": circuit.populated.astype(int).ravel().tolist(),
            "max_force": self.skin.curve.max_force,
            "area": geometry.cell_area.ravel().tolist(),
            "pitch": geometry.pitch,
            "methods": list(METHODS),
        }
        if geometry.normal.any():
            hello["position"] = geometry.position.round(_MM).ravel().tolist()
            hello["normal"] = geometry.normal.round(_MM).ravel().tolist()
        return hello

    def message(self, snapshot: Snapshot, a: str, b: str, more: dict) -> bytes:
        """Return the message for pages that want the same pictures; they share the work.

        `a` is a method or PUBLISHED, `b` one to compare it with; without it nothing is explained.
        """
        if snapshot is not self._snapshot:
            self._snapshot, self._last, self._estimates = snapshot, self._estimates, {}
            self._parts = {}
        if (a, b) not in self._parts:
            self._parts[a, b] = self._drawn(snapshot, a, b)
        return packed_with(more, *self._parts[a, b])

    def _drawn(self, snapshot: Snapshot, a: str, b: str) -> tuple[str, bytes]:
        head = self._numbers(snapshot)
        for name in ("stamp", "stop", "reason", "causes", "force", "limit", "cell_limit"):
            head[name] = getattr(snapshot, name)
        pictures: dict[str, np.ndarray] = {}
        errors: dict[str, str] = {}
        for side, method in (("a", a), ("b", b)):
            if snapshot.adc is None or not method:
                break
            try:
                ratio = self._ratio(snapshot, snapshot.adc)
                pictures["reading"] = ratio * self.skin.circuit.full_scale
                pictures |= self._side(side, method, snapshot, ratio, explained=bool(b))
            except ValueError as error:  # weights of another circuit, nothing read, say
                errors[side] = str(error)
        head["errors"] = errors
        head["contacts"] = self._contacts(snapshot)
        head["unexplained"] = _rms(pictures.get("misfit"))
        if not b:
            pictures.pop("misfit", None)
        if (force := pictures.get("a")) is not None:
            head["push"] = self._push(np.nan_to_num(force))
        pictures = {name: np.asarray(p, np.float32) for name, p in pictures.items()}
        return parts_of(head, pictures)

    def _side(
        self, side: str, method: str, snapshot: Snapshot, ratio: np.ndarray, explained: bool
    ) -> dict[str, np.ndarray]:
        """Force [N], the misfit [ADC steps] and, if it is explained, its standard deviation [N]."""
        circuit, curve = self._known(snapshot)
        area = self.skin.geometry.cell_area
        if method == PUBLISHED:
            if snapshot.pressure is None:
                raise ValueError("the skin published no picture of this reading")
            force = snapshot.pressure * area
        else:
            force = self._estimate(method, ratio, circuit, curve, snapshot).force
        found = {side: force}
        if side == "a":
            model = forward(circuit, curve.resistance(force))
            found["misfit"] = (ratio - model) * circuit.full_scale
            if method == PUBLISHED and snapshot.std is not None:
                found["std"] = snapshot.std * area
            elif explained:
                solver = _method(snapshot) if method == PUBLISHED else method
                found["std"] = self._estimate(solver, ratio, circuit, curve, snapshot).std
        return found

    def _estimate(self, method, ratio, circuit, curve, snapshot) -> Estimate:
        if method not in self._estimates:
            start = self._last.get(method)
            self._estimates[method] = compensate(
                np.where(circuit.populated, ratio, np.nan) if method in MISSING else ratio,
                circuit,
                curve,
                method,
                start=start if start is not None and start.status == "ok" else None,
                noise=_value(snapshot, "noise", None),
                missing=method in MISSING,
                time_limit=_TIME_LIMIT,
            )
        return self._estimates[method]

    def _ratio(self, snapshot: Snapshot, adc: np.ndarray) -> np.ndarray:
        shape = self.skin.circuit.shape
        for picture in (adc, snapshot.pressure, snapshot.std):
            if picture is not None and picture.shape != shape:
                raise ValueError(f"a picture of {picture.shape}: the circuit is {shape}")
        return self.skin.adc.ratio_of(adc)

    def _known(self, snapshot: Snapshot) -> tuple[Circuit, PressureCurve]:
        """Return the circuit and the curve as the skin has found them, by what it says."""
        circuit, curve = self.skin.circuit, self.skin.curve
        circuit = replace(
            circuit,
            r_par=_value(snapshot, "r_par", circuit.r_par),
            r_line=_value(snapshot, "r_line", circuit.r_line),
            r_drive=_value(snapshot, "r_drive", circuit.r_drive),
        )
        if snapshot.rest is not None and snapshot.rest.shape == circuit.shape:
            curve = curve.resting_at(snapshot.rest)
        return circuit, curve

    def _contacts(self, snapshot: Snapshot) -> list[dict]:
        """Each contact with its place and velocity on the mat, in cells and cells a second."""
        found = []
        for x, y, z, force, touch, *velocity, _ in snapshot.contacts.tolist():
            place, way = self._on_mat(np.array([x, y, z]), np.array(velocity))
            found.append(
                {
                    "id": int(touch),
                    "gesture": snapshot.gestures.get(int(touch), ""),
                    "force": force,
                    "row": place[0],
                    "col": place[1],
                    "way": way,
                    "speed": math.hypot(*velocity),
                }
            )
        return found

    def push_of(self, snapshot: Snapshot) -> dict | None:
        """Return the push of what the skin published."""
        if snapshot.pressure is None or snapshot.pressure.shape != self.skin.circuit.shape:
            return None
        return self._push(np.nan_to_num(snapshot.pressure * self.skin.geometry.cell_area))

    def _push(self, force: np.ndarray) -> dict | None:
        """Return the push of a picture; `way`: its unit vector's part in the mat, in cells."""
        push = features.analyse_frame(force, self.skin.geometry, _CELL).push
        if not push.direction.any():
            return None
        place, way = self._on_mat(push.centre, push.direction * self.skin.geometry.pitch)
        return {
            "row": place[0],
            "col": place[1],
            "at": push.centre.tolist(),
            "way": way,
            "force": math.hypot(*push.force.tolist()),
            "direction": push.direction.tolist(),
        }

    def _on_mat(self, position: np.ndarray, vector: np.ndarray) -> tuple[list, list]:
        """Return a point (3,) [m] as (row, column), and a vector there as rows and columns."""
        at = self.skin.geometry.position
        cells = self.skin.circuit.populated
        off = np.where(cells, np.square(at - position).sum(-1), np.inf)
        row, col = np.unravel_index(off.argmin(), off.shape)
        inverse = self._inverse(row, col)
        place = inverse @ (position - at[row, col])
        place = np.clip(place, -0.5, 0.5) + np.array([row, col])
        return place.tolist(), (inverse @ vector).tolist()

    def _inverse_at(self, row: int, col: int) -> np.ndarray:
        """(2, 3): metres -> rows and columns, around a cell."""
        at = self.skin.geometry.position
        steps = np.stack([_slope(at, row, 0)[col], _slope(at.swapaxes(0, 1), col, 0)[row]], 1)
        return np.linalg.pinv(steps)

    def _numbers(self, snapshot: Snapshot) -> dict[str, object]:
        """Return what the nodes say of themselves."""
        values: dict[str, str] = {}
        for status in snapshot.nodes.values():
            values |= status.values
        dropped = sum(  # the page itself takes the newest only
            _count(s.values.get("dropped"))
            for name, s in snapshot.nodes.items()
            if name.rpartition("/")[2] != "view"
        )
        return {
            "method": _method(snapshot),
            "rate": number(values.get("rate")),
            "noise": number(values.get("noise")),
            "lost": _count(values.get("lost")),
            "crc_errors": _count(values.get("crc_errors")),
            "dropped": dropped,
            "simulated": values.get("simulated") == "true",
            "says": [
                (name, status.level, status.message)
                for name, status in sorted(snapshot.nodes.items(), key=lambda n: -n[1].level)
                if status.level
            ]
            + [("newtons", DiagnosticStatus.WARN, NOT_PROVED)] * (values.get("proof") == NOTHING),
            "findings": findings(snapshot),
        }


def findings(snapshot: Snapshot) -> list[dict]:
    """Return what is wrong with which lines: the worst that each node found."""
    found = []
    for _, status in sorted(snapshot.nodes.items()):
        rows, cols = (list(lines_of(status, name)) for name in ("rows", "cols"))
        if not status.level or not (rows or cols):
            continue
        text = status.message
        if rows and len(rows) == len(cols):  # cells
            cells = zip(rows, cols, strict=True)
            found += [{"text": text, "rows": [r], "cols": [c]} for r, c in cells]
        else:
            found.append({"text": text, "rows": rows, "cols": cols})
    return found


def _slope(at: np.ndarray, k: int, axis: int) -> np.ndarray:
    """d position / d index at k along an axis, by its neighbours; 0 where there is one line."""
    low, high = max(k - 1, 0), min(k + 1, at.shape[axis] - 1)
    return (at.take(high, axis) - at.take(low, axis)) / max(high - low, 1)


def _value(snapshot: Snapshot, name: str, default: _T) -> float | _T:
    """Return a number that a node gives among its values."""
    texts = (s.values[name] for s in snapshot.nodes.values() if name in s.values)
    value = next(map(number, texts), None)
    return default if value is None else value


def _method(snapshot: Snapshot) -> str:
    """Return the method of what the skin published, as compensation says once a second."""
    said = (s.values.get("method") for s in snapshot.nodes.values())
    return next((method for method in said if method in METHODS), _DEFAULT)


def _rms(misfit: np.ndarray | None) -> float | None:
    """Return the root mean square of the cells that were read [ADC steps]; None: there are none."""
    read = np.zeros(0) if misfit is None else misfit[np.isfinite(misfit)]
    return float(np.sqrt(np.square(read).mean())) if read.size else None


def _count(text: str | None) -> int:
    return int(number(text) or 0)


# --- the wire, which wire.js reads ---
#
#   length of the head (4 bytes, little-endian) | head: JSON, padded to 4 bytes | arrays
#
# The head is an object; its `arrays` lists [name, dtype, shape] of each array that follows, in
# order, little-endian, each padded to 4 bytes.

_LENGTH = struct.Struct("<I")


def parts_of(head: dict, arrays: dict[str, np.ndarray]) -> tuple[str, bytes]:
    """Return two parts, for `packed_with`: what several messages have in common.

    Args:
        head: JSON's own types; NaN is not allowed.
        arrays: float32, uint16 or uint8, any shape.
    """
    parts, listed = [], []
    for name, array in arrays.items():
        array = np.ascontiguousarray(array)
        listed.append([name, array.dtype.str, array.shape])
        parts.append(_padded(array.tobytes(), b"\0"))
    return _json({"arrays": listed} | head), b"".join(parts)


def packed_with(more: dict, head: str, arrays: bytes) -> bytes:
    """Return a message of the parts, with more in its head."""
    text = f"{_json(more)[:-1]},{head[1:]}" if more else head
    said = _padded(text.encode(), b" ")
    return b"".join((_LENGTH.pack(len(said)), said, arrays))


def _json(values: dict) -> str:
    return json.dumps(values, allow_nan=False, separators=(",", ":"))


def _padded(data: bytes, fill: bytes) -> bytes:
    return data + fill * (-len(data) % 4)
