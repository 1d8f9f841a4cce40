# SPDX-License-Identifier: Apache-2.0
"""Signals at a running skin: is its last word stop, and how soon is it gone?

Each run is a process of its own with a stop node, a velocity gate, a command and a stop hook, under
`spin()`, in a loop of the user's own, under `tactile-skin launch`, or entered and never left. It
drives, and is ended by SIGHUP, SIGINT or SIGTERM, or by two of them up to 10 ms apart, once it is
free or at any time since its start. What it says goes through a pipe, with os.write, so that no
word is lost.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import select
import signal
import time

from tactile_skin import cli, launch
from tactile_skin.msg import Bool, Header, PointCloud2, Twist, Vector3, cloud
from tactile_skin.nodes import cmd_vel_gate, stop_on_push  # noqa: F401 - loaded once, before forks
from tactile_skin.nodes.stop_on_push import LATCHED

from .. import harness

PLACES = "spin", "loop", "command line", "never left"
NUMBERS = signal.SIGHUP, signal.SIGINT, signal.SIGTERM
PATTERNS = [(n,) for n in NUMBERS] + list(itertools.product(NUMBERS, NUMBERS))
EXIT_WITHIN = 1.0  # s from the first signal to the end of the process
PATIENCE = 30.0  # s for a word that must come, and for the end
HANG = 20.0  # s that a hanging hook stays away
STOP, FREE = b"S", b"F"  # words of the hook
SAYS_STOP, SAYS_FREE = b"s", b"f"  # of skin/stop
STANDS, MOVES = b"z", b"m"  # of cmd_vel
ENTERS = b"e"


def made() -> launch.Skin:
    """A stop, a gate, and a command that would outlive them."""
    skin = launch.Skin(launch.Plan(commands=[["sleep", "600"]]))
    skin.add("stop_on_push", {"stale_after": 1.0})
    skin.add("cmd_vel_gate")
    return skin


# --- the process that is ended ---


def watch(skin, out: int, hang: bool = False) -> None:
    """Make the skin free and the robot move, and write every word to the pipe.

    Args:
        hang: with a second stop hook that hangs.
    """

    def record(kind, topic, is_stop, words):
        subscription = skin.node.create_subscription(kind, topic, lambda _: None, LATCHED)
        # in the thread of the publisher: nothing is lost at the end
        subscription.put = lambda message: os.write(out, words[not is_stop(message)])

    record(Bool, "skin/stop", lambda m: m.data, (SAYS_STOP, SAYS_FREE))
    record(Twist, "cmd_vel", lambda m: m == Twist(), (STANDS, MOVES))
    skin.on_stop(lambda stop, reason: os.write(out, STOP if stop else FREE))
    if hang:
        skin.on_stop(lambda stop, reason: time.sleep(HANG))
        skin.on_push(lambda force, centre: time.sleep(HANG))
    contacts = skin.node.create_publisher(PointCloud2, "skin/contacts", 10)
    planner = skin.node.create_publisher(Twist, "cmd_vel_in", 1)

    def feel():
        header = Header(skin.node.get_clock().now().to_msg(), "base_link")
        contacts.publish(cloud({key: [0.0] for key in ("x", "y", "z", "force", "peak")}, header))
        planner.publish(Twist(Vector3(0.1)))

    skin.node.create_timer(0.01, feel)


def live(place: str, out: int, hang: bool) -> int:
    """What a user's program does; returns its status."""
    os.write(out, ENTERS)
    if place == "command line":
        plan, plain = made()._plan, launch.Skin

        class Watched(plain):
            def __enter__(self):
                super().__enter__()
                watch(self, out, hang)
                return self

        launch.Skin, launch.read_plan = Watched, lambda *_: plan
        return cli.main(["launch"])
    if place == "never left":  # entered without `with`: the interpreter's end is the skin's
        watch(made().__enter__(), out, hang)
        while True:
            sum(range(1000))
    with made() as skin:
        watch(skin, out, hang)
        if place == "spin":
            skin.spin()
        else:
            while True:
                sum(range(1000))
    return 0


