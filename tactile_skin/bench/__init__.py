"""Measurements with production code only: `tactile-skin bench`, one file per part.

speed.py      speed against accuracy           cases.py    pictures of objects, sums of load
stability.py  where each method fails          growth.py   8 x 8 to 64 x 64
way.py        last byte to stop hook           touch_to_stop.py   touch to stop hook
measure.py    time and error, for all parts    chart.py    style of the figures, and their JSON
textile.py    a skin with more effects than    faults.py   its disturbances, and their strengths
              any solver models                run.py      the parts in turn
choose.py     tables and lines for the pages   damage/     faults through the complete chain

Figures that only a developer needs are in tests/yardsticks.
"""
