# SPDX-License-Identifier: Apache-2.0
"""Write config/skin.yaml and docs/parameters.md: python -m tactile_skin.parameters."""

from pathlib import Path

from . import documents

root = Path(__file__).parents[2]
(root / "config" / "skin.yaml").write_text(documents.config(), encoding="utf-8")
(root / "docs" / "parameters.md").write_text(documents.page(), encoding="utf-8")
