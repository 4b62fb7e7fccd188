"""Messages on the wire and the core types they stand for; the only place that knows both."""
