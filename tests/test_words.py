# SPDX-License-Identifier: Apache-2.0
"""`--name value`, `--name=value` and `name:=value` say the same in every command."""

import itertools
import os
import subprocess
import sys

import pytest

from tactile_skin.arguments import CommandParser, split
from tactile_skin.cli import COMMANDS, make_parser


def parsed(*words):
    args = vars(make_parser(words[0]).parse_args(words))
    return {k: sorted(v) if k == "words" else v for k, v in args.items() if k != "run"}


GIVEN = {  # command -> its files, and arguments
    "launch": (["skin.launch.yaml"], {"port": "/dev/x", "config": "a.yaml", "ros": "2"}),
    "view": (["a.mcap"], {"view_port": "0", "config": "a.yaml"}),
    "sim": ([], {"link": "/tmp/x", "config": "a.yaml", "scene": "idle"}),
    "flash": ([], {"port": "/dev/x", "config": "a.yaml", "adc_mhz": "1"}),
    "calibrate": ([], {"config": "a.yaml", "out": "b.yaml", "rest": "r.csv", "1.2kg": "x.csv"}),
    "doctor": (["a.csv"], {"config": "a.yaml", "rows": "8", "adc_offset": "-12.5"}),
    "record": (["o.mcap", "skin.launch.yaml"], {"port": "x", "max_duration": "5", "last": "2"}),
    "replay": (["a.mcap"], {"config": "a.yaml", "method": "map", "jobs": "1", "out": "b.mcap"}),
    "train": ([], {"config": "a.yaml", "epochs": "3", "rate": "0.01"}),
    "bench": (["speed"], {"out": "figures", "seed": "3"}),
    "gestures": (["train", "takes"], {"out": "a.npz"}),
    "detect": ([], {"port": "/dev/x", "baud": "9600", "out": "a.yaml"}),
}


@pytest.mark.parametrize("command", GIVEN)
def test_both_styles_say_the_same_in_any_order(command):
    files, given = GIVEN[command]
    styles = [
        [["--" + name.replace("_", "-"), value] for name, value in given.items()],
        [[f"--{name.replace('_', '-')}={value}"] for name, value in given.items()],
        [[f"{name}:={value}"] for name, value in given.items()],
    ]
    found = []
    for style in styles:
        for before in ([], style):
            after = [] if before else style
            words = [*itertools.chain(*before), *files, *itertools.chain(*after)]
            found.append(parsed(command, *words))
    assert all(other == found[0] for other in found)
    assert found[0]["command"] == command


def test_every_command_is_tried():
    assert set(GIVEN) == set(COMMANDS)


def test_switches_and_lists_have_both_styles():
    assert parsed("bench", "speed", "--quick") == parsed("bench", "quick:=true", "speed")
    assert parsed("bench", "speed", "quick:=false") == parsed("bench", "speed")
    both = parsed("replay", "--compare", "auto", "naive", "--jobs", "1", "a")
    assert both == parsed("replay", "compare:=auto,naive", "jobs:=1", "a")
    assert both["compare"] == ["auto", "naive"]
    assert parsed("launch", "--view")["words"] == ["view:=true"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["sim", "--link", "x", "--sene", "5"], "'sene' is unknown; did you mean 'scene'?"),
        (["sim", "link:=x", "sene:=5"], "'sene' is unknown; did you mean 'scene'?"),
        (["calibrate", "--config", "a", "config:=b"], "argument 'config' is given twice"),
        (["bench", "quick:=5"], "quick:=5: must be true or false"),
        (["train", "--config"], "expected one argument"),
    ],
)
def test_a_mistake_is_named(words, said, capsys):
    with pytest.raises(SystemExit) as ended:
        make_parser(words[0]).parse_args(words)
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_a_value_may_begin_with_a_hyphen():
    parser = CommandParser()
    parser.add_argument("--noise", type=float)
    parser.add_argument("words", nargs="*")
    assert parser.parse_args(["noise:=-1"]).noise == -1.0
    assert parser.parse_args(["--offset", "-.5", "x"]).words == ["x", "offset:=-.5"]


def test_a_file_whose_name_holds_an_equals_sign_is_a_file():
    assert split(["run=3.csv"], {"rows": int}) == (["run=3.csv"], {})
    with pytest.raises(ValueError, match="'rows=3': arguments are written"):
        split(["rows=3"], {"rows": int})


def test_help_loads_no_command():
    """It lists what each does, and takes no longer than argparse."""
    code = (
        "import sys; from tactile_skin import cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print(*sorted(m for m in sys.modules if m.startswith(('tactile_skin.', 'numpy'))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *said, loaded = done.stdout.splitlines()
    assert all(any(name in line for line in said) for name in COMMANDS)
    assert set(loaded.split()) <= {
        f"tactile_skin.{name}" for name in ("arguments", "cli", "errors", "files")
    }


@pytest.mark.parametrize(
    ("line", "expected"), [("tactile-skin do", "doctor"), ("tactile-skin replay --jo", "--jobs")]
)
def test_a_shell_completes_commands_and_options(line, expected):
    """As argcomplete asks for it: the answer comes on file 8."""
    pytest.importorskip("argcomplete")
    given = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    done = subprocess.run(
        ["sh", "-c", f"'{sys.executable}' -m tactile_skin 8>&1 9>&2"],
        env=os.environ | given, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout.strip() == expected


def test_help_of_each_command_needs_no_extra():
    """A robot's install has none: what lacks is said by a command that needs it."""
    code = """
import sys
class Missing:
    def find_spec(name, path=None, target=None):
        if name in ("torch", "tqdm", "matplotlib", "mcap", "rosbags", "websockets"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Missing)
from tactile_skin.cli import COMMANDS, make_parser
make_parser(*COMMANDS)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
