"""A bag as a moving picture, drawn on the processor alone."""
