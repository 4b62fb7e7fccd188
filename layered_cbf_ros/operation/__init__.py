"""What an operator asks for: joysticks, commanded velocities, the emergency stop."""
