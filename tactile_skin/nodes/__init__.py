"""The nodes: parameters in, callbacks, publish. What they compute stands in the pure modules.

Each is a class that takes a Node handle, so that the same code runs in-process and on real ROS.
"""

# Frames that a stage may lag behind, 0.1 s at 100 a second: a machine that stutters loses none, and
# what waits longer is stale to the stop.
QUEUE = 10
