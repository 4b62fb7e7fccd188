"""Every error this package raises on purpose.

A message names the field, the value that was found and what to do about it.
"""

EXIT_MISSING = 3
"""Exit code of a node that waited for another in vain."""


class LayeredCbfError(Exception):
    """Base of all errors of this package; its text is meant for a person."""


class ParameterError(LayeredCbfError):
    """A node parameter is unknown, of the wrong type or out of its range."""


class ScenarioError(LayeredCbfError):
    """A scenario file is misspelt, or describes an impossible world."""


class MessageError(LayeredCbfError):
    """A message is of the wrong size, not finite, or names unknown things."""


class BagError(LayeredCbfError):
    """A bag can't be written or read."""


class GraphError(LayeredCbfError):
    """The node graph isn't complete, or stopped answering."""


class MissingInputError(GraphError):
    """An input that a lockstep tick needs did not come in time."""


class StopRequestedError(Exception):
    """The node was asked to end: no error, but the way out of its loop."""
