# SPDX-License-Identifier: Apache-2.0
"""Every bad file is refused: status 2 and one line that names it, soon, and never a traceback."""

import io
import json
import logging
import os
import signal
import warnings
import zipfile

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.skins import skin_of

from tactile_skin import Circuit, PressureCurve, cli
from tactile_skin.errors import FileError
from tactile_skin.files import one_line, shorten
from tactile_skin.launch import share_dir
from tactile_skin.learning import network
from tactile_skin.learning.dataset import TrainingConfig
from tactile_skin.middleware.parameter_file import ParameterFile
from tactile_skin.touch.geometry import read_table
from tactile_skin.yaml_files import parse_yaml, read_yaml, write_yaml

HANG = 5  # s after which a file counts as one that hangs; most are refused within 0.05 s
CONFIG = (share_dir() / "config" / "skin.yaml").read_text()
WEIGHTS = (network.SHIPPED / "paper.npz").read_bytes()


class Hangs(BaseException):
    """Not an Exception: nobody may catch it."""


@pytest.fixture(autouse=True)
def guard():
    """A test that hangs fails, and log settings and signal handlers stay as they were."""

    def hangs(*_):
        raise Hangs

    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    before = {s: signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM)}
    signal.signal(signal.SIGALRM, hangs)
    yield
    signal.alarm(0)
    for number, handler in before.items():
        signal.signal(number, handler)
    root.handlers[:], root.level = handlers, level


@pytest.fixture
def refused(capfd, tmp_path, monkeypatch):
    """A function that runs a command on a bad file; the line that refuses it, which names it."""
    monkeypatch.chdir(tmp_path)

    def refused(*words, named="bad") -> str:
        signal.alarm(HANG)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            status = cli.main(list(map(str, words)))
        signal.alarm(0)
        out, err = capfd.readouterr()
        assert (status, out) == (2, "")
        (line,) = err.splitlines()
        assert line.startswith(f"tactile-skin {words[0]}: error: ")
        assert "Traceback" not in line
        assert len(line) < 1000
        assert named in line
        return line

    return refused


def holds(line: str, words) -> None:
    for word in [words] if isinstance(words, str) else words:
        assert word in line


# --- what is bad in any file --------------------------------------------------------------------


YAML = {  # what is wrong -> (content, what the line must hold)
    "list within itself": ("a: &a [*a]", ["line 1", "recursive"]),
    "map within itself": ("a: &a {b: *a}", "recursive"),
    "deep maps": ("{a: " * 5000, "recursion"),
    "large": ("#" * 100_000, "too large: must be at most 64 KiB"),
    "number of 10,000 digits": ("a: " + "1" * 10_000, "not valid YAML"),
    "key null": ("null: 1", ["line 1", "key: 'null': must be text"]),
    "key a list": ("? [a]\n: 1", "must be text"),
    "key twice": ("a: 1\nb: 2\na: 3", ["line 3", "key 'a' is given twice, first in line 1"]),
    "key twice, below": ("a:\n  b: 1\n  b: 1", ["line 3", "key 'b' is given twice"]),
    "object": ("a: !!python/object/apply:os.system [ls]", "python/object/apply:os.system"),
    "no int": ("a: !!int x", "'x'"),
    "Latin-1": (b"b: 1\na: gr\xfc\xdfe", ["line 2", "not UTF-8 text: byte 0xfc"]),
    "NUL": (b"b: 1\na: \0", ["not valid YAML", "#x0000"]),
    "tab": ("a:\n\tb: 1", ["line 2", "'\\t'"]),
    "open bracket": ("a: [1", ["not valid YAML", "line 1"]),
}
NO_YAML_OF = {"a number alone": "5", "a list": "- 1", "false": "false", "nothing": ""}
NO_FILE = {  # what it is -> (how it is made, what the line must hold)
    "folder": (lambda path: path.mkdir(), "is a folder: must be a regular file"),
    "pipe": (lambda path: os.mkfifo(path), "is a device or pipe: must be a regular file"),
    "device": (lambda path: path.symlink_to("/dev/zero"), "is a device or pipe"),
    "link to itself": (lambda path: path.symlink_to(path), "oo many levels of symbolic links"),
    "missing": (lambda path: None, "o such file"),
    "name of 5,000 characters": (None, "File name too long"),
}


