# SPDX-License-Identifier: Apache-2.0
"""What tests and benchmarks share: oracles, simulated boards, real parts; no scripts."""
