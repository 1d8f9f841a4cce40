"""The nodes: parameters in, callbacks, publish. What they compute stands in the pure modules.

Each is a class that takes a Node handle, so that the same code runs in-process and on real ROS.
"""
