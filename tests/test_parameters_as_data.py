# SPDX-License-Identifier: Apache-2.0
"""One line makes a parameter: what follows from it, and that what is shipped does."""

import argparse
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml

from tactile_skin import solvers
from tactile_skin.behaviours.admittance import AdmittanceConfig, Linear
from tactile_skin.behaviours.gate import GateConfig
from tactile_skin.behaviours.stop import StopConfig
from tactile_skin.commands import doctor
from tactile_skin.errors import ParameterError
from tactile_skin.fields import leaves, parameter
from tactile_skin.middleware import launch_file, parameter_file
from tactile_skin.middleware.bus import Context, Node, Parameter
from tactile_skin.middleware.config import declared
from tactile_skin.middleware.launch_file import read_arguments
from tactile_skin.middleware.package import CLASSES
from tactile_skin.middleware.parameter_file import ParameterFile
from tactile_skin.parameters import documents, nodes
from tactile_skin.parameters.nodes import SECTIONS, all_names, own_names, shared_names
from tactile_skin.parameters.shared import Circuit, Shared

ROOT = Path(__file__).parents[1]
LENGTH = parameter(0.5, "m", "width of its head; 0: none", 0.0, 2.0)
STYLE = parameter("flat", "", "how it is drawn", choices=("flat", "round"), live=True)


@pytest.mark.parametrize("file", ["config/skin.yaml", "docs/parameters.md"])
def test_what_is_shipped_is_what_is_written(file):
    """Else: python -m tactile_skin.parameters"""
    text = documents.config() if file.startswith("config") else documents.page()
    assert (ROOT / file).read_text() == text


def test_the_shipped_file_holds_each_default():
    file = ParameterFile(ROOT / "config" / "skin.yaml")
    sections = {(section.namespace, section.node): section.values for section in file.sections}
    assert sections[None, ""] == {leaf.name: leaf.default for leaf in leaves(Shared)}
    for node, kind in SECTIONS.items():
        own = {leaf.name: leaf.default for leaf in leaves(kind)}
        own = {name: value for name, value in own.items() if name not in shared_names()}
        found = sections.get((None, node), {})
        assert found == own and list(map(type, found.values())) == list(map(type, own.values()))
    assert set(SECTIONS) == set(CLASSES)


def test_a_description_names_unit_and_range_of_each_number():
    for kind in SECTIONS.values():
        for leaf in leaves(kind):
            number = type(leaf.default) in (int, float)
            assert (leaf.about.low is None) is not number, leaf
            assert leaf.about.text and "\n" not in leaf.about.text


def test_no_setting_switches_off_what_protects():
    """Each is above 0 where 0 would never stop, and finite."""
    may_be_0 = {"hold", "debounce", "lead", "stale_after", "linear.dead_band", "angular.dead_band"}
    for kind in (StopConfig, GateConfig, AdmittanceConfig):
        for leaf in leaves(kind):
            if type(leaf.default) is float:
                assert leaf.about.low > 0.0 or leaf.name in may_be_0
                assert leaf.about.low >= 0.0 and leaf.about.high < np.inf


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (StopConfig, "threshold", 0.0),
        (StopConfig, "stale_after", -0.1),
        (StopConfig, "debounce", -1.0),
        (StopConfig, "hold", np.nan),
        (StopConfig, "lead", -0.01),
        (GateConfig, "command_timeout", -1.0),
        (GateConfig, "stop_timeout", np.inf),
        (GateConfig, "touch", np.nan),
        (GateConfig, "alignment", 0.0),
        (AdmittanceConfig, "touch_timeout", np.inf),
        (AdmittanceConfig, "stop_timeout", 0.0),
        (Linear, "mass", 0.0),
        (Linear, "max_speed", np.nan),
        (Linear, "dead_band", -1.0),
    ],
)
def test_a_setting_that_would_is_refused(kind, name, value):
    with pytest.raises(ValueError, match=f"{name} = {value}: must be finite, and at least"):
        kind(**{name: value})


@pytest.fixture
def wider(monkeypatch):
    """The node push_arrow with two parameters more."""
    fields = [("width", float, LENGTH), ("style", str, STYLE)]
    made = dataclasses.make_dataclass(
        "PushArrow", fields, bases=(SECTIONS["push_arrow"],), frozen=True
    )
    made.__doc__ = "An arrow."
    monkeypatch.setitem(SECTIONS, "push_arrow", made)
    own_names.cache_clear(), all_names.cache_clear()
    yield made
    own_names.cache_clear(), all_names.cache_clear()


def node(**values) -> Node:
    overrides = [Parameter(*item) for item in values.items()]
    return Node("push_arrow", context=Context(), parameter_overrides=overrides)


def test_one_line_is_all_that_a_new_parameter_needs(wider, tmp_path):
    text = documents.config()
    assert "    width: 0.5                # width of its head [m]; 0: none\n" in text
    assert "    style: flat               # flat or round: how it is drawn\n" in text
    assert yaml.safe_load(text)["/**/push_arrow"]["ros__parameters"]["width"] == 0.5
    row = "| `width` | `0.5` | 0 to 2 | width of its head [m]; 0: none |"
    assert row in documents.page() and "how it is drawn *Live.*" in documents.page()
    handle = node(width=1)
    assert declared(handle, wider) == wider(width=1.0)
    file = tmp_path / "mine.yaml"
    file.write_text("/**/push_arrow: {ros__parameters: {width: 0.1}}")
    ParameterFile(file, own=True).check({})
    file.write_text("/**/push_arrow: {ros__parameters: {widht: 0.1}}")
    with pytest.raises(ParameterError, match=r"'widht' is unknown; there are: .*width"):
        ParameterFile(file, own=True).check({})


def test_the_doctor_takes_each_parameter_of_the_board():
    parser = argparse.ArgumentParser(formatter_class=argparse.RawDescriptionHelpFormatter)
    doctor.register(parser)
    for leaf in leaves(Circuit):
        assert f"  {leaf.name} " in parser.format_help()
        assert leaf.about.description in parser.format_help()
        assert doctor._KINDS[leaf.name] is type(leaf.default)


def test_the_methods_are_those_of_the_solvers():
    assert tuple(solvers.METHODS) == nodes.METHODS


def test_names_are_found_in_every_section():
    everyone = shared_names().union(*map(own_names, SECTIONS))
    assert {"circuit.rows", "frame_id", "linear.mass", "format.line"} <= everyone
    assert parameter_file.SHARED == ("circuit", "curve", "geometry")


def test_an_argument_of_the_launch_files_is_described_as_its_parameter_is():
    name = "skin.launch.yaml"
    said = {a.name: a.description for a in read_arguments(ROOT / "launch" / name)}
    for node, takes in launch_file._FILES[name].items():
        about = {leaf.name: leaf.about.description for leaf in leaves(SECTIONS[node])}
        for argument in takes.keys() - {"use_sim_time", "duration"}:  # it says more
            assert said[argument] == about[takes[argument]]
