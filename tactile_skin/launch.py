"""Start the nodes that a ROS 2 YAML launch file names, all in this process.

    with launch("skin.launch.yaml", port="/dev/ttyUSB0") as skin:
        skin.on_stop(lambda stop, reason: print(stop, reason))
        skin.spin()

The grammar is the part of ROS 2's YAML launch format that the skin needs. What is not understood is
refused by name.
"""

from __future__ import annotations

import atexit
import concurrent.futures
import contextlib
import gc
import importlib
import logging
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from .bus import Context, MultiThreadedExecutor, Node, Parameter, ParameterError, TopicTypeError
from .config import ParameterFile
from .events import Pushed, Released, Stroked
from .files import FileError, parse_yaml, read_yaml, shorten
from .hooks import EventHook, StopHook
from .logs import QueuedLog
from .msg import DiagnosticArray, Trigger, Twist
from .nodes.stop_on_push import STATUS, STATUS_TOPIC, word_of
from .nodes.touch_events import PushListener, StrokeListener
from .signals import SIGNALS, unwinding
from .threads import one_thread

PACKAGE = "tactile_skin"
NODES = {  # exec -> class, imported when it is started
    "serial_driver": "serial_driver.SerialDriver",
    "compensation": "compensation.Compensation",
    "gesture_feature": "gesture_feature.GestureFeature",
    "stop_on_push": "stop_on_push.StopOnPush",
    "cmd_vel_gate": "cmd_vel_gate.CmdVelGate",
    "push_to_move": "push_to_move.PushToMove",
    "monitor": "monitor.Monitor",
    "push_arrow": "push_arrow.PushArrow",
}


_ONE_THREAD = ("compensation", "gesture_feature")  # each waits for the other's last word anyway
_SHARED = ("circuit", "curve", "geometry")  # parameters that several nodes read
_MAX_FILES = 30  # launch files of one launch: includes may double at each level
_MAX_TEXT = 10_000  # characters of a filled-in value: it may double with each let
_LOOK = 0.02  # s between two looks of `spin` at signals, nodes and commands
# From a signal to the end of the process it takes a second at most, whatever hangs:
_CLOSE_WITHIN = 0.1  # s that the end of one node may keep the others waiting
_END_WITHIN = 0.3  # s for all nodes' last words, and for hooks to hear of the stop
_HURRY = 0.5  # s after which commands of the launch file are killed, if a signal asked for the end
_PATIENCE = 3.0  # s, if none did: they may have something to save
LAUNCHED = "TACTILE_SKIN_LAUNCHED"  # in a command's environment: its launcher holds its stdin open


class LaunchError(ValueError):
    """A launch file or argument that cannot be carried out; the message names file and key."""


def share_dir() -> Path:
    """Where launch/ and config/ are: the source tree, or share/tactile_skin of the installation."""
    here = Path(__file__).resolve()
    for parent in here.parents[1:]:
        for place in (parent, parent / "share" / PACKAGE):
            if (place / "package.xml").is_file() and (place / "launch").is_dir():
                return place
    raise LaunchError(f"the launch and config folders of {PACKAGE} are not beside {here}")


def find(path) -> Path:
    """A launch file as given; a bare name that is no file here, among those of the package.

    Raises:
        LaunchError: a path to nothing whose last part is the name of one of the package.
    """
    if Path(path).exists():
        return Path(path)
    shipped = share_dir() / "launch" / Path(path).name
    if not shipped.is_file():
        return Path(path)  # to be named when it is read
    if os.path.dirname(path):  # who names a folder does not mean another file of the same name
        raise LaunchError(
            f"launch file {path}: does not exist; the one of {PACKAGE} is meant by its name alone: "
            f"{shipped.name}"
        )
    return shipped


# --- the file -------------------------------------------------------------------------------------


@dataclass
class Argument:
    name: str
    default: str | None
    description: str


@dataclass
class NodeAction:
    executable: str
    name: str
    namespace: str
    parameters: list  # in order: ParameterFile or (name, value)
    remappings: list[tuple[str, str]]
    file: Path = Path()  # the launch file


