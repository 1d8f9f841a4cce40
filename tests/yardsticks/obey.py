"""What becomes of a skin whose owner obeys each piece of advice that it gives.

    PYTHONPATH=tests python tests/yardsticks/obey.py [--boards N] [--seed S] [--kinds K ...]

A board that sends lines of numbers is configured with one wrong entry. Its owner starts the skin,
takes what the reason says, or where it points to the doctor, what the doctor says of a minute of
touches, and `calibrate` of its rest and touches; each `set NAME: VALUE` is entered, one after the
other, and he starts again, until nothing is said or nothing is new. Where a finding lists what it
may be instead of a setting, he looks the entries up that it names, as on the board or its data
sheet; r_par is printed on nothing. He exchanges two leads if he is told to.

Each board is a `Circuit` with a fabric that scatters by 3 to 8 % and the shipped curve, 0.5 to 1.5
steps of noise, 6 x 6 to 12 x 10, every readout. Scored is the end: a skin that is free while 45 N
press on a palm's area; and a right picture: totals within 30 % and centres within 0.75 cells in the
median of touches of 3 to 30 N, and no fault while nothing presses.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import tempfile
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import yaml
from strangers.sim import counts, fabric, finger, touches

from tactile_skin import Circuit, PressureCurve
from tactile_skin.bench.damage.chain import Chain
from tactile_skin.commands import calibrate, doctor
from tactile_skin.middleware.threads import one_thread

RATE = 20.0  # frames a second
PALM = 45.0  # N
SETTLED = 0.5  # s after the palm came in which the skin may still be free
ROUNDS = 6  # in which the owner still obeys
TEXT = {"debounce": 0.01, "lead": 0.0}  # of stop_on_push, as docs/boards.md has it for text
SHAPES = (6, 6), (8, 8), (8, 10), (10, 8), (12, 10), (6, 9)
OF_CIRCUIT = [
    "rows",
    "cols",
    "r_ref",
    "r_par",
    "adc_bits",
    "readout",
    "driven",
    "inverted",
    "adc_full_scale",
    "r_drive",
]
LOOKED_UP = set(OF_CIRCUIT) - {"r_par", "r_drive"}  # what an owner can read off his board
R_REF = {  # ohm, by which a readout tells a palm
    "floating": (1780.0, 4700.0),
    "loaded": (1000.0, 4700.0),
    "grounded": (200.0, 500.0),
}
KINDS = "rows/cols", "size", "bits", "scale", "polarity", "readout", "r_par", "order"

_SET = re.compile(r"\b[Ss]et:? ((?:[\w.]+: [\w.+-]+(?:, | and )?)+)")
_PAIR = re.compile(r"(?:[a-z_]+\.)?([a-z_]+): ([\w.+-]*\w)")
_EXCHANGE = re.compile(r"\b(rows|columns) (\d+) and (\d+): .*if they are exchanged")


@dataclass
class Board:
    """What is on the bench, and what its owner entered.

    Attributes:
        right: the entries as they should be; entered: as they are.
        order: of the columns that the board sends.
        scale: what the supply reads, of a board that sends no ADC steps; 0: ADC steps.
    """

    kind: str
    right: dict
    entered: dict
    curve: PressureCurve
    noise: float
    seed: int
    order: np.ndarray = field(default=None)
    scale: float = 0.0

    @property
    def circuit(self) -> Circuit:
        names = set(OF_CIRCUIT) - {"inverted", "adc_full_scale"}
        return Circuit(**{k: v for k, v in self.right.items() if k in names})

    def samples(self, force: np.ndarray, rng) -> np.ndarray:
        """Return (n, rows, cols) numbers that it sends under forces [N]."""
        sent = np.array(
            [
                counts(
                    self.circuit,
                    self.curve,
                    f,
                    rng,
                    noise=self.noise,
                    inverted=self.right["inverted"],
                )
                for f in force
            ]
        )
        if self.scale:
            sent = np.rint(sent * self.scale / self.circuit.full_scale).astype(int)
        return sent[:, :, self.order]


def draw(seed: int, kinds=KINDS) -> Board:
    """Return a board with one wrong entry."""
    rng = np.random.default_rng([33, seed])
    kind = kinds[seed % len(kinds)]
    shapes = [s for s in SHAPES if s[0] != s[1]] if kind == "rows/cols" else SHAPES
    rows, cols = shapes[rng.integers(len(shapes))]
    readout = ("floating", "loaded", "grounded")[rng.integers(3)]
    driven = "rows" if readout == "floating" else ("rows", "columns")[rng.integers(2)]
    bits = int((10, 12)[rng.integers(2)])
    right = {
        "rows": rows,
        "cols": cols,
        "r_ref": float(R_REF[readout][rng.integers(2)]),
        "r_par": float(rng.uniform(20, 350)) if readout == "floating" else 25.0,
        "adc_bits": bits,
        "readout": readout,
        "driven": driven,
        "inverted": bool(rng.integers(2)),
        "adc_full_scale": 0.0,
        "r_drive": 0.0,
    }
    circuit = Circuit(**{k: v for k, v in right.items() if k not in ("inverted", "adc_full_scale")})
    curve = fabric(circuit, seed=seed, scatter=rng.uniform(0.03, 0.08))
    board = Board(kind, right, dict(right), curve, rng.uniform(0.5, 1.5), seed)
    board.order = np.arange(cols)
    wrong = board.entered
    if kind == "rows/cols":
        wrong |= {"rows": cols, "cols": rows}
    elif kind == "size":
        wrong["cols"] = cols + int(rng.integers(1, 3))
    elif kind == "bits":
        wrong["adc_bits"] = 22 - bits
    elif kind == "scale":
        board.scale = float((3300, 5000)[rng.integers(2)])
        right |= {"adc_bits": 13 if board.scale > 4095 else 12, "adc_full_scale": board.scale}
    elif kind == "polarity":
        wrong["inverted"] = not right["inverted"]
    elif kind == "readout":
        others = [
            (r, d)
            for r in ("floating", "loaded", "grounded")
            for d in ("rows", "columns")
            if (r, d) != (readout, driven)
            and not (r == "floating" and (d == "columns" or readout == r))
        ]
        wrong["readout"], wrong["driven"] = others[rng.integers(len(others))]
    elif kind == "r_par":
        wrong["r_par"] = float((0.0, 2.0)[rng.integers(2)]) * right["r_par"]
        if readout != "floating":
            wrong["r_par"] = right["r_par"] + 300.0
    else:
        a, b = rng.permutation(cols)[:2]
        board.order[[a, b]] = b, a
    return board


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
        given = {"serial_driver": of_adc, "compensation": of_adc, "stop_on_push": TEXT}
        self.free, self.reasons = False, []
        totals, centres, rested = [], [], []
        try:
            chain = Chain(_circuit(entered), "text", given)
        except ValueError as error:
            self.reasons.append(str(error))
            self.right = False
            return
        for k, sample in enumerate(board.samples(force, rng)):
            line = ",".join(map(str, sample.ravel())) + "\r\n"
            chain.feed(t[k] + 0.1, line.encode())
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


def _turned(felt: np.ndarray, board: Board, entered: dict) -> np.ndarray:
    """Return the picture on the board's rows and columns, as far as it has their shape."""
    if felt.shape != board.circuit.shape:
        return np.zeros(board.circuit.shape)
    return felt


