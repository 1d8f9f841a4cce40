# SPDX-License-Identifier: Apache-2.0
"""What explains a frame that skin and circuit do not, or explains it better."""
