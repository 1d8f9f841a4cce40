# SPDX-License-Identifier: Apache-2.0
"""A version, its date, kinds, and one line a change. test_colcon.py: as bloom reads it."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[1] / "CHANGELOG.rst"
KINDS = {"Added:", "Changed:", "Removed:", "Fixed:"}


def test_each_change_is_one_line_under_a_kind():
    versions = re.split(r"^\d+\.\d+\.\d+ \(.+\)\n-+$", PAGE.read_text("utf-8"), flags=re.MULTILINE)
    assert len(versions) >= 3
    for version in versions[1:]:
        lines = [line for line in version.splitlines() if line]
        assert {line for line in lines if line.endswith(":")} <= KINDS
        assert not [line for line in lines if line.startswith(" ")]
