"""Takes of gestures, from the live skin or from a recording."""

from __future__ import annotations

import datetime
import time

from ...arguments import split

_LONGEST = 8.0  # s of a take
_PATIENCE = 10.0  # s for a take to begin
_PAUSE = 0.8  # s without a touch that end a take
_COUNTDOWN = 2  # s


def record(args) -> int:
    """Write takes to files until there are enough; returns the exit status."""
    from ...touch.take import SUFFIX, Take, touches

    if args.times < 1:
        raise ValueError(f"--times {args.times}: must be 1 or more")
    for option, text in (("NAME", args.name), ("--person", args.person)):
        if not text.replace("-", "").replace("_", "").isalnum():
            raise ValueError(f"{option} {text!r}: must be of letters, digits, - and _")
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
    with Live(given) as skin:
        while kept < args.times:
            answer = _asked(
                f"{args.name}, take {kept + 1} of {args.times}: Enter to start, q to end "
            )
            if answer == "q":
                break
            pictures, period = skin.take()
            if pictures is None:
                print("  nothing touched the skin; is it calibrated, and is the touch hard enough?")
                continue
            print(_shown(pictures, period))
            answer = _asked("  Enter to keep, r to repeat, q to end without it ")
            if answer == "q":
                break
            if answer != "r":
                keep(pictures, period, skin.pitch)
    print(f"{kept} takes of {args.name} in {args.out}")
    return 0 if kept else 1


def _asked(question: str) -> str:
    """Return the answer in lower case; q where nobody is there to answer."""
    try:
        return input(question).strip().lower()
    except EOFError:
        print()
        return "q"


def _recorded(path: str):
    """Return (T, rows, cols) pictures of a recording [N], their period [s] and the pitch [m]."""
    import numpy as np

    from ...recording.reader import Recording
    from ...touch.recogniser import Pictures

    recording = Recording(path)
    pressure = recording.adc_topic.removesuffix("adc") + "pressure"
    geometry = recording.skin.geometry
    std: dict = {}
    if f"{pressure}_std" in recording.topics:
        std = dict(zip(*recording.images(f"{pressure}_std"), strict=True))
    pictures, found, periods = Pictures(), [], []
    for stamp, frame in zip(*recording.images(pressure), strict=True):
        of_frame = std.get(stamp, 0.0) * geometry.cell_area
        picture = pictures.update(stamp / 1e9, frame * geometry.cell_area, of_frame)
        if picture is not None:
            found.append(picture.force)
            periods.append(picture.period)
    if not found:
        raise ValueError(f"{path}: holds fewer than two pictures of {pressure}")
    return np.array(found), float(np.median(periods)), geometry.pitch


class Live:
    """The skin of a launch file, of which takes are made."""

    def __init__(self, given: dict[str, str]):
        from ... import launch

        given = {"monitor": "false"} | given
        plan = launch.read_plan(launch.find(launch.default_file(given)), given)
        self._skin = launch.Skin(plan)
        self._geometry = launch.read_skin(given.get("config")).geometry
        self.pitch = self._geometry.pitch
        self._frames: list | None = None  # of the take that is made now
        self._std: object = 0.0

    def __enter__(self) -> Live:
        from ...msg import Image

        self._skin.__enter__()
        self._skin.node.create_subscription(Image, "skin/pressure_std", self._on_std, 10)
        self._skin.node.create_subscription(Image, "skin/pressure", self._on_pressure, 10)
        return self

    def __exit__(self, *error) -> None:
        self._skin.__exit__(*error)

    def _on_std(self, message) -> None:
        from ...msg import image_array

        self._std = image_array(message) * self._geometry.cell_area

    def _on_pressure(self, message) -> None:
        from ...msg import image_array

        if (frames := self._frames) is None:
            return
        stamp = message.header.stamp
        force = image_array(message) * self._geometry.cell_area
        frames.append((stamp.sec + stamp.nanosec / 1e9, force, self._std))

    def take(self):
        """Return the pictures of the next touch and their period; None where none comes."""
        import numpy as np

        from ...touch.recogniser import Pictures

        for left in range(_COUNTDOWN, 0, -1):
            print(f"  {left} ...", end="", flush=True)
            time.sleep(1.0)
        print(" now")
        frames = self._frames = []
        pictures, found, periods, taken = Pictures(), [], [], 0
        begun = silent = 0.0
        start = time.monotonic()
        while time.monotonic() - start < (_LONGEST if begun else _PATIENCE):
            time.sleep(0.02)
            while taken < len(frames):
                t, force, std = frames[taken]
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
        self._frames = None
        if not found:
            return None, 0.0
        last = max(k for k, picture in enumerate(found) if picture.any())
        return np.array(found[: last + 1]), float(np.median(periods))


_SHADES = " .:-=+*#%@"


def _shown(pictures, period: float) -> str:
    """Return the most force on each cell as text, and how long and how hard it was."""
    most = pictures.max(0)
    shades = (most / most.max() * (len(_SHADES) - 1)).round().astype(int)
    lines = ["  |" + "".join(_SHADES[k] * 2 for k in row) + "|" for row in shades]
    total = pictures.sum((1, 2)).max()
    return "\n".join([*lines, f"  {len(pictures) * period:.1f} s, up to {total:.1f} N"])
