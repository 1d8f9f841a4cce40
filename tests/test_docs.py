# SPDX-License-Identifier: Apache-2.0
"""The documents say what the code says, and the site of them builds."""

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tactile_skin.cli import COMMANDS, make_parser

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
KINDS = {"Added:", "Changed:", "Removed:", "Fixed:"}  # of changes
GUIDE_WORDS = 14_200  # Start and How to together: what a user reads; 800 of robot learning
_LOADED = re.compile(r'<(?:script|img|link rel="stylesheet")[^>]*(?:src|href)="([^"]*)"')


def guides() -> list[Path]:
    """Pages of the site's first two sections."""
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    return [DOCS / name for name in re.findall(r"[\w/]+\.md", nav.partition("- Ref")[0])]


GUIDES = [*guides(), ROOT / "README.md"]


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def blocks(page: Path, language: str) -> list[str]:
    pattern = rf"^```{language}\n(.*?)^```"
    return re.findall(pattern, page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def test_what_a_user_reads_stays_short():
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in guides()) <= GUIDE_WORDS
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 700


@pytest.mark.parametrize("page", guides(), ids=named)
def test_guides_name_no_measurements(page):
    """Seeds and scripts belong into docs/lab."""
    assert not re.findall(r"benchmarks\.|--seed|\bseeds? \d", page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", GUIDES, ids=named)
def test_each_command_of_a_guide_is_understood(page):
    for line in "".join(blocks(page, "sh")).replace("\\\n", " ").splitlines():
        for part in line.partition(" #")[0].split("&&"):
            words = shlex.split(part)
            if words and words[0].endswith("tactile-skin"):
                args = make_parser(*COMMANDS).parse_args(words[1:])
                assert args.command in COMMANDS


@pytest.mark.parametrize("page", GUIDES, ids=named)
def test_each_parameter_that_a_guide_names_exists(page):
    """As `circuit.rows`, `stop_on_push.threshold`, or in a block of YAML."""
    nodes = yaml.safe_load((ROOT / "config" / "skin.yaml").read_text(encoding="utf-8"))
    known = {"frame_id": ""} | dict(nodes["/**"]["ros__parameters"])
    known |= {name[4:]: node["ros__parameters"] for name, node in nodes.items() if name != "/**"}
    text = page.read_text(encoding="utf-8")
    for group, name in re.findall(r"`(\w+)\.(\w+)(?:: [^`]*)?`", text):
        assert group not in known or name in known[group], f"{group}.{name}"
    for block in blocks(page, "yaml"):
        for name, node in yaml.safe_load(block).items() if "launch:" not in block else ():
            given = node.get("ros__parameters", {}) if isinstance(node, dict) else {}
            at = known.get(name.removeprefix("/**").removeprefix("/"), known)
            if name.startswith("/**") or name in known:
                assert not list(unknown(given, at)), name


def unknown(given: dict, known: dict):
    """Yield the keys that are not known, at any depth."""
    for key, value in given.items():
        if key not in known:
            yield key
        elif isinstance(value, dict) and isinstance(known[key], dict):
            yield from unknown(value, known[key])


def test_the_topics_are_those_of_the_nodes():
    rows = [line for line in (DOCS / "topics.md").read_text("utf-8").splitlines() if "|" in line]
    for module in (ROOT / "tactile_skin" / "nodes").rglob("*.py"):
        source = module.read_text(encoding="utf-8")
        for kind, topic in re.findall(r'create_publisher\((\w+), "(skin/\w+)"', source):
            assert any(f"`{topic}`" in row and kind in row for row in rows), f"{topic}: {kind}"


def test_the_reference_is_what_the_code_says():
    """`python docs/generate.py` writes these pages."""
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    for page, make in generate.PAGES.items():
        assert (DOCS / page).read_text(encoding="utf-8") == make(), page


def test_the_site_is_built_without_a_warning_and_needs_no_network(tmp_path):
    pytest.importorskip("mkdocs")
    pytest.importorskip("material")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=quiet)
    assert done.returncode == 0, done.stderr
    for page in tmp_path.rglob("*.html"):
        loaded = _LOADED.findall(page.read_text(encoding="utf-8"))
        assert not [address for address in loaded if address.startswith(("http", "//"))], page
    assert (tmp_path / "source" / "config" / "skin.yaml.txt").exists()


def test_each_change_is_one_line_under_a_kind():
    """test_colcon.py: as bloom reads it."""
    page = (ROOT / "CHANGELOG.rst").read_text("utf-8")
    versions = re.split(r"^\d+\.\d+\.\d+ \(.+\)\n-+$", page, flags=re.MULTILINE)
    assert len(versions) >= 3
    for version in versions[1:]:
        lines = [line for line in version.splitlines() if line]
        assert {line for line in lines if line.endswith(":")} <= KINDS
        assert not [line for line in lines if line.startswith(" ")]
