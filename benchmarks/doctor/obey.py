# SPDX-License-Identifier: Apache-2.0
"""What becomes of a skin whose owner obeys each piece of advice that it gives.

A board is configured with one wrong entry. Its owner starts the skin, takes what the reason says,
or where it points to `detect`, the file that this writes from four seconds of bytes; then what the
doctor says of a minute of touches, and `calibrate` of its rest and touches; each `set NAME: VALUE`
is entered, one after the other, and he starts again, until nothing is said or nothing is new. He
answers `detect` by what he believes, and counts the cells, and looks the scale up, if asked. Where
a finding lists what it may be instead of a setting, he looks the entries up that it names, as on
the board or its data sheet; r_par is printed on nothing. He exchanges two leads if he is told to.
Of a format, wrong is the description of another sketch, or one with a slip.

Each board is a `Circuit` with a fabric that scatters by 3 to 8 % and the shipped curve, 0.5 to 1.5
steps of noise, 6 x 6 to 12 x 10, every readout. Scored is the end: a skin that is free while 45 N
press on a palm's area; and a right picture: totals within 30 % and centres within 0.75 cells in the
median of touches of 3 to 30 N, and no fault while nothing presses.
"""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import yaml
from support.chain import Chain
from support.strangers.sim import finger, touches

from tactile_skin import Circuit
from tactile_skin.commands import calibrate, detect, doctor
from tactile_skin.middleware.threads import one_thread

from .. import harness
from .entries import KINDS, OF_CIRCUIT, OF_LINK, Board, circuit_of, draw, parser_of

RATE = 20  # frames a second, on the running skin
RECORDED = 10  # frames a second, for doctor, calibrate and detect
PALM = 45.0  # N
SETTLED = 0.5  # s after the palm came in which the skin may still be free
ROUNDS = 6  # in which the owner still obeys
LISTENED = 4.0  # s of bytes that `detect` gets
SILENT = 4.0  # s after which the driver says why there is no frame
DEFAULTS = {"r_par": Circuit().r_par, "readout": "floating", "driven": "rows"}
DEFAULTS |= {"inverted": False, "adc_full_scale": 0.0, "r_drive": 0.0}
TEXT = {"debounce": 0.01, "lead": 0.0}  # of stop_on_push, as docs/boards.md has it for text
LOOKED_UP = set(OF_CIRCUIT) - {"r_par", "r_drive"}  # what an owner can read off his board

_SET = re.compile(r"\b[Ss]et:? ((?:[\w.]+: [\w.+-]+(?:, | and )?)+)")
_PAIR = re.compile(r"(?:[a-z_]+\.)?([a-z_]+): ([\w.+-]*\w)")
_FORM = re.compile(r"""serial_driver\.format\.(\w+): ('(?:[^']|'')*'|".*?"|\d+)""")
_LEARNT = re.compile(r"by the touches (r_\w+) is (\d+) .* write it into circuit")
_LEFT_OUT = re.compile(r"format\.(\w+) = .* leave it out")
_EXCHANGE = re.compile(r"\b(rows|columns) (\d+) and (\d+): .*if they are exchanged")