def _centre(force: np.ndarray) -> np.ndarray:
    if not force.sum():
        return np.full(2, np.inf)
    return np.array([(np.indices(force.shape)[k] * force).sum() / force.sum() for k in (0, 1)])


def _circuit(entered: dict) -> Circuit:
    names = set(OF_CIRCUIT) - {"inverted", "adc_full_scale"}
    return Circuit(**{k: v for k, v in entered.items() if k in names})


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
        force = touches(
            shape, 60.0, 10.0, seed=board.seed + 1, rest=6.0, hard=(3, 45), hold=0.9, gap=0.7
        )
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
        said = [("launch", reason) for reason in played.reasons]
        if self._sets(said, done):
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
                pairs = {k: v for k, v in pairs.items() if k in OF_CIRCUIT}
                key = tuple(sorted(pairs.items()))
                if pairs and key not in done and self.entered | pairs != self.entered:
                    done.add(key)
                    self.entered |= pairs
                    self.did.append(f"{who}: set {pairs}")
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
        for who, text in said:
            for name in re.findall(r"[a-z_]+", text) if "circuit." in text else ():
                if name in LOOKED_UP and self.entered[name] != self.board.right[name]:
                    self.entered[name] = self.board.right[name]
                    self.did.append(f"{who}: looked {name} up")
                    return True
        return False

    def _file(self, name: str) -> str:
        path = self.folder / f"{name}.csv"
        sent = self._recorded[name]
        np.savetxt(path, sent.reshape(len(sent), -1), fmt="%d", delimiter=",")
        return str(path)

    def _config(self) -> str:
        path = self.folder / "mine.yaml"
        path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"circuit": self.entered}}}))
        return str(path)

    def doctor(self) -> str:
        """Return what `tactile-skin doctor` prints of a minute of touches."""
        words = [self._file("touches"), f"config:={self._config()}"]
        return _printed(lambda: doctor.run(SimpleNamespace(words=words)))

    def calibrate(self) -> str:
        """Return what `tactile-skin calibrate` prints of rest and touches, as it enters r_par."""
        out = self.folder / "calibrated.yaml"
        words = [f"rest:={self._file('rest')}", f"touches:={self._file('touches')}"]
        config = Path(self._config())
        said = _printed(lambda: calibrate.run(out, config, words))
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boards", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1000, help="of the first board")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--verbose", action="store_true", help="what was said and done")
    args = parser.parse_args()
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


if __name__ == "__main__":
    main()
