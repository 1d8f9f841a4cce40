# SPDX-License-Identifier: Apache-2.0
"""Start the nodes of a launch file of the package, and those of your own, in this process.

    with launch("skin.launch.yaml", port="/dev/ttyUSB0") as skin:
        skin.on_stop(lambda stop, reason: print(stop, reason))
        skin.spin()

A node of your own comes by `skin.add(Node, parameters)` before `with`, or stands under `nodes` in
the parameter file. Each skin of a body runs in a process of its own where there are several cores.
Other launch files are started by `ros2 launch`.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import logging
import math
import os
import shlex
import subprocess
import time
from collections.abc import Mapping, Sequence

from ..behaviours.hooks import StopHook
from ..errors import LaunchError
from ..middleware.bus import Context, Node
from ..middleware.launch_file import read_arguments, read_plan
from ..middleware.logs import QueuedLog
from ..middleware.package import BODY, PACKAGE, RECORDER, SKIN_NODES, VIEW, find, share_dir
from ..middleware.plan import (
    NodeAction,
    Plan,
    by_thread,
    check_commands,
    check_parameters,
    make_node,
    naming_its_file,
    user_node,
)
from ..middleware.process import ENDS, STARTS, SkinProcess
from ..middleware.signals import SIGNALS, unwinding
from ..middleware.threads import PACE, close_nodes
from ..msg import Trigger
from ..nodes import diagnostics
from ..nodes.observers.listening import NOT_YET, Listening

__all__ = [
    "LaunchError",
    "Plan",
    "Skin",
    "find",
    "launch",
    "read_arguments",
    "read_plan",
    "share_dir",
]


def __getattr__(name: str):
    # Here: half of a skin's start is the import of SciPy, and its simulated board can start before.
    if name in ("SkinConfig", "read_skin"):
        return getattr(importlib.import_module("..middleware.config", __package__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


_POLL = 0.02  # s between two checks of `spin` for signals, nodes and commands
# From a signal to the end of the process it takes a second at most, whatever hangs:
_END_WITHIN = 0.3  # s for all final messages, and for hooks to receive the stop
_HURRY = 0.5  # s after which commands of the launch file are killed, if a signal asked for the end
_PATIENCE = 3.0  # s, if none did: they may have something to save


class Skin(Listening):
    """The nodes and commands of a launch file, running until `spin` ends; use it with `with`.

    Attributes:
        node: for subscriptions of your own; its callbacks have a thread of their own.
    """

    def __init__(self, plan: Plan | None = None, context: Context | None = None):
        super().__init__(plan or Plan(), context or Context())
        self._nodes: list = []
        self._processes: list[subprocess.Popen] = []
        self._skins: list[SkinProcess] = []
        self._elsewhere: set[Node] = set()  # that stand for those of another process
        self._settings = contextlib.ExitStack()  # of the process; closed, it needs them no more
        self._log: QueuedLog | None = None
        self._ended = False
        self.node = Node("user", context=self._context)

    def add(
        self,
        node: type | str,
        parameters: Mapping[str, object] | None = None,
        *,
        name: str = "",
        namespace: str = "",
        remappings: Sequence[tuple[str, str]] = (),
    ) -> None:
        """Start another node with the others; call it before `with`.

        Args:
            node: a class that takes a Node handle, module.Class, or the name of one of the
                package's nodes.
            parameters: name -> value, over what the parameter file says under the node's name.
            name: of the node; "": that of the class.
            namespace: of its names.
            remappings: (from, to) of its topics and services.

        Raises:
            LaunchError: the nodes run already.
        """
        if self._began:
            raise LaunchError(f"{node}: the nodes run already: add it before `with`")
        files = self._plan.files()
        self._plan.add(user_node(node, parameters or {}, name, namespace, remappings, files))

    def __enter__(self) -> Skin:
        if self._began:
            raise LaunchError("started already: each `with` needs a skin of its own from launch()")
        self._began = True
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
            # in a session of its own: Ctrl-C ends the nodes first, and they end the command
            started = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
            self._processes.append(started)
        self.build()
        self._start_processes()
        for recorder in self._of_kind(RECORDER, self._nodes):
            recorder.begin()
        PACE.enter()
        self._settings.callback(PACE.leave)
        for handle in (*self._handles, self.node):
            if handle not in self._elsewhere:
                diagnostics.ensure_reported(handle)
        for handles in (*by_thread(self._plan.nodes, self._handles), [self.node]):
            self._executor.add_node(*handles)

    def _start_processes(self) -> None:
        """Let each skin of a body run in a process of its own, where there are several cores."""
        bodies = self._of_kind(BODY, self._handles)
        skins: dict[str, list[tuple]] = {}
        for each in zip(self._plan.nodes, self._handles, self._nodes, strict=True):
            if each[0].executable in SKIN_NODES:
                skins.setdefault(each[0].namespace, []).append(each)
        asked = any(body.get_parameter("separate").value for body in bodies)
        if not asked or len(skins) < 2 or (os.cpu_count() or 1) < 2:
            return
        for skin in skins.values():
            actions, handles, nodes = zip(*skin, strict=True)
            of = {a.executable: node for a, node in zip(actions, nodes, strict=True)}
            if stop := of.get("stop_on_push"):
                self._skins.append(SkinProcess([*actions], [*handles], stop.absent))
                self._elsewhere |= {*handles}
        until = time.monotonic() + STARTS
        for process in self._skins:
            while not process.wait(_POLL) and time.monotonic() < until:
                SIGNALS.raise_pending()

    def build(self) -> list[Node]:
        """Make the nodes and check what they are given; nothing runs yet.

        Raises:
            ValueError: a name or a value that is wrong; the message names it.
        """
        from ..parameters.nodes import all_names

        names: dict[str, frozenset[str] | None] = {}
        for action in self._plan.nodes:
            name = action.full_name
            if name in names:
                raise LaunchError(f"{action.file}: node {name}: there are two of this name")
            kind = action.executable  # these say which they have once they are made
            later = not action.ours or kind in (BODY, VIEW)
            names[name] = None if later else all_names(kind)
        check_parameters(self._plan, names)
        for action in self._plan.nodes:
            SIGNALS.raise_pending()  # the last one took a while
            handle = self._make_node(action)
            made_by = action.made_by
            self._handles.append(handle)
            with naming_its_file(action):
                self._nodes.append(made_by(handle))
            if names[action.full_name] is None:
                names[action.full_name] = frozenset(handle.parameter_names())
        check_parameters(self._plan, names)
        check_commands(self._handles)
        return self._handles

    def _make_node(self, action: NodeAction) -> Node:
        return make_node(action, self._context)

    @SIGNALS.deferred
    def __exit__(self, *_) -> None:
        """Shut down with a final stop; a signal that arrives meanwhile waits for it."""
        self._end()
        SIGNALS.raise_pending()

    @SIGNALS.deferred
    def _end(self) -> None:
        if self._ended:
            return
        self._ended = True
        until, patience, hurry = (time.monotonic() + s for s in (_END_WITHIN, _PATIENCE, _HURRY))
        self._context.try_shutdown()
        for hook in self._hooks:
            if isinstance(hook, StopHook):
                hook.end()
        for skin in self._skins:
            skin.ask_to_end()
        last_words = time.monotonic() + ENDS
        for skin in self._skins:
            skin.end(last_words)
        parts = zip(self._plan.nodes, self._handles, self._nodes, strict=False)
        here = [  # and stops that stand for others: theirs is the last word, whatever came of these
            (handle, node)
            for action, handle, node in parts
            if handle not in self._elsewhere or action.executable == "stop_on_push"
        ]
        close_nodes(here, self._executor.drain, until)
        for process in self._processes:  # the board after the final stop; it ends beside the hooks
            process.terminate()
        for hook in self._hooks:
            hook.close(max(0.0, until - time.monotonic()))
        self._executor.shutdown(max(0.0, until - time.monotonic()))
        if self._log is not None:
            self._log.close()
        self._settings.close()
        for process in self._processes:
            while (
                process.poll() is None and time.monotonic() < (hurry, patience)[not SIGNALS.acted]
            ):
                time.sleep(0.005)
            process.kill()
            process.wait()
        for recorder in self._of_kind(RECORDER, self._nodes):
            recorder.finish()  # its thread would end with the process, and cut the file
        atexit.unregister(self._end)
        if SIGNALS.acted:
            gc.freeze()  # the interpreter ends 0.1 s sooner if it need not look at all of NumPy
        SIGNALS.leave()

    def spin(self, timeout: float | None = None) -> None:
        """Wait until a node, a failed command, a signal or `timeout` [s] ends the launch.

        Raises:
            LaunchError: no node runs yet, or a command of the launch file ended with an error.
            KeyboardInterrupt, SystemExit: a signal has ended an earlier `spin`.
        """
        if not self._began:
            raise LaunchError(NOT_YET)
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
                        command = shlex.join(map(str, process.args))  # type: ignore[arg-type]
                        raise LaunchError(f"{command}: ended with {process.returncode}")
                time.sleep(min(_POLL, left))

    def shutdown(self) -> None:
        """Make `spin` return."""
        self._context.try_shutdown()

    @property
    def failed(self) -> bool:
        """Whether a node says that the run was in vain."""
        return any(getattr(node, "failed", False) for node in self._nodes)

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
        forgotten = [
            self._reset(handle, timeout) for handle in self._of_kind("compensation", self._handles)
        ]
        silent = [a for a in forgotten if not a.success]
        stops += self._of_kind(BODY, self._handles)  # last: it hears of the others
        answers = silent or [self._reset(handle, timeout) for handle in stops]
        return all(a.success for a in answers), "; ".join(a.message for a in answers)

    def _reset(self, handle: Node, timeout: float):
        """Return the answer of the node's service ~/reset."""
        name = f"{handle.get_fully_qualified_name()}/reset"
        try:
            return self.node.create_client(Trigger, name).call(Trigger.Request(), timeout)
        except TimeoutError:
            return Trigger.Response(False, f"{name} does not answer")


def launch(path=None, *, context: Context | None = None, **arguments) -> Skin:
    """Return the skin of a launch file, ready for `with`.

    Args:
        path: launch file of the package; None: that of `default_file`.
        arguments: of the launch file, as on the command line after ``:=``.

    Raises:
        LaunchError: another file, or an argument that is unknown or not allowed.
    """
    return Skin(read_plan(find(path or default_file(arguments)), arguments), context)


def default_file(arguments: Mapping[str, object]) -> str:
    """Return the launch file where none is named: a port is a real board's, else it is the demo."""
    return "skin.launch.yaml" if "port" in arguments else "demo.launch.yaml"