@dataclass
class Plan:
    """What a launch file, with its arguments filled in, asks for."""

    nodes: list[NodeAction] = field(default_factory=list)
    commands: list[list[str]] = field(default_factory=list)
    arguments: dict[str, Argument] = field(default_factory=dict)


_KEYS = {  # entity -> keys that are understood; of these, the last tuple's say nothing in-process
    "arg": ({"name", "default", "description"}, set()),
    "let": ({"name", "value"}, set()),
    "node": ({"pkg", "exec", "name", "namespace", "param", "remap", "if", "unless"}, {"output"}),
    "executable": ({"cmd", "if", "unless"}, {"output", "name"}),
    "include": ({"file", "arg", "if", "unless"}, set()),
}


def read_plan(path, arguments: dict[str, str]) -> Plan:
    """Read a launch file and fill in its arguments.

    Raises:
        LaunchError: an unknown entity, key, substitution or argument, or a value that is missing.
    """
    plan = Plan()
    _read_file(str(path), arguments, plan, _Read())
    return plan


@dataclass
class _Read:
    """What the files of one launch share while they are read."""

    anonymous: dict[str, str] = field(default_factory=dict)
    parameter_files: dict[str, ParameterFile] = field(default_factory=dict)
    including: list[str] = field(default_factory=list)  # the file being read, and those around it
    files: int = 0


def _read_file(name: str, given: dict[str, str], plan: Plan, read: _Read) -> None:
    path = Path(name)
    try:
        data = read_yaml(name)
    except OSError as error:
        raise LaunchError(f"launch file {path}: {error.strerror}") from error
    except FileError as error:
        raise LaunchError(f"launch file {error}") from error
    here = os.path.realpath(path)
    if here in read.including:
        raise LaunchError(f"launch file {path}: includes itself, by {read.including[-1]}")
    read.files += 1
    if read.files > _MAX_FILES:
        raise LaunchError(f"launch file {path}: one too many: must be at most {_MAX_FILES}")
    read.including.append(here)
    if (
        not isinstance(data, dict)
        or set(data) != {"launch"}
        or not isinstance(data["launch"], list)
    ):
        raise LaunchError(f"launch file {path}: must hold one list named launch")
    variables = {}
    declared = {}

    def fill(value, key):
        text = _substitute(_text(value, path, key), variables, path, read.anonymous)
        if len(text) > _MAX_TEXT:
            raise LaunchError(
                f"{path}: {key} = {shorten(text)}: must be at most {_MAX_TEXT} characters"
            )
        return text

    for entity in data["launch"]:
        if not isinstance(entity, dict) or len(entity) != 1:
            raise LaunchError(f"{path}: {shorten(entity)}: must be one of {', '.join(_KEYS)}")
        ((kind, body),) = entity.items()
        if kind not in _KEYS:
            raise LaunchError(f"{path}: {kind}: not understood; must be one of {', '.join(_KEYS)}")
        if not isinstance(body, dict):
            raise LaunchError(f"{path}: {kind}: must map keys to values")
        known, ignored = _KEYS[kind]
        unknown = sorted(set(body) - known - ignored)
        if unknown:
            raise LaunchError(
                f"{path}: {kind}: key {unknown[0]!r} is not understood; "
                f"must be one of {', '.join(sorted(known | ignored))}"
            )
        if not _wanted(body, fill, path, kind):
            continue
        if kind == "arg":
            name, default = _name(body, path, kind), body.get("default")
            if name in declared:
                raise LaunchError(f"{path}: arg: name = {name!r}: there are two of this name")
            declared[name] = Argument(
                name,
                None if default is None else fill(default, "arg: default"),
                _text(body.get("description", ""), path, "arg: description"),
            )
            value = given.get(name, declared[name].default)
            if value is None:
                raise LaunchError(f"{path}: argument {name} has no default: give {name}:=value")
            variables[name] = value
        elif kind == "let":
            name = _name(body, path, kind)
            variables[name] = fill(_need(body, "value", path, kind), "let: value")
        elif kind == "executable":
            plan.commands.append(_command(fill(_need(body, "cmd", path, kind), "cmd"), path))
        elif kind == "include":
            passed = {}
            for item in _maps(body, "arg", path, kind):
                if set(item) != {"name", "value"}:
                    raise LaunchError(f"{path}: include: arg {shorten(item)}: needs name and value")
                name = _name(item, path, "include: arg")
                if name in passed:
                    raise LaunchError(f"{path}: include: arg {name!r}: is given twice")
                passed[name] = fill(item["value"], f"include: arg {name}")
            _read_file(fill(_need(body, "file", path, kind), "include: file"), passed, plan, read)
        else:
            plan.nodes.append(_node(body, fill, path, read))
    unknown = sorted(set(given) - set(declared))
    if unknown:
        allowed = ", ".join(declared) or "none"
        raise LaunchError(f"{path}: argument {unknown[0]!r} is unknown; there are: {allowed}")
    read.including.pop()
    if not read.including:
        plan.arguments = declared