# --- who ends it ---


def kill(pid: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def end(pid: int, words: int, pattern, gap: float, early: float | None, pause: float) -> dict:
    """Send the signals, and wait for the end.

    Args:
        words: the pipe to read from.
        gap: between two signals [s].
        early: seconds after the start of the first signal; None: `pause` [s] after it is free.
    """
    said = b""

    def hear(until: float) -> bool:
        nonlocal said
        if select.select([words], [], [], max(0.0, until - time.monotonic()))[0]:
            more = os.read(words, 65536)
            said += more
            return bool(more)
        return True

    def wait_for(word: bytes) -> None:
        until = time.monotonic() + PATIENCE
        while word not in said:
            if not hear(until) or time.monotonic() > until:
                raise RuntimeError(f"no {word!r} in {said!r}")

    start = time.monotonic()
    wait_for(ENTERS)
    if early is None:
        wait_for(FREE)
        wait_for(MOVES)
        free = time.monotonic()
        time.sleep(pause)
    else:
        free = None
        time.sleep(early)
    first = time.monotonic()
    kill(pid, pattern[0])
    for number in pattern[1:]:
        while time.monotonic() < first + gap:
            pass
        kill(pid, number)
    until = time.monotonic() + PATIENCE
    while hear(until) and time.monotonic() < until:
        pass
    over = time.monotonic()  # the pipe's end: a process that is gone holds no pipe
    kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    return {
        "start": None if free is None else free - start,
        "exit": over - first,
        "status": os.waitstatus_to_exitcode(status),
        "bad": bad(said),
        "said": said[-40:].decode(),
    }


def bad(said: bytes) -> list[str]:
    """Which last words are not stop; of what never spoke there is none."""
    pairs = {"hook": STOP + FREE, "skin/stop": SAYS_STOP + SAYS_FREE, "cmd_vel": STANDS + MOVES}
    last = {name: [w for w in said if w in pair][-1:] for name, pair in pairs.items()}
    return [name for name, word in last.items() if word and word[0] != pairs[name][0]]


def scenarios(runs: int, seed: int):
    """Where, which signals, how far apart, and when: each place and pattern in turn."""
    rng = random.Random(seed)
    kinds = itertools.cycle(itertools.product(PATTERNS, PLACES))
    for number, (pattern, place) in zip(range(runs), kinds, strict=False):
        early = rng.uniform(0.0, 0.1) if number % 5 == 4 else None
        yield place, pattern, rng.uniform(0.0, 0.01), early, rng.uniform(0.0, 0.03)


def main(arguments=None) -> int:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--runs", type=int, default=36)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--hang", action="store_true", help="with hooks that hang")
    parser.add_argument("--log", default=os.devnull, help="file that the runs' errors go to")
    args = parser.parse_args(arguments)
    # A shell's background job ignores SIGINT, nohup SIGHUP; what they start inherits that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    done, failed = [], 0
    for place, pattern, gap, early, pause in scenarios(args.runs, args.seed):
        words, out = os.pipe()
        if not (pid := os.fork()):  # from here on the user's program, which ends as any does
            os.close(words)
            os.dup2(os.open(os.devnull, os.O_RDWR), 0)
            os.dup2(os.open(args.log, os.O_WRONLY | os.O_APPEND), 2)
            return live(place, out, args.hang)
        os.close(out)
        row = end(pid, words, pattern, gap, early, pause)
        os.close(words)
        done.append(row)
        names = " ".join(signal.Signals(n).name for n in pattern)
        if row["bad"] or row["exit"] > EXIT_WITHIN:
            failed += 1
            print(f"{place}, {names} {1e3 * gap:.1f} ms apart, early {early}: {row}", flush=True)
    exits = sorted(row["exit"] for row in done)
    starts = [row["start"] for row in done if row["start"] is not None]
    print(
        f"{len(done)} runs, {failed} failed; from signal to exit: median "
        f"{exits[len(exits) // 2]:.2f} s, longest {exits[-1]:.2f} s; from start to free: longest "
        f"{max(starts, default=0.0):.2f} s"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    harness.run(main)
