# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin view`: a recording in the browser, or the skin of a launch file."""

from __future__ import annotations

import asyncio
import contextlib
import functools

from ..arguments import split

EXAMPLES = """\
FILE is what `launch record:=FILE` made. Without one, or with a launch file, this is `tactile-skin
launch ... view:=true`. Open the address that is printed. The page compares two methods, and of a
recording shows any time: press space, drag the slider, step with , and .
examples:
  tactile-skin view
  tactile-skin view skin.launch.yaml port:=/dev/ttyUSB0
  tactile-skin view touches.mcap
  tactile-skin view touches.mcap view_port:=8400 config:=my_skin.yaml
options for a recording, name:=value:
  view_host, view_port   address of the page (default 127.0.0.1, 8321; port 0: any that is free)
  config                 parameter file (default: the parameters that were recorded)
  namespace              of the skin, where several were recorded"""

_KINDS = {"view_host": str, "view_port": int, "config": str, "namespace": str}
_PORTS = range(65536)


def run(args) -> int:
    """Show a recording, or start a skin with its page."""
    files = [word for word in args.words if ":=" not in word]
    if files and not files[0].endswith((".yaml", ".yml")):
        return show(args.words)
    from . import launch

    args.words, args.show_args = [*args.words, "view:=true"], False
    return launch.run(args)


def register(parser) -> None:
    parser.add_argument(
        "words", nargs="*", metavar="FILE | NAME:=VALUE", help="recording or launch file; arguments"
    )


def show(words: list[str]) -> int:
    """Show the recording that the words name until Ctrl-C.

    Raises:
        ValueError: an unknown option, or a value that is not allowed.
        FileError, OSError: the recording cannot be read.
    """
    from .. import extras
    from ..middleware.config import read_skin
    from ..recording.reader import Recording
    from ..view.pictures import Pictures
    from ..view.process import address_of, listen
    from ..view.recorded import Recorded
    from ..view.server import Shown, serve

    files, given = split(words, _KINDS)
    if len(files) > 1:
        raise ValueError(f"one recording, not {len(files)}: {' '.join(files)}")
    (path,) = files
    recording = Recording(path, given.get("namespace", ""))
    skin = read_skin(given["config"]) if "config" in given else recording.skin

    port = given.get("view_port", 8321)
    if port not in _PORTS:
        raise ValueError(f"view_port:={port}: must be a whole number from 0 to {_PORTS[-1]}")
    host = given.get("view_host", "127.0.0.1")
    with listen(host, port) as listening:
        pictures = Pictures(skin)
        track = functools.partial(extras.track, desc=f"reading {path}")
        shown = Recorded(recording, pictures.push_of, track)
        shape = shown.shape
        if shape != skin.circuit.shape:
            raise ValueError(
                f"{path}: its readings are {shape[0]} x {shape[1]}, the configuration says "
                f"{skin.circuit.rows} x {skin.circuit.cols}: give config:=FILE"
            )
        print(f"{path} in a browser: {address_of(listening)} (Ctrl-C ends)", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(
                serve(listening, {"": Shown(shown, pictures)}, asyncio.Event(), False, host)
            )
    return 0
