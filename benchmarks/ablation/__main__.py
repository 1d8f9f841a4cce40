# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.ablation`."""

from .. import harness
from .run import main

if __name__ == "__main__":
    harness.run(main)
