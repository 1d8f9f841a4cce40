# SPDX-License-Identifier: Apache-2.0
"""From a parameter file to circuit, curve and geometry."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve
from tactile_skin.launch import launch, read_skin, share_dir

SKIN = """
/**:
  ros__parameters:
    circuit: {rows: 4, cols: 6, r_par: 100.0}
    curve: {force: [0.0, 1.0], resistance: [9000.0, 90.0]}
    geometry: {shape: cylinder, radius: 0.2}
left/compensation:
  ros__parameters: {circuit: {r_par: 200.0}}
"""


def write(tmp_path, text=SKIN):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    return path


def test_a_file_gives_circuit_curve_and_geometry(tmp_path):
    circuit, curve, geometry = read_skin(write(tmp_path))
    assert circuit == Circuit(4, 6, r_par=100.0)
    assert curve == PressureCurve([0.0, 1.0], [9000.0, 90.0])
    assert geometry.position.shape == (4, 6, 3)
    assert np.hypot(*geometry.position[0, 0, :2]) == pytest.approx(0.2)


def test_a_node_may_have_a_section_of_its_own(tmp_path):
    assert read_skin(write(tmp_path), "left/compensation").circuit.r_par == 200.0


def test_a_file_says_how_the_matrix_is_read(tmp_path):
    text = SKIN.replace("r_par: 100.0", "readout: loaded, driven: columns", 1)
    circuit = read_skin(write(tmp_path, text)).circuit
    assert (circuit.readout, circuit.driven) == ("loaded", "columns")
    text = SKIN.replace("r_par: 100.0", "readout: half open", 1)
    with pytest.raises(ValueError, match=r"mine.yaml: .*readout of node .* = 'half open'.*loaded"):
        read_skin(write(tmp_path, text))


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("r_par: 100.0", "r_par: -1.0", "yaml: line 4: parameter circuit.r_par"),
        ("radius: 0.2", "\n      radiu: 0.2", "yaml: line 7: parameter 'geometry.radiu'"),
        ("90.0]", "95000.0]", "yaml: line 5: "),  # two values that do not go together
    ],
)
def test_what_is_refused_is_named_with_its_line(tmp_path, old, new, where):
    path = write(tmp_path, SKIN.partition("left")[0].replace(old, new))
    with pytest.raises(ValueError, match=where):
        read_skin(path)
    with pytest.raises(ValueError, match=where.partition(": ")[2]):
        launch("skin.launch.yaml", config=path, port="loop://").build()


def test_without_a_file_the_defaults_hold():
    """They are the shipped file's; a cover whose shape nobody stated has no direction."""
    shipped, default = read_skin(share_dir() / "config" / "skin.yaml"), read_skin()
    assert default[:2] == shipped[:2] == (Circuit(), PressureCurve())
    for skin in (shipped, default):
        assert (skin.geometry.normal == 0.0).all()
        assert np.ptp(skin.geometry.position[..., 1]) > 0.2  # places as on a flat mat


def test_a_file_says_how_the_boards_adc_reads(tmp_path):
    """It is no part of what is unpacked, and of no other node than those that read the board."""
    adc = "adc_offset: 12.0, adc_full_scale: 700.0, inverted: true, scanned: '111111 111110 " + (
        "111111 111111'"
    )
    skin = read_skin(write(tmp_path, SKIN.replace("rows: 4", f"rows: 4, {adc}")))
    assert len(skin) == 3
    assert (skin.adc.offset, skin.adc.full_scale, skin.adc.inverted) == (12.0, 700.0, True)
    assert np.argwhere(~skin.adc.scanned).tolist() == [[1, 5]]
    assert read_skin().adc.ratio(1023.0) == 1.0


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ("scanned: '11 11'", r"scanned has shape \(2, 2\): the circuit is \(4, 6\)"),
        ("scanned: '12'", "circuit.scanned = '12': must be words of 0 and 1"),
        ("adc_offset: 2000.0", "adc_offset = 2000.0 ADC steps: must be less than the full scale"),
    ],
)
def test_an_adc_that_cannot_be_is_refused(tmp_path, given, named):
    with pytest.raises(ValueError, match=named):
        read_skin(write(tmp_path, SKIN.replace("rows: 4", f"rows: 4, {given}")))


def test_a_gain_of_each_cell(tmp_path):
    path = tmp_path / "skin.yaml"
    numbers = [1.0, 0.9, 1.1, 1.0, 1.0, 1.2]
    text = "{{/**: {{ros__parameters: {{circuit: {{rows: 2, cols: 3}}, curve: {{gain: {}}}}}}}}}"
    path.write_text(text.format(numbers))
    curve = read_skin(path).curve
    np.testing.assert_array_equal(curve.gain, np.reshape(numbers, (2, 3)))
    path.write_text(text.format([1.0]))
    assert read_skin(path).curve.gain is None
    path.write_text(text.format([1.5]))
    np.testing.assert_array_equal(read_skin(path).curve.gain, np.full((2, 3), 1.5))


def test_a_gain_of_some_cells_is_refused(tmp_path):
    path = write(tmp_path, "/**: {ros__parameters: {curve: {gain: [1.0, 1.0]}}}")
    with pytest.raises(ValueError, match="2 numbers: must be 1 or"):
        read_skin(path)
