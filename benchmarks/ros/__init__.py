"""The skin on a real ROS."""
