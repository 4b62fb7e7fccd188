"""What was run, as a bag tells it."""

from __future__ import annotations

import json

from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.errors import BagError, LayeredCbfError
from layered_cbf_ros.node_topics import SCENARIO
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_file import from_json


def recorded_scenario(bag: Bag) -> Scenario:
    """Return the first scenario in a bag; it is read only up to there.

    Raises:
        BagError: If there is none, or it isn't one.
    """
    for record in bag.records({SCENARIO}):
        try:
            return from_json(MessageDecoder().decode(record).data)
        except (LayeredCbfError, json.JSONDecodeError) as error:
            raise BagError(f'{SCENARIO} of {bag.path} is spoilt: {error}') from None
    raise BagError(
        f'{bag.path} has no {SCENARIO}: which robots there were and how the nodes were set up '
        'is not known; record this topic too'
    )