class Played:
    """What a launched skin did in half a minute of rest, touches and a palm.

    Attributes:
        free: whether it was free while the palm pressed.
        right: whether its picture was right, and at rest no fault stopped it.
        reasons: what was said, in order.
    """

    def __init__(self, board: Board, entered: dict):
        rng = np.random.default_rng([board.seed, 1])
        shape = board.circuit.shape
        force = touches(shape, 32.0, RATE, seed=board.seed, rest=5.0, hard=(3, 30), hold=1.2)
        t = np.arange(len(force)) / RATE
        palm = (t >= 26.0) & (t < 29.0)
        force[t > 25.0] = 0.0
        middle = (shape[0] - 1) / 2, (shape[1] - 1) / 2
        force[palm] = finger(shape, *middle, PALM, 1.1)
        of_adc = {f"circuit.{k}": entered[k] for k in ("inverted", "adc_full_scale")}
        of_link = {f"format.{k}": v for k, v in entered["format"].items()}
        given = {"serial_driver": of_adc | of_link, "compensation": of_adc, "stop_on_push": TEXT}
        self.free, self.reasons = False, []
        totals, centres, rested = [], [], []
        try:
            chain = Chain(circuit_of(entered), entered["protocol"], given)
        except ValueError as error:
            self.reasons.append(str(error))
            self.right = False
            return
        for k, sample in enumerate(board.samples(force, rng)):
            chain.feed(t[k] + 0.1, board.bytes_of([sample], k))
            if t[k] > SILENT and not k % RATE:
                _look_for_frames(chain)
            if t[k] > 4.0 and chain.reason not in self.reasons[-1:]:
                self.reasons.append(chain.reason)
            for level, message in chain.levels.values():
                if level and t[k] > 4.0 and message not in self.reasons:
                    self.reasons.append(message)
            if palm[k] and t[k] > 26.0 + SETTLED:
                self.free |= not chain.stop
            if 3.5 < t[k] < 5.0:
                rested.append(chain.stop)
            steady = k > 3 and np.array_equal(force[k], force[k - 3]) and force[k].sum() > 1.0
            if steady and not palm[k]:
                felt, true = _turned(chain.force, board, entered), force[k]
                totals.append(felt.sum() / true.sum())
                centres.append(np.hypot(*(_centre(felt) - _centre(true))))
        chain.close()
        good = abs(np.median(totals) - 1.0) < 0.3 and np.median(centres) < 0.75
        self.right = bool(good and not any(rested) and not self.free)
        self.seen = np.median(totals), np.median(centres), np.mean(rested)


def _look_for_frames(chain: Chain) -> None:
    """Let the driver say why there is no frame, as its reader's thread does."""
    reader = chain._driver._reader
    if not reader.parser.counters.frames:
        port = SimpleNamespace(name=reader.port)
        reader._lost(reader._unusable(port, heard=1, patience=reader.watchdog))


def _turned(felt: np.ndarray, board: Board, entered: dict) -> np.ndarray:
    """Return the picture on the board's rows and columns, as far as it has their shape."""
    if felt.shape != board.circuit.shape:
        return np.zeros(board.circuit.shape)
    return felt


def _centre(force: np.ndarray) -> np.ndarray:
    if not force.sum():
        return np.full(2, np.inf)
    return np.array([(np.indices(force.shape)[k] * force).sum() / force.sum() for k in (0, 1)])


