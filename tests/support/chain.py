# SPDX-License-Identifier: Apache-2.0
"""The nodes of launch/skin.launch.yaml on a clock that is driven: bytes in, decisions out."""

from __future__ import annotations

import numpy as np

from tactile_skin.behaviours.stop import Decision
from tactile_skin.launch import find, read_plan
from tactile_skin.msg import DiagnosticArray, Image, image_array
from tactile_skin.nodes import diagnostics
from tactile_skin.nodes.stop_on_push import STATUS, STATUS_TOPIC, causes_of
from tactile_skin.physics.circuit import Circuit
from tactile_skin.replay.replay import Driven

_NO_PORT = "loop://"  # the driver's reader is never started: bytes come by `feed`
_NEEDS_CIRCUIT = ("serial_driver", "compensation", "gesture_feature")
PROVED = {  # what is known of a skin unless a test gives other parameters: all
    "curve.proof": "weight",
    "curve.proof_error": 0.0,
    "curve.proof_date": "9999-12-31",  # no day makes it older
}
_EPOCH = 10**12  # ns that the clock shows at t = 0: a stamp of 0 often means "none"
_PATIENT = 10.0  # s for a frame: a busy machine is not what is measured


class Chain:
    """From the bytes of a board to the stop's messages, with no thread and no wall clock.

    Args:
        circuit: the skin's configuration of its board.
        protocol: "binary" or "text".
        parameters: node name -> {parameter: value} on top of config/skin.yaml.

    Attributes:
        force: (rows, cols) [N], the picture published last; zero before the first.
        stop, reason: what the stop says.
        for_push_alone: whether only a push stops it.
        levels: node name -> (level, message) that it reported last on diagnostics.
    """

    def __init__(self, circuit: Circuit, protocol: str = "binary", parameters=None):
        plan = read_plan(find("skin.launch.yaml"), {"port": _NO_PORT})
        plan.nodes = [action for action in plan.nodes if action.executable != "monitor"]
        given = {name: dict(values) for name, values in (parameters or {}).items()}
        for name in _NEEDS_CIRCUIT:
            given.setdefault(name, {}).update(_described(circuit))
        for proof, value in PROVED.items():
            given["compensation"].setdefault(proof, value)
        given["serial_driver"]["protocol"] = protocol
        given["compensation"].setdefault("time_limit", _PATIENT)
        given["gesture_feature"].setdefault("geometry.shape", "plane")
        for action in plan.nodes:
            action.give(given.get(action.executable, {}))
        self._driven = Driven(plan, _EPOCH)
        self._driver = self._driven.nodes["serial_driver"]
        self._area = self._driven.nodes["gesture_feature"].geometry.cell_area
        self.force = np.zeros(circuit.shape)
        self.stop, self.reason, self.for_push_alone = True, "no decision yet", False
        self.levels: dict[str, tuple[int, str]] = {}
        for topic, kind, callback, depth in (
            ("skin/pressure", Image, self._on_pressure, 10),
            (STATUS_TOPIC, DiagnosticArray, self._on_status, STATUS),
            (diagnostics.TOPIC, DiagnosticArray, self._on_diagnostics, 50),
        ):
            self._driven.observer.create_subscription(kind, topic, callback, depth)
        self._open()

    # --- all that is known of the driver's inside ---

    def _open(self) -> None:
        """As the reader's thread does once the first frame came; it is not started."""
        self._driver._starter.cancel()
        self._driver._reader._found(_NO_PORT)

    def feed(self, t: float, data: bytes) -> None:
        """Bytes that arrive at t [s]: the one way in."""
        self.until(t)
        for frame in self._driver._reader.parser.feed(data):
            self._driver.on_frame(frame)
        self._driven.run()

    # ---

    def until(self, t: float) -> None:
        """Let the time go by; timers run."""
        self._driven.until(_EPOCH + round(t * 1e9))

    @property
    def doubts(self) -> bool:
        """Whether any stage reports another level than OK."""
        return any(level != diagnostics.OK for level, _ in self.levels.values())

    @property
    def errors(self) -> int:
        """Callbacks that raised."""
        return self._driven.errors

    def close(self) -> None:
        self._driven.close()

    def _on_pressure(self, message: Image) -> None:
        self.force = image_array(message) * self._area

    def _on_status(self, message: DiagnosticArray) -> None:
        status = message.status[0]
        self.stop, self.reason = status.level != diagnostics.OK, status.message
        decision = Decision(self.stop, self.reason, causes_of(status))
        self.for_push_alone = decision.for_push_alone

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.levels[status.name] = status.level, status.message


def _described(circuit: Circuit) -> dict:
    """The parameters circuit.* of a circuit."""
    described = circuit.describe()
    mask = described.pop("mask")
    return {f"circuit.{key}": value for key, value in described.items()} | {
        "circuit.mask": " ".join(mask) if mask else ""
    }
