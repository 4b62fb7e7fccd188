"""The top layer: one filtered motion for every agent (paper II, III-A to III-D)."""
