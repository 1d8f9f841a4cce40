"""The nodes of launch/skin.launch.yaml on a clock that is driven: bytes in, decisions out."""

from __future__ import annotations

import numpy as np

from ...launch import Skin, find, read_plan
from ...middleware.bus import Context, ManualClock, Node, SingleThreadedExecutor
from ...msg import DiagnosticArray, Image, image_array
from ...nodes import diagnostics
from ...nodes.stop_on_push import STATUS, STATUS_TOPIC
from ...physics.circuit import Circuit

_NO_PORT = "loop://"  # the driver's reader is never started: bytes come by `feed`
_NEEDS_CIRCUIT = ("serial_driver", "compensation", "gesture_feature")
_EPOCH = 1000.0  # s that the clock shows at t = 0: a stamp of 0 often means "none"
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
        levels: node name -> (level, message) that it reported last on diagnostics.
    """

    def __init__(self, circuit: Circuit, protocol: str = "binary", parameters=None):
        self._clock = ManualClock(_EPOCH)
        plan = read_plan(find("skin.launch.yaml"), {"port": _NO_PORT})
        plan.nodes = [action for action in plan.nodes if action.executable != "monitor"]
        given = {name: dict(values) for name, values in (parameters or {}).items()}
        for name in _NEEDS_CIRCUIT:
            given.setdefault(name, {}).update(_described(circuit))
        given["serial_driver"]["protocol"] = protocol
        given["compensation"].setdefault("time_limit", _PATIENT)
        for action in plan.nodes:
            action.parameters += list(given.get(action.executable, {}).items())
        context = Context(self._clock)
        self._skin = Skin(plan, context)
        self._skin.build()
        nodes = {a.executable: n for a, n in zip(plan.nodes, self._skin.nodes, strict=True)}
        self._driver = nodes["serial_driver"]
        self._area = nodes["gesture_feature"].geometry.cell_area
        self.force = np.zeros(circuit.shape)
        self.stop, self.reason = True, "no decision yet"
        self.levels: dict[str, tuple[int, str]] = {}
        self._observer = Node("observer", context=context)
        for topic, kind, callback, depth in (
            ("skin/pressure", Image, self._on_pressure, 10),
            (STATUS_TOPIC, DiagnosticArray, self._on_status, STATUS),
            (diagnostics.TOPIC, DiagnosticArray, self._on_diagnostics, 50),
        ):
            self._observer.create_subscription(kind, topic, callback, depth)
        self._executor = SingleThreadedExecutor()
        for handle in (*self._skin.handles, self._observer):
            self._executor.add_node(handle)
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
        self._executor.spin_some()

    # ---

    def until(self, t: float) -> None:
        """Let the time go by; timers run."""
        ahead = _EPOCH + t - self._clock.now().nanoseconds * 1e-9
        if ahead > 0.0:
            self._clock.advance(ahead)
        self._executor.spin_some()

    @property
    def doubts(self) -> bool:
        """Whether any stage reports another level than OK."""
        return any(level != diagnostics.OK for level, _ in self.levels.values())

    @property
    def errors(self) -> int:
        """Callbacks that raised."""
        return sum(handle.callback_errors for handle in self._skin.handles)

    def close(self) -> None:
        for handle in (*self._skin.handles, self._observer, self._skin.node):
            handle.destroy_node()

    def _on_pressure(self, message: Image) -> None:
        self.force = image_array(message) * self._area

    def _on_status(self, message: DiagnosticArray) -> None:
        status = message.status[0]
        self.stop, self.reason = status.level != diagnostics.OK, status.message

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
