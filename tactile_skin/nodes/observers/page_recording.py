# SPDX-License-Identifier: Apache-2.0
"""A recording that a page begins and ends, and downloads."""

from __future__ import annotations

import contextlib
import functools
import tempfile
from pathlib import Path

from ...middleware.plan import parameters_of
from ...recording import cdr, configuration
from ...recording.recorder import Limits, Recorder

RECORDS = ("record", "finish")  # what a page asks for
_LIMITS = Limits(duration=600.0, size=64e6)  # s, bytes
_CLOSE = 2.0  # s that the disk has for what is left


class PageRecording:
    """All topics of the skin's namespace, as often as they come, and its nodes' parameters.

    Args:
        node: that hears them.
        space: the skin's namespace within the node's, with a slash; empty: they are one. The
            attribute: its full name.
    """

    def __init__(self, node, space: str):
        self.node = node
        self.space = node.resolve_topic_name(f"{space}skin/adc").removesuffix("skin/adc")
        self._recorder: Recorder | None = None
        self._heard: set[str] = set()
        self._done = ""

    def ask(self, name: str) -> tuple[bool, str]:
        """Begin or end; return whether that was possible, and why."""
        if name == "record":
            return self._begin()
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return False, "nothing is recorded"
        recorder.close(_CLOSE)
        if recorder.broken:
            return False, recorder.trouble
        self._done = str(recorder.store.files[0])
        return True, recorder.trouble or f"{recorder.store.written} messages are recorded"

    def take(self) -> str:
        """Return the file that has just been finished; empty: there is none."""
        done, self._done = self._done, ""
        return done

    def _begin(self) -> tuple[bool, str]:
        if self._recorder is not None:
            return False, "a recording is on already"
        attached = configuration.attachments(parameters_of(self.node.context, self.space))
        path = Path(tempfile.mkdtemp(prefix="tactile_skin_")) / "recording.mcap"
        try:
            self._recorder = Recorder(path, _LIMITS, attached, self._now)
        except (ModuleNotFoundError, OSError) as error:
            return False, str(error)
        self._recorder.start()
        for topic, kind in cdr.new_topics(self.node, self._heard):
            if topic.startswith(self.space) or topic == "/diagnostics":
                self.node.create_listener(kind, topic, functools.partial(self._take, topic))
        return True, "recording; press again to end it"

    def _take(self, topic: str, message) -> None:
        if (recorder := self._recorder) is not None:
            recorder.put(topic, self._now(), message)

    def _now(self) -> int:
        return self.node.get_clock().now().nanoseconds

    def close(self) -> None:
        """Give up what is recorded: no page will download it."""
        if self._recorder is not None:
            self._recorder.close(0.0)
            for path in self._recorder.store.files:
                with contextlib.suppress(OSError):
                    path.unlink()
