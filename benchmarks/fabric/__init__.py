# SPDX-License-Identifier: Apache-2.0
"""What newtons are worth on real fabric, by public recordings with a force sensor.

The recordings have no licence: fetch them yourself, they are no part of this repository.
"""
