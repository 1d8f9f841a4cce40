# SPDX-License-Identifier: Apache-2.0
"""Commands of `tactile-skin`, one a file, with `EXAMPLES`, `register(parser)` and `run(args)`.

Imports everything but the command line.
"""
