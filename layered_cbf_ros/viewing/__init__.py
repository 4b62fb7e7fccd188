"""What people see of a run: one snapshot type, from the live graph or a bag, drawn anywhere."""
