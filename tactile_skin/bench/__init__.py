"""Measurements with production code only: `tactile-skin bench`, one file a part.

speed.py      speed against accuracy           cases.py    pictures of objects, sums of load
stability.py  where each method fails          growth.py   8 x 8 to 64 x 64
way.py        bytes in to stop hook            solvers.py  what the solvers promise, as numbers
measure.py    time and error, once for all     chart.py    how figures look, and their JSON
textile.py    a skin richer than any model     faults.py   its troubles, and their strengths
choose.py     which method when, in words      run.py      the parts in turn
insole.py     real frames                      curves.py   training curves
reliability.py   faults through the whole chain: fault_board.py, a board that can be damaged;
                 fault_data.py and fault_wires.py, how; fault_streams.py, who touches it;
                 fault_chain.py, the nodes on a driven clock; fault_table.py, what was counted
"""
