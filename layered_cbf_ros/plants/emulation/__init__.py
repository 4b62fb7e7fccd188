"""An emulated A1: what answers on the other end of the wire when there is no robot."""