_ARGUMENT = re.compile(r"[\w.-]+", re.ASCII)
_NODE_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_NAMESPACE = re.compile(r"/?([A-Za-z_]\w*(/[A-Za-z_]\w*)*/?)?", re.ASCII)
_TOPIC = re.compile(r"(~?/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def _text(value, path: Path, key: str) -> str:
    """A value that stands for a text."""
    if not isinstance(value, (str, int, float)):
        raise LaunchError(f"{path}: {key} = {shorten(value)}: must be text or a number")
    return str(value)


def _name(body: dict, path: Path, kind: str) -> str:
    """The name of an argument, as $(var x) and x:=value can have it."""
    name = _need(body, "name", path, kind)
    if not isinstance(name, str) or not _ARGUMENT.fullmatch(name):
        raise LaunchError(
            f"{path}: {kind}: name = {shorten(name)}: must be of letters, digits and _.-"
        )
    return name


def _command(text: str, path: Path) -> list[str]:
    try:
        words = shlex.split(text)
    except ValueError as error:  # an open quote
        raise LaunchError(f"{path}: executable: cmd = {shorten(text)}: {error}") from error
    if not words or not words[0]:
        raise LaunchError(f"{path}: executable: cmd = {shorten(text)}: must name a program")
    return words


def _need(body: dict, key: str, path: Path, kind: str):
    if key not in body:
        raise LaunchError(f"{path}: {kind}: needs the key {key!r}")
    return body[key]


def _maps(body: dict, key: str, path: Path, kind: str) -> list[dict]:
    items = body.get(key, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise LaunchError(f"{path}: {kind}: {key} = {shorten(items)}: must be a list of maps")
    return items


def _wanted(body: dict, fill, path: Path, kind: str) -> bool:
    for key, wish in (("if", True), ("unless", False)):
        if key in body:
            text = fill(body[key], f"{kind}: {key}").strip().lower()
            if text not in ("true", "false", "1", "0"):
                raise LaunchError(f"{path}: {kind}: {key} = {shorten(text)}: must be true or false")
            if (text in ("true", "1")) is not wish:
                return False
    return True


def _node(body: dict, fill, path: Path, read: _Read) -> NodeAction:
    package, executable = (
        fill(_need(body, key, path, "node"), f"node: {key}") for key in ("pkg", "exec")
    )
    if package != PACKAGE or executable not in NODES:
        raise LaunchError(
            f"{path}: node {package}/{executable}: in-process there are only "
            f"{', '.join(f'{PACKAGE}/{name}' for name in NODES)}; start others as executable"
        )
    where = f"{path}: node {executable}"

    def named(value, key, pattern, allowed):
        """Of text that ROS takes as a name, filled in."""
        if isinstance(value, str) and pattern.fullmatch(text := fill(value, f"node: {key}")):
            return text
        raise LaunchError(f"{where}: {key} = {shorten(value)}: must be {allowed}")

    parameters = []
    for item in _maps(body, "param", path, "node"):
        if set(item) == {"from"}:
            name = fill(item["from"], "param: from")
            if name not in read.parameter_files:  # one serves all nodes
                read.parameter_files[name] = ParameterFile(name)
            parameters.append(read.parameter_files[name])
        elif set(item) == {"name", "value"}:
            name = named(item["name"], "param: name", _ARGUMENT, "a parameter's name")
            if any(isinstance(other, tuple) and other[0] == name for other in parameters):
                raise LaunchError(f"{where}: param {name} is given twice")
            value = item["value"]
            if isinstance(value, str):  # ROS 2 reads a value that comes from a substitution as YAML
                text = fill(value, f"param {name}")
                try:
                    value = parse_yaml(text, f"{where}: param {name} = {shorten(text)}")
                except FileError as error:
                    raise LaunchError(str(error)) from error
            parameters.append((name, value))
        else:
            raise LaunchError(f"{where}: param {shorten(item)}: needs from, or name, value")
    remappings = []
    for item in _maps(body, "remap", path, "node"):
        if set(item) != {"from", "to"}:
            raise LaunchError(f"{where}: remap {shorten(item)}: needs from and to")
        pair = (named(item[key], f"remap: {key}", _TOPIC, "a topic") for key in ("from", "to"))
        remappings.append(tuple(pair))
    if len(dict(remappings)) < len(remappings):
        raise LaunchError(f"{where}: remap: two from one topic: {shorten(remappings)}")
    name = body.get("name", executable)
    name = named(name, "name", _NODE_NAME, "of letters, digits and _, no digit first")
    namespace = named(body.get("namespace", ""), "namespace", _NAMESPACE, "names between slashes")
    return NodeAction(executable, name, namespace, parameters, remappings, path)


_SUBSTITUTION = re.compile(r"\$\(([\w-]+)((?:\s+[^()\s]+)*)\)")


def _substitute(text: str, variables: dict, path: Path, anonymous: dict) -> str:
    """Fill in $(var x), $(env X default), $(dirname), $(anon x), $(find-pkg-share pkg) and
    $(exec-in-pkg x pkg)."""

    def value(match: re.Match) -> str:
        kind, words = match[1], match[2].split()
        if kind == "var" and len(words) == 1:
            if words[0] not in variables:
                known = ", ".join(variables) or "none"
                raise LaunchError(f"{path}: $(var {words[0]}): not known here; there are: {known}")
            return variables[words[0]]
        if kind == "env" and len(words) in (1, 2):
            found = os.environ.get(*words)
            if found is None:
                raise LaunchError(f"{path}: $(env {words[0]}): not set, and no default given")
            return found
        if kind == "dirname" and not words:
            return str(path.resolve().parent)
        if kind == "anon" and len(words) == 1:
            name = f"{words[0]}_{os.getpid()}_{uuid.uuid4().hex[:8]}"
            return anonymous.setdefault(words[0], name)
        if kind == "find-pkg-share" and words == [PACKAGE]:
            return str(share_dir())
        if kind == "exec-in-pkg" and len(words) == 2 and words[1] == PACKAGE:
            return _executable(words[0], path)
        raise LaunchError(
            f"{path}: {match[0]}: not understood; must be $(var x), $(env X [default]), "
            f"$(dirname), $(anon x), $(find-pkg-share {PACKAGE}) or $(exec-in-pkg x {PACKAGE})"
        )

    filled = _SUBSTITUTION.sub(value, text)
    if "$(" in filled:
        raise LaunchError(f"{path}: {text!r}: a substitution that is not understood")
    return filled


def _executable(name: str, path: Path) -> str:
    """How to start a program of the package: as colcon or pip installed it, else by this Python."""
    if name not in ("tactile-skin", *NODES):
        there = ", ".join(("tactile-skin", *NODES))
        raise LaunchError(f"{path}: {PACKAGE} has no program {name!r}; there are: {there}")
    built = share_dir().parents[1] / "lib" / PACKAGE / name
    if built.exists():
        return shlex.quote(str(built))
    if name not in NODES and shutil.which(name, path=_path()):
        return name
    module = f"{PACKAGE}.ros {name}" if name in NODES else PACKAGE
    return f"{shlex.quote(sys.executable)} -m {module}"


# --- the running skin -----------------------------------------------------------------------------


class Skin:
    """The nodes and commands of a launch file, running until `spin` ends; use it with `with`.

    Attributes:
        node: for subscriptions of your own; its callbacks have a thread of their own.
    """

    def __init__(self, plan: Plan, context: Context | None = None):
        self._context = context or Context()
        self._executor = MultiThreadedExecutor()
        self._plan = plan
        self._handles: list[Node] = []
        self._nodes: list = []
        self._processes: list[subprocess.Popen] = []
        self._hooks: list[StopHook | EventHook] = []
        self._settings = contextlib.ExitStack()  # of the process; closed, they are as before
        self._log: QueuedLog | None = None
        self._ended = False
        self.node = Node("user", context=self._context)

    def __enter__(self) -> Skin:
        try:
            self._enter()
            SIGNALS.raise_pending()
            return self
        except BaseException:
            self.__exit__()
            raise

    @SIGNALS.deferred  # what raised in a callback from C, of threadpoolctl say, would be lost
    def _enter(self) -> None:
        SIGNALS.enter()
        atexit.register(self._end)  # for who never comes to __exit__
        self._log = QueuedLog.before(logging.getLogger(PACKAGE))
        for command in self._plan.commands:
            self._processes.append(start_command(command))
        self.build()
        # The matrices are small. More threads than one would spin beside it, and on a small
        # computer keep the other nodes waiting for a tenth of a second.
        self._settings.enter_context(one_thread())
        # The default, 5 ms, is longer than a frame's whole way to the stop.
        self._settings.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(0.0005)
        for handles in (*self._stages(), [self.node]):
            self._executor.add_node(*handles)

    def _stages(self) -> list[list[Node]]:
        """The nodes by thread: a skin's compensation and its features share one."""
        groups: dict = {}
        for handle, action in zip(self._handles, self._plan.nodes, strict=True):
            shared = action.executable in _ONE_THREAD
            key = handle.get_namespace() if shared else handle.get_fully_qualified_name()
            groups.setdefault((shared, key), []).append((action.executable, handle))
        order = {name: k for k, name in enumerate(NODES)}
        return [
            [handle for _, handle in sorted(group, key=lambda item: order[item[0]])]
            for group in groups.values()
        ]

    def build(self) -> None:
        """Make the nodes and check what they are given; nothing runs yet.

        Raises:
            ValueError: a name or a value that is wrong; the message names it.
        """
        for action in self._plan.nodes:
            SIGNALS.raise_pending()  # the last one took a while
            handle = self._handle(action)
            name = handle.get_fully_qualified_name()
            if any(name == other.get_fully_qualified_name() for other in self._handles):
                raise LaunchError(f"{action.file}: node {name}: there are two of this name")
            self._handles.append(handle)
            with _naming_its_file(action, name):
                self._nodes.append(node_class(action.executable)(handle))
        self._check_overrides()
        self._check_commands()

    @SIGNALS.deferred
    def __exit__(self, *_) -> None:
        """End, with stop as the last word; a signal that comes meanwhile waits for it."""
        self._end()
        SIGNALS.raise_pending()

    @SIGNALS.deferred
    def _end(self) -> None:
        if self._ended:
            return
        self._ended = True
        now = time.monotonic()
        until, patience, hurry = (now + s for s in (_END_WITHIN, _PATIENCE, _HURRY))
        self._context.try_shutdown()
        for hook in self._hooks:
            if isinstance(hook, StopHook):
                hook.end()
        self._close_nodes(until)
        for process in self._processes:  # the board after the last word; it ends beside the hooks
            process.terminate()
        for hook in self._hooks:
            hook.close(max(0.0, until - time.monotonic()))
        self._executor.shutdown(max(0.0, until - time.monotonic()))
        self._settings.close()
        end_commands(self._processes, lambda: hurry if SIGNALS.acted else patience)
        if self._log is not None:
            self._log.close()
        atexit.unregister(self._end)
        if SIGNALS.acted:
            gc.freeze()  # the interpreter ends 0.1 s sooner if it need not look at all of NumPy
        SIGNALS.leave()

    def _close_nodes(self, until: float) -> None:
        """In the way of the data: what is on its way still arrives.

        A close that hangs, on a terminal that takes nothing say, does not keep the others.
        """
        drained = min(until, time.monotonic() + _CLOSE_WITHIN)
        for handle, node in zip(self._handles, self._nodes, strict=False):
            if not hasattr(node, "close"):
                continue
            closing = threading.Thread(
                target=_close, args=(handle, node), name="skin close", daemon=True
            )
            try:
                closing.start()
            except RuntimeError:  # the interpreter is ending, and starts no more threads
                _close(handle, node)
            else:
                closing.join(max(0.0, min(_CLOSE_WITHIN, until - time.monotonic())))
            self._executor.drain(max(0.0, drained - time.monotonic()))

    def spin(self, timeout: float | None = None) -> None:
        """Wait until a node ends the launch, a command fails, a signal asks for the end, or
        `timeout` seconds went by.

        Raises:
            LaunchError: a command of the launch file ended by itself with an error.
            KeyboardInterrupt, SystemExit: a signal has ended an earlier `spin`.
        """
        if SIGNALS.asked is not None:
            raise unwinding(SIGNALS.asked)
        end = math.inf if timeout is None else time.monotonic() + timeout
        with SIGNALS.spinning():
            # Not by waiting for an event: a signal handler that sets it would wait for its lock.
            while self._context.ok() and (left := end - time.monotonic()) > 0.0:
                if SIGNALS.asked is not None:
                    self.shutdown()
                    return
                for process in self._processes:
                    if process.poll() not in (None, 0):
                        raise LaunchError(
                            f"{shlex.join(process.args)}: ended with {process.returncode}"
                        )
                time.sleep(min(_LOOK, left))

    def shutdown(self) -> None:
        """Make `spin` return."""
        self._context.try_shutdown()

    @property
    def failed(self) -> bool:
        """Whether a node says that the run was in vain."""
        return any(getattr(node, "failed", False) for node in self._nodes)

    def on_stop(self, hook: Callable[[bool, str], None], heartbeat: float | None = None) -> None:
        """Call hook(stop, reason) now and at each change, in a thread of its own: see hooks.py.

        With several stop nodes, any of them stops.

        Args:
            heartbeat: call it at least this often, also while nothing changes [s], so that what
                drives the motors can stop them when this process is killed or hangs.

        Raises:
            LaunchError: the launch file starts no stop_on_push.
            ValueError: `heartbeat` is not above 0, or not finite.
        """
        topics = [
            handle.resolve_topic_name(STATUS_TOPIC) for handle in self._started("stop_on_push")
        ]
        clock = self._context.clock
        stop_hook = StopHook(hook, topics, clock, heartbeat)
        self._hooks.append(stop_hook)
        node = Node(f"stop_hook_{len(self._hooks)}", context=self._context)

        def listener(topic: str):
            def on_status(message: DiagnosticArray) -> None:
                stop_hook.hear(topic, word_of(message, clock.now().nanoseconds / 1e9))

            return on_status

        for topic in topics:
            node.create_subscription(DiagnosticArray, topic, listener(topic), STATUS)
        self._executor.add_node(node)

    def on_push(self, hook: Callable) -> None:
        """Call hook(force, centre) when a push begins, in a thread of its own: see events.py.

        force: (3,) [N], on the robot; centre: (3,) [m]; both in the base frame.

        Raises:
            LaunchError: the launch file starts no stop_on_push.
        """
        self._on_event(hook, Pushed, PushListener, "stop_on_push")

    def on_release(self, hook: Callable) -> None:
        """Call hook(seconds) when a push is over, with how long it lasted; else as `on_push`."""
        self._on_event(hook, Released, PushListener, "stop_on_push")

    def on_stroke(self, hook: Callable) -> None:
        """Call hook(velocity, confidence) when a stroke along the skin begins.

        velocity: (3,) [m/s], in the base frame; confidence: 0 to 1.

        Raises:
            LaunchError: the launch file starts no gesture_feature.
        """
        self._on_event(hook, Stroked, StrokeListener, "gesture_feature")

    def _on_event(self, hook: Callable, kind: type, listener, executable: str) -> None:
        nodes = self._started(executable)
        event_hook = EventHook(hook)
        self._hooks.append(event_hook)

        def tell(event):
            if isinstance(event, kind):
                event_hook.tell(*event)

        for handle in nodes:
            here = handle.get_namespace().strip("/")
            pairs = [
                pair
                for action in self._plan.nodes
                if action.namespace.strip("/") == here
                for pair in action.remappings
            ]
            name = f"{kind.__name__.lower()}_hook_{len(self._hooks)}"
            node = Node(name, context=self._context, namespace=here, cli_args=_remaps(pairs))
            listener(node, tell)
            self._executor.add_node(node)

    def reset_stop(self, timeout: float = 1.0) -> tuple[bool, str]:
        """Ask every stop node to end its latched stop: whether all did, and what they say.

        Before, each compensation is asked to forget the faults that its last frames no longer
        show. A stop whose cause lasts stays. Waits `timeout` [s] for each answer.

        Raises:
            LaunchError: the launch file starts no stop_on_push.
        """
        stops = self._started("stop_on_push")
        # Each says on diagnostics how it is before it answers, and a stop node takes what came
        # first first: its own reset finds that said.
        forgotten = [self._reset(handle, timeout) for handle in self._of_kind("compensation")]
        silent = [a for a in forgotten if not a.success]
        answers = silent or [self._reset(handle, timeout) for handle in stops]
        return all(a.success for a in answers), "; ".join(a.message for a in answers)

    def _reset(self, handle: Node, timeout: float):
        """The answer of the node's service ~/reset."""
        name = f"{handle.get_fully_qualified_name()}/reset"
        future = self.node.create_client(Trigger, name).call_async(Trigger.Request())
        try:
            return future.result(timeout)
        except concurrent.futures.TimeoutError:
            future.cancel()  # a reset that was given up must not free the robot later
            return Trigger.Response(False, f"{name} does not answer")

    def _started(self, executable: str) -> list[Node]:
        """The nodes of a kind, of which there must be one."""
        found = self._of_kind(executable)
        if not found:
            raise LaunchError(f"the launch file starts no {executable}")
        return found

    def _of_kind(self, executable: str) -> list[Node]:
        return [
            handle
            for action, handle in zip(self._plan.nodes, self._handles, strict=False)
            if action.executable == executable
        ]

    def _handle(self, action: NodeAction) -> Node:
        full_name = f"{action.namespace}/{action.name}"
        values: dict[str, Parameter] = {}
        for item in action.parameters:
            if isinstance(item, ParameterFile):
                found = item.overrides(full_name)
            else:
                found = [Parameter(*item)]
            values |= {p.name: p for p in found}
        return Node(
            action.name,
            context=self._context,
            cli_args=_remaps(action.remappings),
            namespace=action.namespace,
            parameter_overrides=list(values.values()),
        )

    def _check_overrides(self) -> None:
        """Refuse names in parameter files and launch files that no node knows."""
        declared = {name for handle in self._handles for name in handle.parameter_names()}
        names = {h.get_fully_qualified_name() for h in self._handles}
        # One file may serve several launches: sections of nodes that this one does not start.
        absent = {f"/{name}" for name in set(NODES) - {a.executable for a in self._plan.nodes}}
        for action, handle in zip(self._plan.nodes, self._handles, strict=True):
            own = set(handle.undeclared())
            for item in action.parameters:
                if not isinstance(item, ParameterFile):
                    if item[0] in own:
                        raise _unknown(str(action.file), item[0], handle.parameter_names())
                    continue
                for section, values in item.sections.items():
                    shared = [k for k in values if k.split(".")[0] in _SHARED]
                    if section != "/**" and shared:
                        raise LaunchError(
                            f"{item.path}: {section}: {shared[0]}: belongs under /**, since "
                            "several nodes must agree on it"
                        )
                    full = "/" + section.lstrip("/")
                    if section != "/**" and full not in names | absent:
                        there = ", ".join(sorted(name[1:] for name in names))
                        raise LaunchError(
                            f"{item.path}: {section}: no such node in this launch; "
                            f"there are: {there}"
                        )
                    mine = full == handle.get_fully_qualified_name()
                    allowed = declared if section == "/**" else set(handle.parameter_names())
                    unknown = sorted(set(values) - allowed)
                    if unknown and (mine or section == "/**"):
                        raise _unknown(f"{item.path}: {section}", unknown[0], allowed)

    def _check_commands(self) -> None:
        """Refuse two nodes that would command one base in turns."""
        senders: dict[str, str] = {}
        for handle in self._handles:
            for publisher in handle._publishers:
                if publisher.msg_type is Twist:
                    topic, name = publisher.topic_name, handle.get_name()
                    if topic in senders:
                        raise LaunchError(
                            f"{topic}: {senders[topic]} and {name} both publish it: start one of "
                            "them, or remap each to an input of a multiplexer"
                        )
                    senders[topic] = name


@contextlib.contextmanager
def _naming_its_file(action: NodeAction, full_name: str):
    """Put the file that a refused parameter or remapping is from in front of the error."""
    try:
        yield
    except TopicTypeError as error:
        raise LaunchError(f"{action.file}: node {full_name}: {error}: check remap") from error
    except ValueError as error:
        words = set(re.findall(r"\w+", str(error)))
        for item in reversed(action.parameters):
            if isinstance(item, ParameterFile):
                names, file = [p.name for p in item.overrides(full_name)], item.path
            else:  # other errors, of the port say, are not the launch file's
                names, file = [item[0]], action.file if isinstance(error, ParameterError) else None
            if any(name.split(".")[-1] in words for name in names):
                if file is None:
                    break
                raise LaunchError(f"{file}: {error}") from error
        raise


def _remaps(pairs: list[tuple[str, str]]) -> list[str]:
    return [word for pair in pairs for word in ("-r", ":=".join(pair))]


def _unknown(where: str, key: str, allowed) -> LaunchError:
    return LaunchError(
        f"{where}: parameter {key!r} is unknown; there are: {', '.join(sorted(allowed))}"
    )


def _close(handle: Node, node) -> None:
    try:
        node.close()
    except Exception:  # a closed stdout, say
        handle.get_logger().exception("close() raised")


def node_class(executable: str):
    module, name = NODES[executable].split(".")
    return getattr(importlib.import_module(f".nodes.{module}", __package__), name)


def _path() -> str:
    return os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])


