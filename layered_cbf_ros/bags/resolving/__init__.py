"""Re-solving: what the controllers answer to recorded inputs, now or with other gains."""
