"""Bags: recorded, read, judged and drawn, with or without ROS."""
