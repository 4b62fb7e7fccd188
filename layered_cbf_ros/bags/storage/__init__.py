"""Bags as files: rosbag2 folders of mcap, written, read and mended."""
