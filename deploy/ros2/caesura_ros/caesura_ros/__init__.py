"""Caesura for ROS 2."""
