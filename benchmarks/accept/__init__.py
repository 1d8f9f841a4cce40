# SPDX-License-Identifier: Apache-2.0
"""What must not get worse: frozen streams, seeds and bounds, one command, one table.

lines.py     the lines of the table, and what each is made of
presses.py   palms and pushes on boards that differ from what is entered, through the nodes
boards.py    such boards, and what is wrong with them
e6d30719.json, e6d30719-quick.json   the figures of that commit, as --json writes them
"""