def write(path, content) -> None:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def bad_file(tmp_path, wrong):
    make, words = NO_FILE[wrong]
    path = tmp_path / ("bad" + "x" * 5000 if make is None else "bad")
    if make:
        make(path)
    return path, words


def with_parameters(path):
    """The words after `launch` for a skin with this parameter file."""
    return "skin.launch.yaml", "port:=loop://", "monitor:=false", f"config:={path}"


def with_weights(tmp_path, path):
    config = tmp_path / "skin.yaml"
    section = {"compensation": {"ros__parameters": {"weights": str(path), "method": "cnn"}}}
    config.write_text(json.dumps(section))
    return with_parameters(config)


def with_table(tmp_path, path):
    config = tmp_path / "skin.yaml"
    parameters = {
        "circuit": {"rows": 2, "cols": 2},
        "geometry": {"shape": "table", "table": str(path)},
    }
    config.write_text(json.dumps({"/**": {"ros__parameters": parameters}}))
    return with_parameters(config)


@pytest.mark.parametrize("wrong", YAML)
def test_bad_yaml_is_one_line(tmp_path, wrong):
    content, words = YAML[wrong]
    write(tmp_path / "bad.yaml", content)
    signal.alarm(HANG)
    with pytest.raises(FileError) as error:
        read_yaml(tmp_path / "bad.yaml")
    holds(one_line(error.value), "bad.yaml: ")
    holds(one_line(error.value), words)


@pytest.mark.parametrize("content", [*NO_YAML_OF.values(), YAML["key twice"][0], b"a: \xfc"])
def test_each_reader_of_yaml_refuses_it_by_name(refused, tmp_path, content):
    write(tmp_path / "bad.yaml", content)
    refused("launch", *with_parameters(tmp_path / "bad.yaml"))
    refused("sim", "--link", "x", "--config", "bad.yaml")
    with pytest.raises(FileError, match=r"bad.yaml: "):
        PressureCurve.load(tmp_path / "bad.yaml")


@pytest.mark.parametrize("wrong", NO_FILE)
def test_what_is_no_file(refused, tmp_path, wrong):
    """Wherever a file is named."""
    path, words = bad_file(tmp_path, wrong)
    for command in (
        ("launch", *with_parameters(path)),
        ("sim", "--link", "x", "--config", path),
        ("train", "--config", path),
        ("train", "--start", path),
        ("launch", *with_weights(tmp_path, path)),
        ("launch", *with_table(tmp_path, path)),
    ):
        holds(refused(*command), words)
    signal.alarm(HANG)
    with pytest.raises((OSError, FileError)) as error:
        PressureCurve.load(path)
    holds(one_line(error.value), words)


def test_an_empty_file_name(refused):
    for words in (
        ("launch", "skin.launch.yaml", "port:=loop://", "config:="),
        ("launch", ""),
        ("sim", "--link", "x", "--config", ""),
    ):
        refused(*words, named=": ")


def test_where_results_go(refused, tmp_path):
    """A file where a folder must be, and the reverse, before long work."""
    (tmp_path / "bad").write_text("precious")
    holds(refused("train", "--out", "bad"), "--out bad: must be a folder")
    holds(refused("bench", "--out", "bad"), "--out bad: must be a folder")
    assert (tmp_path / "bad").read_text() == "precious"


