# SPDX-License-Identifier: Apache-2.0
"""recorder: all topics -> an MCAP file."""

from __future__ import annotations

import functools

from ...middleware.config import declared
from ...middleware.plan import parameters_of
from ...msg import Bool
from ...parameters.nodes import Recorder as Parameters
from ...recording import cdr, configuration
from ...recording.recorder import Limits, Recorder
from .. import diagnostics

_CLOSE = 0.1  # s that the disk has at the end; what it takes longer it does in the background,
_STALLED = 0.3  # s without a message that it took, after which the end of the process cuts it


class RecorderNode:
    """Records every topic of its process, also those that appear later.

    It never holds the others up: they put their messages into a queue that a thread of the
    recorder's own looks at now and then. What the disk cannot take is dropped and counted, and a
    full one ends the recording with a warning in diagnostics, not with a stop.
    """

    def __init__(self, node):
        self.node = node
        given = declared(node, Parameters)
        self._path = given.path
        limit = {"duration": given.max_duration, "size": given.max_size * 1e6}
        self._limits = Limits(**{k: v for k, v in limit.items() if v}, last=given.last)
        self._heard: set[str] = set()
        self._stopped: dict[str, bool] = {}
        self._recorder: Recorder | None = None
        self._said = ""
        self._diagnostics = diagnostics.Reporter(node)

    def begin(self) -> None:
        """Make the file, with the parameters of all nodes, and record from here on.

        Raises:
            FileError, OSError: it cannot be made.
            ModuleNotFoundError: the libraries for it are not installed.
        """
        attached = configuration.attachments(parameters_of(self.node.context))
        self._recorder = Recorder(self._path, self._limits, attached, self._now)
        self._recorder.start()
        self._listen()
        self.node.create_timer(1.0, self._on_second)

    def _now(self) -> int:
        return self.node.get_clock().now().nanoseconds

    def _on_second(self) -> None:
        self._listen()
        self._report()

    def _listen(self) -> None:
        """Subscribe to the topics that are new."""
        for topic, kind in cdr.new_topics(self.node, self._heard):
            self.node.create_listener(kind, topic, functools.partial(self._take, topic))

    def _take(self, topic: str, message) -> None:
        t = self._now()
        if self._recorder is not None:
            self._recorder.put(topic, t, message)
        if topic.endswith("/skin/stop"):
            self._on_stop(topic, t, message)

    def _on_stop(self, topic: str, t: int, message: Bool) -> None:
        """Keep a stop that begins; that of the start, or of the end, is no incident."""
        begins = message.data and not self._stopped.get(topic, True)
        if self._recorder is not None and begins and self.node.context.ok():
            self._recorder.stop(t)
        self._stopped[topic] = message.data

    def _report(self) -> None:
        if (recorder := self._recorder) is None:
            return
        trouble = recorder.trouble
        if trouble and trouble != self._said:
            self.node.get_logger().warning("%s", trouble)
        self._said = trouble
        values = {
            "files": ", ".join(map(str, recorder.store.files)),
            "size": f"{recorder.store.size / 1e6:.1f} MB",
            "messages": recorder.store.written,
            "not_recorded": recorder.dropped,
        }
        level = diagnostics.WARN if trouble or recorder.dropped else diagnostics.OK
        message = trouble or "recording"
        if recorder.dropped and not trouble:
            message = f"the disk is too slow: {recorder.dropped} messages are not recorded"
        if level != diagnostics.OK:
            values[diagnostics.KIND] = "disk"
        self._diagnostics.publish(diagnostics.report(self.node, level, message, values))

    @property
    def failed(self) -> bool:
        """Whether the file lacks something, after a full disk say."""
        return bool(self._recorder and self._recorder.broken)

    def close(self) -> None:
        if self._recorder is not None:
            self._recorder.close(_CLOSE)
            self._report()  # the disk may have been full for what came last

    def finish(self) -> None:
        """After `close`, wait for the file's end for as long as the disk takes some of it."""
        if self._recorder is not None:
            self._recorder.finish(_STALLED)
