"""Commands of `tactile-skin`, one a file, with `register(parser)` and `run(args)`.

Imports everything but the command line.
"""
