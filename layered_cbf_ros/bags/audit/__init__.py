"""Recomputes from what was recorded whether a run kept its promises.

Nothing here comes from the coordinator, nor from the verdict of a run: the arithmetic is
derived anew, so that a mistake in one is not repeated in the other.
"""