class Owner:
    """Obeys what he reads.

    Attributes:
        did: what he did, in order.
    """

    def __init__(self, board: Board, folder: Path):
        self.board, self.folder, self.did = board, folder, []
        self.entered = dict(board.entered)
        rng = np.random.default_rng([board.seed, 2])
        shape = board.circuit.shape
        hands = {"rest": 6.0, "hard": (3, 45), "hold": 0.9, "gap": 0.7}
        force = touches(shape, 60.0, RECORDED, seed=board.seed + 1, **hands)
        self._recorded = {
            "touches": board.samples(force, rng),
            "rest": board.samples(force[:50], rng),
        }

    def run(self) -> Played:
        """Return what the skin does in the end."""
        done: set = set()
        self.free_after = 0  # pieces of advice after which he had a skin that is free under a palm
        for _ in range(ROUNDS):
            played = Played(self.board, self.entered)
            self.free_after += bool(played.free and self.did)
            if not self._once(played, done):
                break
        return Played(self.board, self.entered)

    def _once(self, played: Played, done: set) -> bool:
        """Obey one piece of advice; whether there was one."""
        said = [("launch", reason) for reason in reversed(played.reasons)]  # the latest first
        if self._sets(said, done):
            return True
        pointed = any("tactile-skin detect" in reason for reason in played.reasons)
        if pointed and self._detects(done):
            return True
        heard = [("doctor", line) for line in self.doctor().splitlines()]
        if self._sets(heard, done):
            return True
        if played.right:
            return False
        last = [("calibrate", line) for line in self.calibrate().splitlines()]
        return self._sets(last, done) or self._looks_up(said + heard + last)

    def _sets(self, said: list[tuple[str, str]], done: set) -> bool:
        """Enter the first setting that is new; whether there was one."""
        for who, text in said:
            for clause in _SET.findall(text):
                pairs = {k: yaml.safe_load(v) for k, v in _PAIR.findall(clause)}
                pairs = {k: v for k, v in pairs.items() if k in (*OF_CIRCUIT, "protocol")}
                key = tuple(sorted(pairs.items()))
                if pairs and key not in done and self.entered | pairs != self.entered:
                    done.add(key)
                    self.entered |= pairs
                    self.did.append(f"{who}: set {pairs}")
                    return True
            forms = _FORM.findall(text) if ": set serial_driver.format" in text else ()
            form = {name: yaml.safe_load(value) for name, value in forms}
            if form and self.entered["format"] | form != self.entered["format"]:
                self.entered["format"] = self.entered["format"] | form
                self.did.append(f"{who}: set format {form}")
                return True
            if (match := _LEARNT.search(text)) and match[1] not in done:
                done.add(match[1])
                self.entered[match[1]] = float(match[2])
                self.did.append(f"{who}: {match[1]} {match[2]} written")
                return True
            if match := _LEFT_OUT.search(text):
                form = {k: v for k, v in self.entered["format"].items() if k != match[1]}
                self.entered["format"] = form
                self.did.append(f"{who}: left format.{match[1]} out")
                return True
            if "inverted to the other value" in text and "inverted" not in done:
                done.add("inverted")
                self.entered["inverted"] = not self.entered["inverted"]
                self.did.append(f"{who}: inverted the other way")
                return True
            if (match := _EXCHANGE.search(text)) and match[0] not in done:
                done.add(match[0])
                a, b = int(match[2]), int(match[3])
                if match[1] == "columns":
                    self.board.order[[a, b]] = self.board.order[[b, a]]
                    for sent in self._recorded.values():
                        sent[:, :, [a, b]] = sent[:, :, [b, a]]
                self.did.append(f"{who}: exchanged {match[1]} {a} and {b}")
                return True
        return False

    def _looks_up(self, said: list[tuple[str, str]]) -> bool:
        """Correct the first entry that is named and can be looked up; whether one was wrong."""
        entered, right = self.entered, self.board.looked_up
        for who, text in said:
            for name in re.findall(r"[a-z_]+", text) if "circuit." in text else ():
                if name in LOOKED_UP and entered[name] != right[name]:
                    entered[name] = right[name]
                elif name == "full_scale" and self._supposed != self.board.printed:
                    entered["format"] = entered["format"] | {name: self.board.printed}
                else:
                    continue
                self.did.append(f"{who}: looked {name} up")
                return True
        return False

    @property
    def _supposed(self) -> float:
        """What is printed of an input at the supply, as it is entered."""
        scale = self.entered["format"].get("full_scale") or self.entered["adc_full_scale"]
        return scale or 2.0 ** self.entered["adc_bits"] - 1.0

    def _detects(self, done: set) -> bool:
        """Take the file that `detect` writes of the bytes; whether it wrote one that is new."""
        if "detect" in done:
            return False
        done.add("detect")
        data, out = self.folder / "bytes.bin", self.folder / "detected.yaml"
        out.unlink(missing_ok=True)
        sent = self._recorded["touches"]
        n = int(LISTENED * RECORDED)
        begin = int(np.random.default_rng([self.board.seed, 3]).integers(len(sent) - n))
        data.write_bytes(self.board.bytes_of(sent[begin : begin + n], begin))
        words = data, f"out:={out}", f"config:={self._config()}"
        with mock.patch.object(detect, "_ask", self._answer):
            said = _printed(lambda: harness.command(detect, *words)).splitlines()
        if not out.exists():
            self.did.append(f"detect: {said[-1]}")
            return False
        found = yaml.safe_load(out.read_text())
        link = found["/**/serial_driver"]["ros__parameters"]
        self.entered |= DEFAULTS | found["/**"]["ros__parameters"]["circuit"]
        self.entered |= {k: link.get(k, {}) for k in OF_LINK}
        self.did.append(f"detect: {said[1]}")
        return True

    def _answer(self, question: str, read):
        """Return what is read in what is typed: what he believes, or looks up if that cannot be."""
        return read(self._typed(question))

    def _typed(self, question: str) -> str:
        entered, right = self.entered, self.board.right
        if question.startswith("rows"):
            fits = f"its {entered['rows'] * entered['cols']} cells" in question
            return "{rows} x {cols}".format(**(entered if fits else right))
        if question.startswith("wiring"):
            columns = "-columns" if entered["driven"] == "columns" else ""
            return entered["readout"] + columns + ("-pullup" if entered["inverted"] else "")
        return str(entered["r_ref"] if question.startswith("reference") else self.board.printed)

    def _file(self, name: str) -> str:
        path = self.folder / f"{name}.csv"
        sent = self._recorded[name]
        if (
            self.entered["format"] or self.board.kind == "format"
        ):  # as it is recorded by what is entered
            frames = parser_of(self.entered).feed(self.board.bytes_of(sent))
            if not frames:
                raise ValueError("no frame is recorded")
            sent = np.array([frame.samples for frame in frames])
            sent = np.rint(sent / 2 ** (16 - self.entered["adc_bits"])).astype(int)
        np.savetxt(path, sent.reshape(len(sent), -1), fmt="%d", delimiter=",")
        return str(path)

    def _config(self) -> str:
        path = self.folder / "mine.yaml"
        circuit = {k: self.entered[k] for k in OF_CIRCUIT}
        path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"circuit": circuit}}}))
        return str(path)

    def doctor(self) -> str:
        """Return what `tactile-skin doctor` prints of a minute of touches."""
        words = self._file("touches"), f"config:={self._config()}"
        return _printed(lambda: harness.command(doctor, *words))

    def calibrate(self) -> str:
        """Return what `tactile-skin calibrate` prints of rest and touches, as it enters r_par."""
        out = self.folder / "calibrated.yaml"
        words = [f"rate:={RECORDED}", *(f"{k}:={self._file(k)}" for k in ("rest", "touches"))]
        words += ["--out", out, "--config", self._config()]
        said = _printed(lambda: harness.command(calibrate, *words))
        if out.exists():
            found = yaml.safe_load(out.read_text())["/**"]["ros__parameters"]["circuit"]
            if abs(found["r_par"] - self.entered["r_par"]) > 1.0:
                said += f"\nset r_par: {found['r_par']}"
            out.unlink()
        return said