@pytest.mark.parametrize("content", [b"", WEIGHTS])
def test_a_bad_checkpoint(tmp_path, content):
    """Refused before the pairs of a training are made."""
    pytest.importorskip("torch")
    from tactile_skin.learning import training

    (tmp_path / "checkpoint.pt").write_bytes(content)
    with pytest.raises(ValueError, match=r"checkpoint.pt: is no checkpoint .* --restart"):
        training.train(Circuit(4, 4), PressureCurve(), TrainingConfig(), tmp_path)


# --- launch files -------------------------------------------------------------------------------


def test_an_argument_given_twice(refused):
    line = refused("launch", "skin.launch.yaml", "port:=a", "port:=b", named="'port'")
    holds(line, "is given twice")


# --- parameter files ----------------------------------------------------------------------------


def shared(text: str) -> str:
    return f"/**:\n  ros__parameters:\n    {text}\n"


PARAMETERS = {  # what is wrong -> (content, what the line must hold)
    "section null": ("compensation:\n", "compensation: must hold ros__parameters"),
    "parameters a list": ("compensation: {ros__parameters: [a]}\n", "= ['a']: must map names"),
    "section twice, by its full name": (
        "compensation: {ros__parameters: {}}\n/compensation: {ros__parameters: {}}\n",
        "/compensation: is the section compensation again",
    ),
    "parameter twice": (
        shared("{circuit: {rows: 8}, circuit.rows: 9}"),
        "/**: circuit.rows is given twice",
    ),
    "rows a map": (shared("circuit: {rows: {a: 1}}"), "'circuit.rows.a' is unknown"),
    "mask of another size": (shared("circuit: {mask: '11 11'}"), "mask has shape (2, 2)"),
    "rpy of two": (shared("geometry: {rpy: [0.0, 1.0]}"), "rpy = [0.0, 1.0]"),
    "a value of 5,000 letters": (
        f"compensation: {{ros__parameters: {{method: {'x' * 5000}}}}}",
        "xxx...xxx",
    ),
}


@pytest.mark.parametrize("wrong", PARAMETERS)
def test_a_parameter_file_of_bad_values(refused, tmp_path, wrong):
    content, words = PARAMETERS[wrong]
    write(tmp_path / "bad.yaml", content)
    holds(refused("launch", *with_parameters("bad.yaml"), named="bad.yaml: "), words)


def test_a_misspelt_parameter_of_the_board(refused, tmp_path):
    """`sim` and `train` read circuit and curve alone, but know when one of these is misspelt."""
    (tmp_path / "bad.yaml").write_text(shared("circuit: {rwos: 8}"))
    holds(refused("sim", "--link", "x", "--config", "bad.yaml"), "'circuit.rwos' is unknown")


def test_good_files_are_taken(tmp_path):
    """Aliases, merges and tags of plain types among them."""
    text = "a: &a {x: 1, y: [2]}\nb: {<<: *a, x: 3}\nc: [*a, *a]\ne: !!str 5\n"
    a = {"x": 1, "y": [2]}
    assert parse_yaml("\ufeff" + text, "here") == {
        "a": a,
        "b": {"x": 3, "y": [2]},
        "c": [a, a],
        "e": "5",
    }
    assert parse_yaml("", "here") is None
    (tmp_path / "skin.yaml").write_bytes(b"\xef\xbb\xbf" + CONFIG.replace("\n", "\r\n").encode())
    shipped = ParameterFile(share_dir() / "config" / "skin.yaml")
    copied = ParameterFile(tmp_path / "skin.yaml").sections
    assert [s.values for s in copied] == [s.values for s in shipped.sections]


@pytest.mark.parametrize("text", ["1e3", "2.5e1", "-1.E-5", ".5e3", "+1E+2"])
def test_a_number_with_an_exponent_is_one_as_in_ros(text):
    assert parse_yaml(f"r_ref: {text}", "here") == {"r_ref": float(text)}


