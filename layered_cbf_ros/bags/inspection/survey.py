"""One pass through a bag finds out all about it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.bags.inspection.bag_info import BagInfo, info_of
from layered_cbf_ros.bags.inspection.problems import problems_of
from layered_cbf_ros.bags.inspection.topic_statistics import TopicStatistics
from layered_cbf_ros.bags.run.run_record import RunGatherer, RunRecord
from layered_cbf_ros.bags.run.verdict import Verdict, judge_record
from layered_cbf_ros.bags.storage.bag import Bag


@dataclass(frozen=True)
class Survey:
    """What is in a bag.

    Attributes:
        info: Its figures.
        problems: What is wrong with it, a line each; nothing if it is sound.
        record: What it tells of a run, as far as it does.
    """

    info: BagInfo
    problems: tuple[str, ...]
    record: RunRecord

    def verdict(self) -> Verdict | None:
        """Return the verdict on the run, None if the bag is of something else."""
        return None if self.record.scenario is None else judge_record(self.record)


def survey(path: Path, bag: Bag) -> Survey:
    """Look through a bag.

    Args:
        path: What was asked for.
        bag: The bag.

    Raises:
        BagError: If it can't be read at all.
    """
    gatherer, statistics = RunGatherer(), dict[str, TopicStatistics]()
    for record in bag.records():
        name = record.topic.name
        known = statistics.get(name)
        if known is None:
            known = statistics[name] = TopicStatistics(record.topic)
        if known.take(record) and gatherer.wants(name):
            gatherer.take(record)
    run = gatherer.finish(path, bag)
    return Survey(info_of(bag, statistics), tuple(problems_of(bag, statistics, run)), run)
