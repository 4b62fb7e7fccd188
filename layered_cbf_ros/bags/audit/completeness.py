"""What must be in a bag before anything in it proves that a run was safe."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import yaml

from layered_cbf_ros.bags.audit.evidence import Evidence, is_audited
from layered_cbf_ros.bags.audit.findings import Check
from layered_cbf_ros.bags.recording.losses import REFUSED_NOTE, read_losses
from layered_cbf_ros.bags.storage.writer import FAILED_NOTE
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.node_topics import DIAGNOSTICS, SCENARIO
from layered_cbf_ros.run_nodes import node_names
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.timing import LOCKSTEP

NAME = 'completeness'
RECORDER = '/recorder'


def check_completeness(evidence: Evidence, files: tuple[Path, ...], reason: str | None) -> Check:
    """Check that nothing was lost, cut off or left out.

    Args:
        evidence: The bag.
        files: Its files.
        reason: Why the parameters of the run are not known, None if they are.
    """
    holes = []
    if evidence.truncated:
        holes.append('the bag is cut off: what happened after its end is not known')
    for topic, count in evidence.unreadable.items():
        holes.append(f'{count} messages of {topic} cannot be decoded')
    if evidence.scenario is None:
        holes.append(f'no {SCENARIO}: who took part, and with which parameters, is not known')
    else:
        holes += _silent_nodes(evidence, evidence.scenario)
        holes += [reason] if reason is not None else []
    holes += _told_losses(evidence)
    holes += _counted_losses(evidence, files)
    return Check(NAME, '', '', holes=tuple(holes))


def _silent_nodes(evidence: Evidence, scenario: Scenario) -> list[str]:
    """Return the nodes of the scenario of which there are no diagnostics."""
    nodes = node_names(scenario, record=False)
    return [f'no {DIAGNOSTICS} of {node}' for node in nodes if node not in evidence.diagnostics]


def _told_losses(evidence: Evidence) -> list[str]:
    """Return what the recorder itself says that it lost of the topics that are audited.

    Recorders that leave no note at least count gaps between stamps in their diagnostics;
    in real time nodes leave stamps out, so that these gaps say nothing.
    """
    try:
        losses = read_losses(evidence.notes)
    except BagError as error:
        return [str(error)]
    holes = []
    for topic, told in (losses or {}).items():
        if is_audited(topic, evidence.has_bases) and told.lost:
            holes.append(f'{topic}: the recorder tells of {told.lost} lost messages')
        # Nodes tell their health again and again: what they said before is no hole.
        if is_audited(topic, evidence.has_bases) and topic != DIAGNOSTICS and told.missed_before:
            holes.append(f'{topic}: {told.missed_before} messages were sent before the recording')
    for topic, reason in evidence.notes.get(REFUSED_NOTE, {}).items():
        if is_audited(topic, evidence.has_bases):
            holes.append(f'{topic}: was not recorded: {reason}')
    holes += [f'the recorder failed: {why}' for why in evidence.notes.get(FAILED_NOTE, {}).values()]
    gaps = evidence.diagnostics.get(RECORDER, {}).get('lost', '0')
    lockstep = evidence.scenario is not None and evidence.scenario.time == LOCKSTEP
    if losses is None and lockstep and gaps != '0':
        holes.append(f'{RECORDER} tells of {gaps} lost messages')
    return holes


def _counted_losses(evidence: Evidence, files: tuple[Path, ...]) -> list[str]:
    """Return the topics of which metadata.yaml counts more messages than the files hold."""
    path = files[0].parent / 'metadata.yaml' if files else Path()
    if not path.is_file():
        return []
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        entries = content['rosbag2_bagfile_information']['topics_with_message_count']
        counts: Mapping[str, int] = {
            entry['topic_metadata']['name']: int(entry['message_count']) for entry in entries
        }
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError):
        return [f'{path.name} cannot be read: how many messages there should be is not known']
    return [
        f'{topic}: {path.name} counts {count} messages, the files hold {found}'
        for topic, count in counts.items()
        if (found := evidence.counts.get(topic, 0)) < count
    ]