def test_what_is_written_is_read_as_what_it_was():
    """A serial number that reads as a number among it."""
    data = {"serial_number": "7523e10", "port": "1.5E3", "x": [1e-5, 1e16, -1e300], "e": "e5"}
    assert parse_yaml(write_yaml(data), "here") == data
    assert parse_yaml("1e-05", "here") == 1e-5  # as JSON has it: processes are given it


# --- curve files --------------------------------------------------------------------------------

CURVES = {  # what is wrong -> (content, what the line must hold)
    "empty": ("", "needs the keys force"),
    "a key too many": ("force: [0, 1]\nresistance: [2, 1]\nx: 1", "needs the keys"),
    "a number": ("force: 5\nresistance: [2, 1]", "force = 5: must be a list of numbers"),
    "lists": ("force: [[0, 1]]\nresistance: [2, 1]", "must be a list of numbers"),
    "truth": ("force: [0, true]\nresistance: [2, 1]", "must be a list of numbers"),
    "nothing in it": ("force: []\nresistance: []", "two or more"),
    "NaN": ("force: [0, .nan]\nresistance: [2, 1]", "force = [0.0, nan] N"),
    "too close": ("force: [0, 1.0e-320, 1]\nresistance: [9.0e+300, 2.0e-300, 1.0e-300]", "close"),
}


@pytest.mark.parametrize("wrong", CURVES)
def test_a_curve_file_of_bad_values(tmp_path, wrong):
    content, words = CURVES[wrong]
    write(tmp_path / "bad.yaml", content)
    with pytest.raises(FileError) as error:
        PressureCurve.load(tmp_path / "bad.yaml")
    holds(str(error.value), ["bad.yaml: ", words])


# --- weights ------------------------------------------------------------------------------------


def packed(meta=None, **changes) -> bytes:
    """The shipped weights with other arrays (None: left out, bytes: a member as it is)."""
    with np.load(io.BytesIO(WEIGHTS)) as file:
        arrays = dict(file)
    if meta is not None:
        arrays["meta"] = np.array(json.dumps(meta) if isinstance(meta, dict) else meta)
    arrays |= {name.replace("__", "."): array for name, array in changes.items()}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in arrays.items():
            if array is not None:
                content = io.BytesIO()
                if isinstance(array, bytes):
                    content.write(array)
                else:
                    np.lib.format.write_array(content, np.asanyarray(array))
                archive.writestr(f"{name}.npy", content.getvalue())
    return buffer.getvalue()


def header(text: str, body=b"") -> bytes:
    """An array of this header."""
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + body


def meta_with(**changes) -> dict:
    meta = {"format": 1} | network.shipped("paper").meta
    for key, value in changes.items():
        meta[key] = meta[key] | value if isinstance(value, dict) else value
    return meta


