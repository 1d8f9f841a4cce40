"""Commands of `tactile-skin` that are too long for cli.py, one a file.

Imports everything but the command line.
"""
