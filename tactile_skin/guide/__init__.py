# SPDX-License-Identifier: Apache-2.0
"""What a person is led through, in the terminal and on the page: detection, calibration."""