ROW = np.zeros((1, 1, 1, 16), np.float32)
BAD_WEIGHTS = {  # what is wrong -> (content, what the line must hold)
    "empty": (lambda: b"", "not a weights file"),
    "no zip": (lambda: b"weights", "not a weights file"),
    "cut": (lambda: WEIGHTS[:-100], "not a weights file"),
    "a bit wrong": (lambda: WEIGHTS[:9000] + b"\x55" + WEIGHTS[9001:], "CRC"),
    "empty zip": (lambda: b"PK\5\6" + bytes(18), "not a weights file"),
    "large": (lambda: bytes(2**21), "too large: must be at most 1024 KiB"),
    "array missing": (lambda: packed(head__0__bias=None), "'head.0.bias' is missing"),
    "array unknown": (lambda: packed(head__9__bias=ROW), "'head.9.bias' is unknown"),
    "shape": (lambda: packed(row__weight=ROW[..., :8]), "'row.weight' is float32 of shape"),
    "type int": (lambda: packed(row__weight=ROW.astype(int)), "'row.weight' is int64"),
    "objects": (lambda: packed(row__weight=ROW.astype(object)), "pickle"),
    "NaN": (lambda: packed(row__weight=ROW * np.nan), "'row.weight': must be finite"),
    "std 0": (lambda: packed(input_std=np.zeros((1, 1, 1))), "'input_std': must be above 0"),
    "senseless": (
        lambda: packed(head__0__weight=np.full((9, 27, 3, 3), 1e38)),
        "force is not finite",
    ),
    "a terabyte": (
        lambda: packed(
            row__bias=header("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000,)}")
        ),
        "not a weights file",
    ),
    "no meta": (lambda: packed(meta=""), "not a weights file"),
    "meta of 10,000 digits": (lambda: packed(meta="1" * 10_000), "not a weights file"),
    "format": (lambda: packed(meta=meta_with(format=2)), "format: must be 1"),
    "no circuit": (lambda: packed(meta=meta_with(circuit=None)), "meta: circuit"),
    "curve a list": (lambda: packed(meta=meta_with(curve=[])), "meta: curve"),
    "rows": (lambda: packed(meta=meta_with(circuit={"rows": 10**9})), "rows = 1000000000"),
    "cols of another": (lambda: packed(meta=meta_with(circuit={"cols": 8})), "'row.weight'"),
    "circuit key": (lambda: packed(meta=meta_with(circuit={"r_pra": 1})), "r_pra"),
    "curve NaN": (lambda: packed(meta=meta_with(curve={"force": [0, np.nan]})), "curve"),
}


@pytest.mark.parametrize("wrong", BAD_WEIGHTS)
def test_bad_weights(refused, tmp_path, wrong):
    make, words = BAD_WEIGHTS[wrong]
    (tmp_path / "bad.npz").write_bytes(make())
    holds(refused("launch", *with_weights(tmp_path, "bad.npz"), named="weights bad.npz"), words)


def test_good_weights_are_taken_in_any_order(tmp_path):
    adc = np.random.default_rng(1).uniform(0.05, 0.8, (16, 16))
    (tmp_path / "w.npz").write_bytes(packed())
    found = network.load(tmp_path / "w.npz").predict(adc)
    np.testing.assert_array_equal(found, network.shipped("paper").predict(adc))


# --- tables of cells ----------------------------------------------------------------------------

TABLE = (
    "row,col,x,y,z,nx,ny,nz\n0,0,0,0,0,1,0,0\n0,1,0,1,0,1,0,0\n1,0,0,0,1,1,0,0\n1,1,0,1,1,1,0,0\n"
)
# --- fuzzing: only ValueError may come out ------------------------------------------------------

QUICK = settings(max_examples=60)
WORDS = [b"&a ", b"*a", b"<<: *a", b"[", b"]", b"{", b"}", b": ", b"- ", b"\n", b"\t", b"\0"]
WORDS += [b"\xff", b"'", b'"', b"!!int ", b"!x ", b"null", b"~", b"1e400", b".nan", b".inf"]
WORDS += [b"9" * 30, b"-1", b"0x", b"1:2", b"%YAML", b"---\n", b"|\n", b"? ", b"# ", b"", b"true"]
WORDS += [b")", b"/", b"\\", b",", b"\xc3", b"\xe2\x80\xa8", b"\r", b"  "]
edits = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 40), st.sampled_from(WORDS) | st.binary(max_size=4)),
    min_size=1,
    max_size=6,
)


def edited(content: bytes, changes) -> bytes:
    """Each change: where (a share of the content), how many bytes go, and what comes."""
    for share, gone, new in changes:
        at = int(share * len(content))
        content = content[:at] + new + content[at + gone :]
    return content


