"""What scripts/bench measures: simulated physics, the speed of the parts, the whole graph."""
