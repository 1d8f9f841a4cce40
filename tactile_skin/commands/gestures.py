"""`tactile-skin gestures`: record your own gestures, train a recogniser, see how good it is."""

from __future__ import annotations

import argparse
import datetime
import time
from collections import Counter
from pathlib import Path

from ..arguments import split

EXAMPLES = """\
Gestures of your own: record some takes of each, train, and run the skin with the model.

examples:
  tactile-skin gestures record wave port:=/dev/ttyUSB0 config:=mine.yaml --person anna --times 5
  tactile-skin gestures record stroke touches.mcap --person ben
  tactile-skin gestures train takes/ --out mine.gestures.npz
  tactile-skin gestures evaluate takes/
then, in mine.yaml, gestures.model: mine.gestures.npz, and
  tactile-skin launch skin.launch.yaml port:=/dev/ttyUSB0 config:=mine.yaml gestures:=true"""
_LONGEST = 8.0  # s of a take
_PATIENCE = 10.0  # s for a take to begin
_PAUSE = 0.8  # s without a touch that end a take
_COUNTDOWN = 2  # s
_FEW = 3  # takes of a class, with fewer of which it is not trained


def register(parser) -> None:
    """Declare the arguments."""
    parser.epilog = EXAMPLES
    steps = parser.add_subparsers(dest="step", required=True, metavar="STEP")

    def step(name: str, text: str):
        return steps.add_parser(
            name,
            help=text,
            description=text,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    record = step("record", "takes of one gesture, from the live skin or a recording")
    record.add_argument(
        "name", metavar="NAME", help="of the gesture: stroke, say; other: no gesture"
    )
    record.add_argument(
        "words",
        nargs="*",
        metavar="RECORDING | NAME:=VALUE",
        help="a recording (.mcap), of which each touch is a take; or arguments of the launch file",
    )
    record.add_argument("--person", default="me", help="who makes the gesture (default me)")
    record.add_argument("--times", type=int, default=5, metavar="N", help="takes (default 5)")
    record.add_argument(
        "--out", type=Path, default=Path("takes"), metavar="FOLDER", help="default takes/"
    )
    train = step("train", "a recogniser from takes, and from simulated hands")
    train.add_argument("takes", nargs="*", metavar="TAKES", help="files, or folders of them")
    train.add_argument("--out", type=Path, required=True, metavar="FILE", help="model to write")
    train.add_argument(
        "--alone", action="store_true", help="from your takes alone, without simulated hands"
    )
    evaluate = step("evaluate", "which gestures are taken for which, people left out in turn")
    evaluate.add_argument("takes", nargs="+", metavar="TAKES", help="files, or folders of them")
    evaluate.add_argument(
        "--model", type=Path, metavar="FILE", help="a model to judge by all takes instead"
    )
    evaluate.add_argument("--out", type=Path, metavar="FILE", help="picture (.png) to draw")


def run(args) -> int:
    """Carry out one step."""
    return {"record": _record, "train": _train, "evaluate": _evaluate}[args.step](args)


def _record(args) -> int:
    from ..touch.take import SUFFIX, Take, touches

    if args.times < 1:
        raise ValueError(f"--times {args.times}: must be 1 or more")
    files, given = split(args.words, None)
    args.out.mkdir(parents=True, exist_ok=True)
    kept = 0

    def keep(pictures, period: float, pitch: float) -> None:
        nonlocal kept
        kept += 1
        stamp = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
        path = args.out / f"{args.name}-{args.person}-{stamp}-{kept}{SUFFIX}"
        Take(args.name, args.person, pictures, period, pitch).save(path)

    if files:
        if len(files) > 1:
            raise ValueError(f"one recording, not {len(files)}: {' '.join(files)}")
        pictures, period, pitch = _recorded(files[0])
        for take in touches(pictures, period):
            keep(take, period, pitch)
        print(f"{files[0]}: {kept} takes of {args.name} in {args.out}")
        return 0 if kept else 1
    with _live(given) as skin:
        while kept < args.times:
            answer = input(
                f"{args.name}, take {kept + 1} of {args.times}: Enter to start, q to end "
            )
            if answer.strip().lower() == "q":
                break
            pictures, period = skin.take()
            if pictures is None:
                print("  nothing touched the skin; is it calibrated, and is the touch hard enough?")
                continue
            print(_shown(pictures, period))
            if input("  Enter to keep, r to repeat ").strip().lower() != "r":
                keep(pictures, period, skin.pitch)
    print(f"{kept} takes of {args.name} in {args.out}")
    return 0 if kept else 1


def _recorded(path: str):
    """Return (T, rows, cols) pictures of a recording [N], their period [s] and the pitch [m]."""
    import numpy as np

    from ..recording.reader import Recording
    from ..touch.recogniser import Pictures

    recording = Recording(path)
    stamps, pressure = recording.images("skin/pressure")
    geometry = recording.skin.geometry
    std = dict(zip(*recording.images("skin/pressure_std"), strict=True))
    pictures, found, periods = Pictures(), [], []
    for stamp, frame in zip(stamps, pressure, strict=True):
        of_frame = std.get(stamp, 0.0) * geometry.cell_area
        picture = pictures.update(stamp / 1e9, frame * geometry.cell_area, of_frame)
        if picture is not None:
            found.append(picture.force)
            periods.append(picture.period)
    if not found:
        raise ValueError(f"{path}: holds no skin/pressure: record it with 'tactile-skin record'")
    return np.array(found), float(np.median(periods)), geometry.pitch


class _Live:
    """The skin of a launch file, of which takes are made."""

    def __init__(self, given: dict[str, str]):
        from .. import launch

        given = {"monitor": "false"} | given
        plan = launch.read_plan(launch.find(launch.default_file(given)), given)
        self._skin = launch.Skin(plan)
        self._geometry = launch.read_skin(given.get("config")).geometry
        self.pitch = self._geometry.pitch
        self._frames: list = []
        self._std: object = 0.0

    def __enter__(self) -> _Live:
        from ..msg import Image

        self._skin.__enter__()
        self._skin.node.create_subscription(Image, "skin/pressure_std", self._on_std, 10)
        self._skin.node.create_subscription(Image, "skin/pressure", self._on_pressure, 10)
        return self

    def __exit__(self, *error) -> None:
        self._skin.__exit__(*error)

    def _on_std(self, message) -> None:
        from ..msg import image_array

        self._std = image_array(message) * self._geometry.cell_area

    def _on_pressure(self, message) -> None:
        from ..msg import image_array

        stamp = message.header.stamp
        force = image_array(message) * self._geometry.cell_area
        self._frames.append((stamp.sec + stamp.nanosec / 1e9, force, self._std))

    def take(self):
        """Return the pictures of the next touch and their period; None where none comes."""
        import numpy as np

        from ..touch.recogniser import Pictures

        for left in range(_COUNTDOWN, 0, -1):
            print(f"  {left} ...", end="", flush=True)
            time.sleep(1.0)
        print(" now")
        self._frames.clear()
        pictures, found, periods, taken = Pictures(), [], [], 0
        begun = silent = 0.0
        start = time.monotonic()
        while time.monotonic() - start < (_LONGEST if begun else _PATIENCE):
            time.sleep(0.02)
            while taken < len(self._frames):
                t, force, std = self._frames[taken]
                taken += 1
                picture = pictures.update(t, force, std)
                if picture is None:
                    continue
                touched = bool(picture.force.any())
                if touched and not begun:
                    begun, start = t, time.monotonic()
                silent = 0.0 if touched else silent + picture.period
                if begun:
                    found.append(picture.force)
                    periods.append(picture.period)
            if begun and silent > _PAUSE:
                break
        if not found:
            return None, 0.0
        last = max(k for k, picture in enumerate(found) if picture.any())
        return np.array(found[: last + 1]), float(np.median(periods))


_live = _Live
_SHADES = " .:-=+*#%@"


def _shown(pictures, period: float) -> str:
    """Return the most force on each cell as text, and how long and how hard it was."""
    most = pictures.max(0)
    shades = (most / most.max() * (len(_SHADES) - 1)).round().astype(int)
    lines = ["  |" + "".join(_SHADES[k] * 2 for k in row) + "|" for row in shades]
    total = pictures.sum((1, 2)).max()
    return "\n".join([*lines, f"  {len(pictures) * period:.1f} s, up to {total:.1f} N"])


def _read(paths):
    from .. import extras
    from ..touch.take import find_takes, load_take

    return [
        load_take(path)
        for path in extras.tqdm()(list(find_takes(paths)), desc="takes", disable=None)
    ]


def _train(args) -> int:
    from .. import extras
    from ..learning.gestures import table_of, train

    if args.alone and not args.takes:
        raise ValueError("--alone needs takes: name their files or folders")
    takes = _read(args.takes)
    count = Counter(take.label for take in takes)
    few = [f"{name}: {n}" for name, n in sorted(count.items()) if n < _FEW]
    if few:
        raise ValueError(f"{_FEW} takes of a gesture at least are needed; of {', '.join(few)}")
    people = sorted({take.person for take in takes})
    if not args.alone:
        from ..learning.hands import PEOPLE, simulated

        takes += extras.tqdm()(simulated(), desc="simulated hands", leave=False, disable=None)
        people.append(f"{PEOPLE} simulated")
    table = table_of(takes)
    if len(set(table.label)) < 2:
        raise ValueError("one gesture alone is nothing to tell apart: record others, or 'other'")
    about = {
        "trained": datetime.date.today().isoformat(),
        "people": people,
        "takes": dict(count),
        "pitch": sorted({round(take.pitch, 4) for take in takes}),
    }
    model = train(table, about)
    model.save(args.out)
    print(f"{args.out}: {', '.join(model.classes)}; from {len(takes)} takes")
    return 0


def _evaluate(args) -> int:
    import numpy as np

    from ..learning.gestures import left_out, table_of
    from ..touch.model import load_model

    table = table_of(_read(args.takes))
    if args.model:
        model = load_model(args.model)
        classes = np.array(model.classes)
        shares = np.array([model.probabilities(row) for row in table.features])
        print(f"{args.model}: {model.about}")
    else:
        classes = np.unique(table.label)
        if len(classes) < 2:
            raise ValueError("takes of two gestures at least are needed")
        shares = left_out(table)
        people = len(set(table.person))
        print("people left out in turn" if people > 1 else "one person: takes left out in turn")
    named = classes[shares.argmax(1)]
    label, named = table.label[table.end], named[table.end]
    print(_confusion(label, named))
    right = float((label == named).mean())
    error = (right * (1.0 - right) / len(label)) ** 0.5
    print(f"right: {right:.3f} +- {error:.3f} of {len(label)} takes")
    return 0


def _confusion(label, named) -> str:
    """Return a table: a row a gesture, a column what it was taken for."""
    import numpy as np

    names = sorted({*label, *named})
    wide = max(map(len, names))
    heads = " ".join(f"{name[:7]:>7}" for name in names)
    lines = [f"{'':{wide}}  {heads}"]
    for name in sorted(set(label)):
        counts = [int(np.count_nonzero((label == name) & (named == other))) for other in names]
        lines.append(f"{name:{wide}}  " + " ".join(f"{n or '.':>7}" for n in counts))
    return "\n".join(lines)