def _printed(call) -> str:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            call()
        except (ValueError, OSError) as error:
            print(error)
    return said.getvalue()


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1000, help="of the first board")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--verbose", action="store_true", help="what was said and done")
    args = parser.parse_args(arguments)
    ends, free, on_the_way = defaultdict(Counter), [], 0
    with one_thread(), tempfile.TemporaryDirectory() as folder:
        for seed in range(args.seed, args.seed + args.boards):
            board = draw(seed, args.kinds)
            if not Played(board, board.right).right:
                print(f"{seed} {board.kind}: is not right with the right entries", flush=True)
                ends[board.kind]["not a board"] += 1
                continue
            owner = Owner(board, Path(folder))
            end = owner.run()
            result = "FREE UNDER A PALM" if end.free else "right" if end.right else "stopped"
            ends[board.kind][result] += 1
            free += [seed] if end.free else []
            on_the_way += owner.free_after
            print(f"{seed} {board.kind}: {result}; {'; '.join(owner.did) or 'nothing'}", flush=True)
            if args.verbose and result != "right":
                print("   right", board.right, "\n   end  ", owner.entered)
                print("   seen", getattr(end, "seen", None))
                for reason in dict.fromkeys(re.sub(r"\d+(\.\d+)?", "#", r) for r in end.reasons):
                    print("   launch:", reason)
                said = [k for k in owner.doctor().splitlines() if not k.strip()[:1].isdigit()]
                print("   doctor:", "\n      ".join(said))
    total = sum(ends.values(), Counter())
    for kind, counter in [*ends.items(), ("all", total)]:
        print(f"{kind}: " + ", ".join(f"{k} {n}" for k, n in counter.most_common()))
    print(
        f"free under {PALM:g} N: {len(free)} of {args.boards} {free or ''}; on the way, after a "
        f"piece of advice: {on_the_way}"
    )
    return {"ends": ends, "free": free, "free on the way": on_the_way}


if __name__ == "__main__":
    harness.run(main)
