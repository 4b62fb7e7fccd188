"""One run as its bag tells it: numbers over time, figures, a verdict."""
