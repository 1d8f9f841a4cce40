# SPDX-License-Identifier: Apache-2.0
"""The resistor matrix and the fabric: forward model, curve, Laplacian.

Imports nothing of ours but files, and yaml_files while a curve's file is read.
"""
