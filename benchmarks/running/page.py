# SPDX-License-Identifier: Apache-2.0
"""How often the page of the running demo is drawn in Chromium, and what a draw costs.

Prints the snapshots that were drawn in a second and the processor time of each draw, in Chromium
(all its processes, without a GPU) and in the page's server. --space: with the cover in space.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from pathlib import Path

from support.chromium import Chromium

from tactile_skin import launch
from tactile_skin.nodes.observers.view import View

from .. import harness

SIZE = 1400, 910  # of the page [px]


def processor_time(pid: int) -> float:
    """Of a process and its children, so far [s]."""
    parents, ticks = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            fields = (folder / "stat").read_text().rsplit(") ", 1)[1].split()
            parents[int(folder.name)] = int(fields[1])
            ticks[int(folder.name)] = int(fields[11]) + int(fields[12])
    total, todo = 0, [pid]
    while todo:
        each = todo.pop()
        total += ticks.get(each, 0)
        todo += [child for child, parent in parents.items() if parent == each]
    return total / os.sysconf("SC_CLK_TCK")


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--seconds", type=float, default=20.0, help="to measure (default 20)")
    parser.add_argument("--space", action="store_true", help="with the cover in space")
    args = parser.parse_args(arguments)
    arguments = {"method": "auto", "view": "true", "view_port": "0", "monitor": "false"}
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        Chromium(Path(folder), *SIZE) as browser,
        launch.launch(**arguments) as skin,
    ):
        view = next(node for node in skin._nodes if isinstance(node, View))
        browser.open(view._page.address)
        if args.space:
            browser.click("button", "in space")
        skin.spin(2.0)
        pids = browser._process.pid, view._page._process.pid
        before, frames, start = [*map(processor_time, pids)], drawn(browser), time.monotonic()
        skin.spin(args.seconds)
        frames, seconds = drawn(browser) - frames, time.monotonic() - start
        used = [1e3 * (processor_time(p) - b) / frames for p, b in zip(pids, before, strict=True)]
        print(f"{frames / seconds:.1f} draws a second, load {os.getloadavg()[0]:.1f}")
        print(f"{used[0]:.1f} ms a draw in Chromium, {used[1]:.1f} ms in the page's server")
        assert not browser.errors, browser.errors


def drawn(browser: Chromium) -> int:
    """Snapshots that the page has drawn."""
    return browser.run("Number(document.body.dataset.draws)")


if __name__ == "__main__":
    harness.run(main)
