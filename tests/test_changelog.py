# SPDX-License-Identifier: Apache-2.0
"""The changelog is what bloom reads: a version, its date, kinds, and one line a change."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[1] / "CHANGELOG.rst"
KINDS = {"Added:", "Changed:", "Removed:", "Fixed:"}


def test_each_change_is_one_line_under_a_kind():
    versions = re.split(r"^\d+\.\d+\.\d+ \(.+\)\n-+$", PAGE.read_text("utf-8"), flags=re.MULTILINE)
    assert len(versions) >= 3
    for version in versions[1:]:
        lines = [line for line in version.splitlines() if line]
        assert {line for line in lines if line.endswith(":")} <= KINDS
        assert not [line for line in lines if line.startswith(" ")]


def test_bloom_can_read_it():
    changelog = pytest.importorskip("catkin_pkg.changelog")
    read = changelog.get_changelog_from_path(str(PAGE))
    versions = [version for version, _, _ in read.foreach_version()]
    assert versions == ["0.1.0", "0.2.0"]
    kinds = [str(part) for part in read.get_content_of_version("0.2.0") if str(part) in KINDS]
    assert kinds == ["Added:", "Changed:", "Removed:", "Fixed:"]
