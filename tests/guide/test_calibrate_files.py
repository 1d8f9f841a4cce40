# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin calibrate` takes recordings of a board that is not there."""

import numpy as np
import pytest
from support.lab.unknown import Creeping
from support.weights import objects, stream
from test_guide import SHAPE, Unknown, bodies

from tactile_skin import PressureCurve, cli
from tactile_skin.errors import FileError
from tactile_skin.launch import read_skin
from tactile_skin.physics.curve import GRAM
from tactile_skin.recording.lines import read_reference


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Of one unknown board: its rest, touches, and three objects, as .npy and .csv."""
    folder, board = tmp_path_factory.mktemp("recorded"), Unknown(SHAPE, seed=5)
    rng = np.random.default_rng(6)
    counts = board.supposed.full_scale
    np.save(folder / "rest.npy", board.at_rest(400) * counts)
    touches = []
    for force in bodies(30, SHAPE, rng):
        touches += [board.at_rest(20), board.frames([3.0 * force] * 30)]
    np.save(folder / "touches.npy", np.concatenate(touches) * counts)
    for grams, force in zip((500, 1200, 3000), bodies(3, SHAPE, rng), strict=True):
        newtons = grams * GRAM
        frames = board.frames([force * newtons / force.sum()] * 150).reshape(150, -1) * counts
        np.savetxt(folder / f"{grams}.csv", frames, "%.3f", ",")
    config = folder / "mine.yaml"
    rows, cols = SHAPE
    config.write_text(f"/**: {{ros__parameters: {{circuit: {{rows: {rows}, cols: {cols}}}}}}}\n")
    return folder, board


def calibrate(folder, *words):
    config, out = folder / "mine.yaml", folder / "out.yaml"
    return cli.main(["calibrate", "--config", str(config), "--out", str(out), *words]), out


@pytest.mark.ci
def test_files_give_circuit_and_curve(files, capsys):
    folder, board = files
    loads = [f"{g}g:={folder / f'{g}.csv'}" for g in (500, 1200, 3000)]
    touches = f"touches:={folder / 'touches.npy'}"
    status, out = calibrate(folder, f"rest:={folder / 'rest.npy'}", touches, *loads)
    assert status == 0
    said = capsys.readouterr().out
    assert "r_par = " in said and "felt: " in said
    found = read_skin(out)
    assert found.circuit.r_par == pytest.approx(board.r_par, rel=0.05)
    assert "made by tactile-skin calibrate" in out.read_text()
    assert found.curve.gain.shape == SHAPE and "the cells' gains are" in " ".join(said.split())
    assert len(out.read_text().splitlines()) < 60


def test_a_file_may_begin_before_its_object_lies_there(files, tmp_path, capsys):
    folder, _ = files
    idle = np.load(folder / "rest.npy")[:130].reshape(130, -1)
    for grams in (500, 1200, 3000):
        lying = np.loadtxt(folder / f"{grams}.csv", delimiter=",")
        np.savetxt(tmp_path / f"{grams}.csv", [*idle, *lying], "%.3f", ",")
    loads = [f"{g}g:={tmp_path / f'{g}.csv'}" for g in (500, 1200, 3000)]
    status, _ = calibrate(folder, f"rest:={folder / 'rest.npy'}", *loads)
    said = capsys.readouterr().out
    assert status == 0 and said.count("felt: ") == 1 and "nothing lies" not in said


@pytest.mark.parametrize("proof", ["none", "weight"])
def test_weights_without_a_curve_are_a_failure(files, tmp_path, capsys, proof):
    """What touches find is written only where a weight has proved the scale; nothing new is not."""
    folder, board = files
    rows, cols = SHAPE
    (tmp_path / "mine.yaml").write_text(
        f"/**: {{ros__parameters: {{circuit: {{rows: {rows}, cols: {cols}}}, "
        f"curve: {{proof: {proof}}}}}}}\n"
    )
    words = [f"touches:={folder / 'touches.npy'}"]
    words += [f"{g}g:={folder / f'{g}.csv'}" for g in (500, 1200)]
    status, out = calibrate(tmp_path, f"rest:={folder / 'rest.npy'}", *words)
    said, err = capsys.readouterr()
    assert status == 1 and "no curve was found" in err and "Use it" not in said + err
    assert out.exists() == (proof == "weight")
    if proof == "weight":
        assert "is written with r_par" in err and "curve only" not in err
        assert read_skin(out).curve == PressureCurve()
        assert read_skin(out).circuit.r_par == pytest.approx(board.r_par, rel=0.05)
    else:
        assert f"{out} is not written" in err


def test_a_file_in_which_the_skin_is_touched_is_no_rest(files, capsys):
    folder, _ = files
    frames = np.load(folder / "rest.npy")
    frames[::3, 4] += 300.0
    np.save(folder / "touched.npy", frames)
    status, _ = calibrate(folder, f"rest:={folder / 'touched.npy'}")
    assert status == 2
    assert "row 4, column" in capsys.readouterr().err


@pytest.mark.ci
def test_a_scale_and_a_load_that_stands_give_curve_and_creep(tmp_path, capsys):
    """Each file has a clock of its own."""
    skin, rng = Creeping((8, 8), 7, share=0.05, time=1.0), np.random.default_rng(7)
    frames, times, force, at = stream(skin, 25, 0.2, rng)
    np.savez(tmp_path / "touches.npz", frames=frames, times=times + 1.7e9)
    lines = [f"{t:.3f},{f:.3f}" for t, f in zip(at, force, strict=True)]
    (tmp_path / "scale.csv").write_text("\n".join(["time,force", *lines]))
    np.savez(tmp_path / "rest.npz", frames=skin.at_rest(200))
    times = np.arange(0.0, 120.0, 0.5)
    load = objects(1, (8, 8), rng)[0][0]
    standing = skin.standing(times, load, np.ones(times.size))
    np.savez(tmp_path / "standing.npz", frames=standing, times=times)
    (tmp_path / "mine.yaml").write_text(
        f"/**: {{ros__parameters: {{circuit: {{rows: 8, cols: 8, r_par: {skin.r_par}, "
        f"r_line: {skin.r_line}}}}}}}\n"
    )
    words = [f"rest:={tmp_path / 'rest.npz'}", f"touches:={tmp_path / 'touches.npz'}"]
    words += [f"reference:={tmp_path / 'scale.csv'}", f"creep:={tmp_path / 'standing.npz'}"]
    status, out = calibrate(tmp_path, *words)
    assert status == 0, capsys.readouterr().err
    found = read_skin(out)
    assert found.creep.share == pytest.approx(0.05, abs=0.005)
    hard = np.array([1.0, 3.0])
    ratio = found.curve.resistance(hard) / skin.curve.resistance(hard)
    assert ratio == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("text", "why"),
    [("", "no lines"), ("a,b\n1,2\n3", "line 3"), ("2,1\n1,1", "line 2"), ("1,2\n2,nan", "line 2")],
)
def test_a_reference_that_cannot_be_read_is_told(tmp_path, text, why):
    path = tmp_path / "scale.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=why):
        read_reference(str(path))
