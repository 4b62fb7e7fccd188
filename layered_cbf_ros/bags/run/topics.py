"""The topics that a run is judged by, and the fields of those that are JointStates."""

STATE, PLAN = '/state', '/safe_trajectory'
CLEARANCE, OBSTACLES = '/simulator/clearance', '/obstacles/truth'
BARRIERS, INTERVENTION = '/coordinator/barriers', '/coordinator/intervention'
SCENARIO, DIAGNOSTICS = '/scenario', '/diagnostics'
POSITION, VELOCITY, EFFORT = range(3)
