# SPDX-License-Identifier: Apache-2.0
"""What must not get worse: frozen streams, seeds and bounds, one command, one table.

lines.py     the lines of the table, and what each is made of
presses.py   palms and pushes on boards that differ from what is entered, through the nodes
boards.py    such boards, and what is wrong with them
rests.py     sound boards whose rest is unlike that of an even fabric
others.py    other benchmarks and recordings of others, as numbers that lines add up
weighed.py   boards with a wrong entry that are calibrated with known weights
without.py   the table with one mechanism left out
e6d30719-quick.json   that commit's figures with --quick, as --json writes them, but for `stop`,
             which needs a machine of its own; e6d30719.json would be those of all streams
"""
