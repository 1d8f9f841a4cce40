# SPDX-License-Identifier: Apache-2.0
"""How often a sound picture of a real board is refused, and by how much it errs.

noise: values that are not whole ADC steps, and noise that nobody told the solver. palms: broad
smooth loads. insole: the recordings of a floating insole (--data names the folder), frame by frame
and as a stream, and controls that must be suspect.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from support import insole

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes

from .. import harness

SCANS = (1, 2, 4, 8)  # that a reading is the mean of
NOISES = (0.3, 1.0, 3.0)  # RMS of a sample [ADC steps]
SHAPES = ((8, 8), (8, 12), (16, 16), (32, 32))


def mean_of(scans: int, noise: float):
    """Whole samples of this noise [ADC steps], averaged."""

    def read(steps, rng):
        samples = (np.rint(steps + noise * rng.standard_normal(steps.shape)) for _ in range(scans))
        return sum(samples) / scans

    return read


def four_decimals(noise: float):
    sample = mean_of(1, noise)
    return lambda steps, rng: np.round(sample(steps, rng) / 1023, 4) * 1023


def over_1024(noise: float):
    sample = mean_of(1, noise)
    return lambda steps, rng: sample(steps, rng) * 1023 / 1024


def low_pass(noise: float):
    """On the board, sent as float32."""
    return lambda steps, rng: (steps + noise * rng.standard_normal(steps.shape)).astype(np.float32)


def readouts() -> dict:
    """name -> what a board makes of ADC steps, and its noise [ADC steps]."""
    found = {}
    for noise in NOISES:
        one = (noise**2 + 1 / 12) ** 0.5
        for scans in SCANS:
            found[f"{noise:g} steps, mean of {scans}"] = mean_of(scans, noise), one / scans**0.5
        found[f"{noise:g} steps, four decimals"] = four_decimals(noise), np.hypot(one, 0.03)
        found[f"{noise:g} steps, over 1024"] = over_1024(noise), one
        found[f"{noise:g} steps, float32 low-pass"] = low_pass(noise / 2), noise / 2
    return found


def touches(n: int, rng) -> np.ndarray:
    """(n, 16, 16) [N]: the paper's families, and fingers, in turns."""
    families = [scenes.sample(f, -(-n // 4), 16, 16, rng) for f in scenes.FAMILIES]
    fingers = [
        scenes.finger(16, 16, *rng.uniform(2, 13, 2), rng.uniform(1, 25), rng.uniform(0.6, 1.5))
        for _ in range(-(-n // 4))
    ]
    families.append(np.array(fingers))
    return np.concatenate(families)[:n] if n < 4 else np.stack(families, 1).reshape(-1, 16, 16)[:n]


def noise(n: int, seed: int) -> None:
    circuit, curve = Circuit(), PressureCurve()
    force = touches(n, np.random.default_rng(seed))
    ideal = forward(circuit, curve.resistance(force)) * circuit.full_scale
    print(f"{'reading':34} suspect %  error g  told g  ratio")
    for name, (read, rms) in readouts().items():
        rng = np.random.default_rng(seed + 1)
        adc = np.clip(np.array([read(x, rng) for x in ideal]), 0, 1023) / circuit.full_scale
        found = [compensate(a, circuit, curve) for a in adc]
        told = [compensate(a, circuit, curve, noise=rms) for a in adc]
        e, t = (np.mean([np.abs(x.force - f).mean() for x, f in zip(xs, force, strict=True)]) / GRAM
                for xs in (found, told))  # fmt: skip
        bad = 100 * np.mean([x.status != "ok" for x in found])
        bad_told = 100 * np.mean([x.status != "ok" for x in told])
        print(f"{name:34} {bad:5.1f} {bad_told:5.1f} {e:7.2f} {t:7.2f} {e / t:6.2f}", flush=True)


def palms(n: int, seed: int) -> None:
    curve = PressureCurve()
    print(f"{'palms':10} suspect %   sum off by more than 5 %   p95 of that")
    for shape in SHAPES:
        circuit, rng = Circuit(*shape), np.random.default_rng([seed, *shape])
        refused, off, why = 0, [], []
        for _ in range(n):
            row, col = rng.uniform(0, shape[0] - 1), rng.uniform(0, shape[1] - 1)
            y, x = np.indices(shape)
            width = rng.uniform(2.0, 6.0)
            picture = np.exp(-((y - row) ** 2 + (x - col) ** 2) / (2 * width**2))
            force = picture * (rng.uniform(5.0, 150.0) / picture.sum())
            force = np.minimum(force, curve.max_force)
            adc = scenes.read_out(circuit, forward(circuit, curve.resistance(force)), "scan", rng)
            found = compensate(adc, circuit, curve)
            refused += found.status != "ok"
            why += [found.message[:60]] * (found.status != "ok")
            off.append(abs(found.force.sum() / force.sum() - 1.0))
        late = 100 * np.mean(np.array(off) > 0.05)
        said = sorted({w: why.count(w) for w in why}.items())[:3]
        numbers = f"{100 * refused / n:5.1f} {late:10.1f} {100 * np.quantile(off, 0.95):8.1f}"
        print(f"{shape!s:10} {numbers}   {said}", flush=True)


def recordings(data: Path, n: int):
    """name, (n, 32, 10) counts with -1 where there is no sensor, evenly over the recording."""
    for path in sorted(data.glob("*.npz")):
        with np.load(path) as found:
            for foot in ("left", "right"):
                counts = np.nan_to_num(found[f"{foot}_electrical"], nan=-1.0).astype(np.int16)
                yield f"{path.stem} {foot}", counts


def insoles(data: Path, n: int, seed: int) -> None:
    print(f"{'insole':24} {'frames':>6} touched: alone, stream; light: alone, stream [% ok]")
    for name, counts in recordings(data, n):
        skin, cells = insole.circuit(counts[0] >= 0), insole.curve()
        first = len(counts) // 2 if n < len(counts) // 2 else 0
        part = counts[first : first + n]
        busy = insole.touched(part)
        alone, stream, last = [], [], None
        for frame in part:
            adc = np.where(skin.populated, insole.ratio(frame.astype(float)), np.nan)
            given = {"noise": insole.NOISE, "threshold": insole.ratio(insole.THRESHOLD)}
            alone.append(compensate(adc, skin, cells, **given).status == "ok")
            last = compensate(adc, skin, cells, start=last, **given)
            stream.append(last.status == "ok")
        share = [100 * np.mean(np.array(x)[w]) if w.any() else np.nan
                 for w in (busy, ~busy) for x in (alone, stream)]  # fmt: skip
        print(f"{name:24} {len(part):6}", *(f"{s:6.1f}" for s in share), flush=True)


def controls(data: Path, n: int, seed: int) -> None:
    """Touched frames with permuted cells, and with the picture's grid for the wiring."""
    rng = np.random.default_rng(seed)
    maps = [np.loadtxt(data / f"electrical_{k}_of_image_cell.csv", delimiter=",").astype(int) - 1
            for k in ("row", "col")]  # fmt: skip
    row, col = (np.where(m < 0, -1, m) for m in maps)
    for name, counts in recordings(data, n):
        frames = counts[insole.touched(counts)]
        frames = frames[:: max(len(frames) // n, 1)][:n]
        bad = []
        for made in insole.miswired(frames, row, col, rng):
            skin, cells = insole.circuit(made[0] >= 0), insole.curve()
            given = {"noise": insole.NOISE, "threshold": insole.ratio(insole.THRESHOLD)}
            found = [
                compensate(
                    np.where(skin.populated, insole.ratio(f.astype(float)), np.nan),
                    skin, cells, **given)
                for f in made
            ]  # fmt: skip
            bad.append(100 * np.mean([f.status != "ok" for f in found]))
        print(
            f"{name:24} permuted {bad[0]:.1f} % suspect, picture's grid {bad[1]:.1f} %", flush=True
        )


def main(arguments=None):
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--data", type=Path, help="folder of insole recordings (.npz)")
    parser.add_argument("--part", nargs="+", default=["noise", "palms", "insole", "controls"])
    args = parser.parse_args(arguments)
    if "noise" in args.part:
        noise(args.frames, args.seed)
    if "palms" in args.part:
        palms(args.frames, args.seed)
    if args.data and "insole" in args.part:
        insoles(args.data, args.frames, args.seed)
    if args.data and "controls" in args.part:
        controls(args.data, args.frames, args.seed)


if __name__ == "__main__":
    harness.run(main)
