"""What tests and benchmarks share: oracles, simulated boards, real parts; no scripts."""
