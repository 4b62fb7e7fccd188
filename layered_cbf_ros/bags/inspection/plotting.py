"""Figures of a run and the page about its bag, as files."""

from __future__ import annotations

from pathlib import Path

from layered_cbf_ros.bags.inspection.report import CAPTIONS, report_page
from layered_cbf_ros.bags.inspection.survey import Survey
from layered_cbf_ros.bags.run.verdict import Verdict
from layered_cbf_ros.errors import BagError

REPORT = 'report.html'


def check_figures(folder: Path, force: bool) -> None:
    """Make sure that nothing is overwritten; with force, remove what is there.

    Args:
        folder: Where the files will go.
        force: Whether the user wants it.

    Raises:
        BagError: If a file is there and there is no force, or there can be no folder.
    """
    if folder.exists() and not folder.is_dir():
        raise BagError(f'--plot {folder} is no folder; choose another one')
    names = [REPORT, *(f'{name}.png' for name in CAPTIONS)]
    found = [folder / name for name in names if (folder / name).exists()]
    if found and not force:
        raise BagError(f'{found[0]} exists already; choose another folder for --plot, or --force')
    for path in found:
        path.unlink()


def write_figures(survey: Survey, verdict: Verdict | None, folder: Path) -> list[Path]:
    """Write all figures that the bag has the data for, and the page.

    Args:
        survey: What is in the bag.
        verdict: On the run, None if the bag is of something else.
        folder: Where the files go; made if it is absent.

    Returns:
        The files written.

    Raises:
        BagError: If they can't be written.
    """
    from layered_cbf_ros.bags.figures.run_figures import draw_record  # loads matplotlib

    page = folder / REPORT
    try:
        figures = draw_record(survey.record, folder)
        page.write_text(report_page(survey, verdict, figures), encoding='utf-8')
    except OSError as error:
        raise BagError(f'--plot {folder} cannot be written: {error.strerror}') from None
    return [*figures, page]
