"""From the bytes of a message to its fields, by the definition that its bag carries."""

from __future__ import annotations

from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from layered_cbf_ros.bags.storage.topic import Record, Topic
from layered_cbf_ros.errors import BagError

IDL_RULE = '=' * 80 + '\nIDL: '


class MessageDecoder:
    """Decodes records with rosbags.

    A bag's own definitions count; where it has none, those of Jazzy do.
    """

    def __init__(self) -> None:
        self._stores: dict[str, Typestore] = {}

    def decode(self, record: Record) -> Any:
        """Return the message as a rosbags dataclass.

        Raises:
            BagError: If the type is unknown, its definition spoilt, or the bytes don't fit.
        """
        topic = record.topic
        store = self._stores.get(topic.type_name)
        if store is None:
            store = self._stores[topic.type_name] = typestore_of(topic)
        try:
            return store.deserialize_cdr(record.data, topic.type_name)
        except (SerdeError, ValueError) as error:  # ValueError: text that is no UTF-8
            raise BagError(
                f'{topic.name}: {len(record.data)} bytes are no {topic.type_name}: {error}'
            ) from None


def typestore_of(topic: Topic) -> Typestore:
    """Return a store that knows the type of a topic.

    Raises:
        BagError: If the bag has no sound definition of it and Jazzy has none, or the
            definition isn't the one that the recorded hash stands for.
    """
    if not topic.definition:
        store = get_typestore(Stores.ROS2_JAZZY)
        if topic.type_name not in store.fielddefs:
            raise BagError(
                f"{topic.name}: type '{topic.type_name}' is unknown: the bag holds no definition "
                'of it; record it where its package is installed'
            )
        return store
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(_types(topic))
        found = store.hash_rihs01(topic.type_name)
    except (TypesysError, SyntaxError, LookupError, ValueError) as error:
        reason = str(error).partition('\n')[0] or type(error).__name__
        raise BagError(
            f"{topic.name}: the bag's definition of '{topic.type_name}' is spoilt: {reason}"
        ) from None
    if topic.type_hash and found != topic.type_hash:
        raise BagError(
            f"{topic.name}: the bag's definition of '{topic.type_name}' has the hash {found}, "
            f'its messages {topic.type_hash}: they are of another version'
        )
    return store


def _types(topic: Topic) -> Any:
    """Return the types of a definition, in the form that rosbags registers."""
    if topic.definition_format == 'ros2msg':
        return get_types_from_msg(topic.definition, topic.type_name)
    if not topic.definition.startswith(IDL_RULE):
        return get_types_from_idl(topic.definition)
    types: dict[str, Any] = {}
    for part in topic.definition.split(IDL_RULE)[1:]:
        types |= get_types_from_idl(part.partition('\n')[2])
    return types
