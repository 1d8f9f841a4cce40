# SPDX-License-Identifier: Apache-2.0
"""One Chromium for the tests of a file."""

import pytest
from support.chromium import Chromium

SIZE = 1400, 900  # pixels of the page


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    with Chromium(tmp_path_factory.mktemp("profile"), *SIZE) as browser:
        yield browser


@pytest.fixture
def browser(started):
    """An empty page, that must end without an error."""
    started.empty()
    started.resize(*SIZE)
    started.prefer("light")
    started.call("Page.setBypassCSP", enabled=False)
    yield started
    assert started.errors == []
