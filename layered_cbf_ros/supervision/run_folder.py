"""The folder of a run: what was run, how it went, and what came out.

scenario.yaml params.yaml bag/ logs/ figures/ summary.json
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from layered_cbf_ros.errors import LayeredCbfError
from layered_cbf_ros.resources import find_folder
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.scenario_file import to_json
from layered_cbf_ros.supervision.run_parameters import (
    explicit,
    parameter_file,
    read_defaults,
    run_parameters,
)


@dataclass(frozen=True, slots=True)
class RunFolder:
    """Where everything of a run is.

    Attributes:
        path: The folder.
        recorded: Whether the run has a bag.
    """

    path: Path
    recorded: bool

    @property
    def bag(self) -> Path:
        """Return the folder of the bag."""
        return self.path / 'bag'

    @property
    def parameters(self) -> Path:
        """Return the parameter file of all nodes."""
        return self.path / 'params.yaml'

    @property
    def scenario(self) -> Path:
        """Return the scenario as it is run, every parameter in it: a scenario file too."""
        return self.path / 'scenario.yaml'

    @property
    def figures(self) -> Path:
        """Return the folder of the figures."""
        return self.path / 'figures'

    @property
    def summary(self) -> Path:
        """Return the file of all figures of merit."""
        return self.path / 'summary.json'


def make_run_folder(
    scenario: Scenario, time_text: str, output: Path | None, record: bool, epoch_ns: int = 0
) -> RunFolder:
    """Make the folder of a run, and write what its nodes read.

    Args:
        scenario: What is run.
        time_text: Date and time, for the folder's name.
        output: The folder; by default a new one below `runs/`.
        record: Whether there will be a bag.
        epoch_ns: Wall time at which the time of emulated robots is 0 [ns].

    Raises:
        LayeredCbfError: If the folder has content already or can't be made.
    """
    path = output or Path('runs') / f'{scenario.name or "scenario"}_{time_text}'
    folder = RunFolder(path.absolute(), record)
    try:
        folder.path.mkdir(parents=True, exist_ok=True)
        if any(folder.path.iterdir()):
            raise LayeredCbfError(f'{path} is not empty; name a new folder for the run')
        (folder.path / 'logs').mkdir()
        defaults = read_defaults(find_folder('params'))
        folder.scenario.write_text(to_json(explicit(scenario, defaults)), encoding='utf-8')
        bag = folder.bag if record else None
        values = run_parameters(scenario, defaults, folder.scenario, bag, epoch_ns)
        folder.parameters.write_text(parameter_file(values), encoding='utf-8')
    except OSError as error:
        raise LayeredCbfError(f'{path} can not be written: {error.strerror}') from None
    return folder
