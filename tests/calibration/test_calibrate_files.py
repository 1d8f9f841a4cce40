"""`tactile-skin calibrate` takes recordings of a board that is not there."""

import numpy as np
import pytest
from test_guide import SHAPE, Unknown, bodies

from tactile_skin import cli
from tactile_skin.launch import read_skin
from tactile_skin.physics.curve import GRAM


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Of one unknown board: its rest, touches, and three objects, as .npy and .csv."""
    folder, board = tmp_path_factory.mktemp("recorded"), Unknown(SHAPE, seed=5)
    rng = np.random.default_rng(6)
    counts = board.supposed.full_scale
    np.save(folder / "rest.npy", board.at_rest(400) * counts)
    touches = []
    for force in bodies(30, SHAPE, rng):
        touches += [board.at_rest(40), board.frames([3.0 * force] * 60)]
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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["touches:=a.npy"], "rest:=FILE is missing"),
        (["rest:=a.npy", "port:=/dev/null"], "files are rest, touches, rate"),
        (["rest:=none.npy"], "none.npy: No such file"),
        (["rest:=a.npy", "rate:=fast"], "rate:=fast: must be a number"),
    ],
)
def test_mistakes_are_one_line(files, capsys, words, said):
    status, _ = calibrate(files[0], *words)
    err = capsys.readouterr().err
    assert status == 2 and said in err and len(err.splitlines()) == 1


def test_a_file_in_which_the_skin_is_touched_is_no_rest(files, capsys):
    folder, _ = files
    frames = np.load(folder / "rest.npy")
    frames[::3, 4, 5] += 300.0
    np.save(folder / "touched.npy", frames)
    status, _ = calibrate(folder, f"rest:={folder / 'touched.npy'}")
    assert status == 2
    assert "row 4, column 5 reads" in capsys.readouterr().err