def start_command(command: list[str]) -> subprocess.Popen:
    """Start a command; the tools of this Python's environment come first on its PATH."""
    try:
        return subprocess.Popen(
            command,
            # Ends with this process, however that ends: who finds LAUNCHED may wait for it.
            stdin=subprocess.PIPE,
            env=os.environ | {"PATH": _path(), LAUNCHED: str(os.getpid())},
            # a session of its own: Ctrl-C ends the nodes first, and they end the command
            start_new_session=True,
        )
    except OSError as error:
        raise LaunchError(f"executable {shlex.join(command)}: {error.strerror}") from error


def end_commands(processes: list[subprocess.Popen], deadline: Callable[[], float] | None = None):
    """Ask them to end, and kill those that have not at `deadline()`, a monotonic time [s].

    It is asked for again and again; None: 3 s from now.
    """
    patience = time.monotonic() + _PATIENCE
    for process in processes:
        process.terminate()
    while any(process.poll() is None for process in processes):
        if time.monotonic() >= (deadline() if deadline else patience):
            break
        time.sleep(0.005)
    for process in processes:
        process.kill()
        process.wait()
        process.stdin.close()


def launch(path=None, context: Context | None = None, **arguments) -> Skin:
    """The skin of a launch file, ready for `with`.

    Args:
        path: ROS 2 YAML launch file; None: the demo on a simulated board.
        arguments: of the launch file, as on the command line after ``:=``.
    """
    arguments = {key: str(value) for key, value in arguments.items()}
    return Skin(read_plan(find(path or "demo.launch.yaml"), arguments), context)