def only_value_errors(action, *args):
    """The action's result, or None for a ValueError of one line."""
    signal.alarm(HANG)
    try:
        with np.errstate(all="ignore"):
            return action(*args)
    except ValueError as error:
        assert one_line(error)
        return None
    finally:
        signal.alarm(0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


def start_with(folder, content: bytes):
    (folder / "fuzz.yaml").write_bytes(content)
    files = [ParameterFile(folder / "fuzz.yaml", own=True)]
    skin_of("stop_on_push", "compensation", files=files).build()


def force_of(folder, content: bytes):
    (folder / "fuzz.npz").write_bytes(content)
    weights = network.load(folder / "fuzz.npz")
    force = weights.predict(np.full((weights.rows, weights.cols), 0.1))
    assert np.isfinite(force).all()


def table_of(folder, content: bytes):
    (folder / "fuzz.csv").write_bytes(content)
    position, normal, area = read_table(folder / "fuzz.csv", np.ones((2, 2), bool))
    np.testing.assert_allclose(np.linalg.norm(normal, axis=2), 1.0)
    assert np.isfinite(position).all() and (area > 0).all()


def curve_of(folder, content: bytes):
    (folder / "fuzz.yaml").write_bytes(content)
    curve = PressureCurve.load(folder / "fuzz.yaml")
    assert np.isfinite(curve.force(curve.resistance(np.linspace(0.0, curve.max_force)))).all()


def meta_of(folder, content: bytes):
    force_of(folder, packed(meta=content.decode("utf-8", "replace")))


SEEDS = {  # what -> (valid content, what reads it)
    "parameters": (CONFIG.replace("    frame_id: base_link", "").encode(), start_with),
    "weights": (WEIGHTS, force_of),
    "meta": (json.dumps({"format": 1} | network.shipped("paper").meta).encode(), meta_of),
    "table": (TABLE.encode(), table_of),
    "curve": (b"force: [0, 0.5, 1.0e+1]\nresistance: [2.0e+4, 900, 80.5]\n", curve_of),
}


@pytest.mark.parametrize("what", SEEDS)
def test_what_is_fuzzed_is_valid(folder, what):
    content, read = SEEDS[what]
    read(folder, content)


@pytest.mark.parametrize("what", SEEDS)
@QUICK
@given(changes=edits)
def test_changed_files_are_taken_or_refused(folder, what, changes):
    content, read = SEEDS[what]
    only_value_errors(read, folder, edited(content, changes))


ARRAYS = sorted(network.shapes("paper", 16, 16))


def filled(shape, kind, value) -> np.ndarray:
    with np.errstate(all="ignore"):
        return np.full(shape, value).astype(kind)


arrays = st.builds(
    filled,
    st.lists(st.integers(0, 17), max_size=5).map(tuple).filter(lambda s: np.prod(s) < 1e4),
    st.sampled_from(["f2", "f4", "f8", ">f4", "i4", "U3", "bool"]),
    st.sampled_from([0.0, 1.0, -1.0, np.inf, np.nan, 1e-40, 1e30]),
)
values = st.sampled_from([0.0, 1e-40, 1e4, -1e30, 3e38, np.nan, np.inf])


@QUICK
@given(st.dictionaries(st.sampled_from(ARRAYS), values | arrays, min_size=1, max_size=3))
@example({"input_std": 1e-40})
def test_changed_arrays_are_taken_or_refused(folder, changes):
    """A number: the array keeps its shape."""
    shapes = network.shapes("paper", 16, 16)
    for name, value in changes.items():
        if isinstance(value, float):
            changes[name] = np.full(shapes[name], value, np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        content = packed(**{name.replace(".", "__"): array for name, array in changes.items()})
    only_value_errors(force_of, folder, content)


@QUICK
@given(st.lists(st.sampled_from([word.decode("latin-1") for word in WORDS])).map("".join))
def test_any_text_is_yaml_or_refused(text):
    only_value_errors(parse_yaml, text, "here")


def test_a_shown_value_is_short():
    assert shorten("x" * 1000) == f"'{'x' * 36}...{'x' * 19}'"
    assert shorten([1, 2]) == "[1, 2]"
    assert len(one_line(ValueError("x\ny" * 5000))) == 800
