# SPDX-License-Identifier: Apache-2.0
"""The parameters of all nodes as data: default, unit, range and meaning of each, in one place.

`nodes` holds them, one frozen dataclass a node; the limits of the stop, the gate and the admittance
stand in behaviours. What a node declares, ROS's descriptors,
config/skin.yaml, docs/parameters.md and the arguments of commands follow from it. After a change:
`python -m tactile_skin.parameters`.
"""
